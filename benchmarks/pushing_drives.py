"""Gain of torque drives that may also push: bounds of the stopping distance with signed forces.

A wheel that drives the vehicle could balance the forces of the others, so that they brake more. The
bound of stops that keep heading and line of motion (`omni_runs.limit`) is computed with and without
such forces, for random stops of the robustness campaign and on ice. Both are upper estimates with
few levels of the torque while it builds up. No law can gain more distance
than the bound. A stop that keeps heading and line does not rotate, so pushing can only reduce the
rotation of stops for which there is no bound without it; these are counted.
"""

import math
from collections.abc import Sequence

import numpy as np
import output

from omni_core.commands.workspace import workspace_folder
from omni_core.quantities import FloatArray
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.limit.bounds import maneuver_of
from omni_runs.limit.forces import Case
from omni_runs.limit.stop_kinds import StraightStops
from omni_studies.campaign.random_braking import RandomBraking, draw

WORTHWHILE = 0.02  # gain from which pushing would be worth its risk [1]
ICE = 0.1  # friction factor of ice
DIRECTIONS = range(0, 91, 5)  # directions of motion on ice [deg]


class PushedStops(StraightStops):
    """Stops that keep heading and line, in which wheels may also drive the vehicle."""

    def _case(self, friction: FloatArray, torque: FloatArray) -> Case:
        return super()._case(friction, torque)._replace(pushes=True)


def distances(experiment: ExperimentConfiguration) -> tuple[float, float]:
    """Return the bounds without and with pushing [m]; infinite if no such stop exists."""
    maneuver = maneuver_of(experiment.maneuver)
    twist = maneuver.twist * [1.0, 1.0, 0.0]
    question = experiment.vehicle, experiment.ground, maneuver._replace(twist=twist)
    braked, pushed = (
        kind(*question, sketch=True).distance(math.hypot(*twist[:2]))
        for kind in (StraightStops, PushedStops)
    )
    return braked, pushed


def gains(name: str, experiments: Sequence[ExperimentConfiguration]) -> output.Metrics:
    """Return the distribution of the gain over several stops [1]."""
    braked, pushed = np.array([distances(one) for one in experiments]).T
    both = np.isfinite(braked)
    gain = 1.0 - pushed[both] / braked[both]
    return {
        f"stops.{name}": (len(experiments), "1"),
        f"gain_mean.{name}": (float(np.mean(gain)), "1"),
        f"gain_largest.{name}": (float(np.max(gain)), "1"),
        f"worthwhile.{name}": (int(np.sum(gain > WORTHWHILE)), "1"),
        f"only_pushed.{name}": (int(np.sum(~both & np.isfinite(pushed))), "1"),
    }


def main() -> None:
    options = output.options(__doc__, stops=300, seed=0)
    braking = RandomBraking(ExperimentLibrary(workspace_folder() / "config"))
    seeds = range(options.seed, options.seed + options.stops)
    random = [braking.configurations(draw(seed))["unassisted"] for seed in seeds]
    ice = ("straight_line", "unassisted", f"ground.friction={ICE}")
    icy = [output.load(*ice, f"maneuver.direction_deg={one}") for one in DIRECTIONS]
    metrics = gains("random", random) | gains("ice", icy)
    output.publish("pushing_drives", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
