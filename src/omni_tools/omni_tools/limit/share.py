"""Ratio of the bound to the distance of a stop."""

import math

import numpy as np

from omni_loop import experiment, metrics
from omni_loop.history import RunHistory
from omni_tools.limit.bounds import Maneuver, any_heading_bound, straight_bound

_STRAIGHT = 1e-3  # yaw rate that is none [rad/s]
_SHORTER = "turns, which pays: it is shorter than any stop that keeps its heading"
_ANY = "limit_share is that of stops with any heading:"


def limit_share(
    history: RunHistory, configuration: experiment.ExperimentConfiguration, distance: float
) -> metrics.Metric:
    """Return the bound of the stopping distance divided by the distance of a run [1].

    The bound is that of stops that keep heading and line. If no such stop exists, it is that of
    any heading, and the note says so. The pedal is assumed at its largest position throughout.

    Args:
        history: history of the run.
        configuration: its vehicle and ground.
        distance: the run's stopping distance [m].
    """
    start = history.brake_start
    if start is None or not distance > 0.0:
        return metrics.Metric(math.nan, "1", note="limit_share: there is no stopping distance")
    twist = history.twist[start].copy()
    if abs(twist[2]) < _STRAIGHT:
        twist[2] = 0.0
    maneuver = Maneuver(history.pose[start], twist, float(np.max(history.pedal)))
    bound, note = straight_bound(configuration.vehicle, configuration.ground, maneuver), ""
    if math.isnan(bound.distance):
        note = f"{_ANY} {bound.reason}"
        bound = any_heading_bound(configuration.vehicle, configuration.ground, maneuver)
    share = bound.distance / distance
    if math.isnan(share):
        return metrics.Metric(share, "1", note=f"limit_share: {bound.reason}")
    if not note and distance < bound.distance - bound.tolerance:
        note = _SHORTER
    return metrics.Metric(share, "1", note=note)
