"""Ratio of the lower bound to the distance of a stop."""

import math

import numpy as np

from omni_loop import experiment, metrics
from omni_loop.history import RunHistory
from omni_tools.limit.bounds import Maneuver, straight_bound


def limit_share(
    history: RunHistory, configuration: experiment.ExperimentConfiguration, distance: float
) -> metrics.Metric:
    """Return the bound of the stopping distance divided by the distance of a run [1].

    The bound is valid for stops that keep heading and line of motion. It is computed for the same
    velocity without the yaw rate, and for the largest position of the pedal during the run.

    Args:
        history: history of the run.
        configuration: configuration of the run, with vehicle and ground.
        distance: stopping distance of the run [m].
    """
    start = history.brake_start
    if start is None or not distance > 0.0:
        return metrics.Metric(math.nan, "1", note="limit_share: there is no stopping distance")
    twist = history.twist[start] * np.array([1.0, 1.0, 0.0])
    maneuver = Maneuver(history.pose[start], twist, float(np.max(history.pedal)))
    bound = straight_bound(configuration.vehicle, configuration.ground, maneuver)
    share = bound.distance / distance
    note = ""
    if math.isnan(share):
        note = f"limit_share: {bound.reason}"
    elif distance < bound.distance - bound.tolerance:
        note = "this stop rotates and is shorter than any stop that keeps its heading"
    return metrics.Metric(share, "1", note=note)
