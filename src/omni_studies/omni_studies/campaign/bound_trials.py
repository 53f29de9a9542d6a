"""A random stop under every law, compared with the lower bounds.

Bounds take far longer to compute than runs. So a run is first compared with an upper estimate of
the bound, and with the bound itself only if it is below this estimate.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_loop.compiled import FastRun, run_fast_loop
from omni_loop.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_platform.quantities import FloatArray
from omni_sim.vehicle.loads import MassProperties
from omni_studies.campaign.random_braking import RandomBraking, draw
from omni_tools.limit import bounds as limit

LAWS: dict[str, tuple[str, ...]] = {
    "unassisted": (),
    "sliding_mode": (),
    "allocation_on_off": ("brake_assist.law=allocation",),
    "allocation": ("brake_assist.law=allocation", "vehicle.brake.kind=proportional"),
}
"""Overrides of `RandomBraking` by law."""


class BoundTrial(NamedTuple):
    """A stop under each of the `LAWS`, and its bounds.

    Attributes:
        seed: seed of the braking.
        vehicle: name of its file.
        any_heading: bound of the path of the center of gravity, or its upper estimate [m].
        any_heading_slack: tolerance of the bound, NaN if the estimate was sufficient [m].
        straight: bound of the distance of a stop that keeps heading and line, or its upper
            estimate; NaN if there is none or no run has kept them [m].
        straight_slack: tolerance of `straight`, NaN if the estimate was sufficient [m].
        path_unassisted: path of the center of gravity with all brakes on [m].
        path_sliding_mode: path with `sliding_mode` [m].
        path_allocation_on_off: path with `allocation` on on-off brakes [m].
        path_allocation: path with `allocation` on proportional brakes [m].
        kept_unassisted: stopping distance with all brakes on; NaN if heading or line deviated by
            half a degree [m].
        kept_sliding_mode: such a distance with `sliding_mode` [m].
        kept_allocation_on_off: such a distance with `allocation` on on-off brakes [m].
        kept_allocation: such a distance with `allocation` on proportional brakes [m].
    """

    seed: int
    vehicle: str
    any_heading: float
    any_heading_slack: float
    straight: float
    straight_slack: float
    path_unassisted: float
    path_sliding_mode: float
    path_allocation_on_off: float
    path_allocation: float
    kept_unassisted: float
    kept_sliding_mode: float
    kept_allocation_on_off: float
    kept_allocation: float


class BoundTrials:
    """Runs a seed under every law; sent to the workers.

    Args:
        library: where the vehicles are.
    """

    def __init__(self, library: ExperimentLibrary) -> None:
        self._brakings = {
            law: RandomBraking(library, changes)
            for law, changes in LAWS.items()
            if law != "unassisted"
        }

    @property
    def fingerprint(self) -> str:
        """Digest of the configuration of the runs."""
        return "-".join(braking.fingerprint[:8] for braking in self._brakings.values())

    def __call__(self, seed: int) -> BoundTrial:
        """Run a seed under every law and compare it with its bounds."""
        drawn = draw(seed)
        tried = {law: one.configurations(drawn) for law, one in self._brakings.items()}
        first = tried["sliding_mode"]["unassisted"]
        runs = {"unassisted": run_fast_loop(first)}
        runs |= {law: run_fast_loop(both["assisted"]) for law, both in tried.items()}
        maneuver = _maneuver(runs["unassisted"], first)
        paths = [_path(run, first) for run in runs.values()]
        kept = [_kept(run, first, maneuver) for run in runs.values()]
        bounds = *_any(first, maneuver, min(paths)), *_straight(first, maneuver, np.array(kept))
        return BoundTrial(seed, drawn["vehicle"], *bounds, *paths, *kept)


def _any(
    experiment: ExperimentConfiguration, maneuver: limit.Maneuver, shortest: float
) -> tuple[float, float]:
    question = experiment.vehicle, experiment.ground, maneuver
    sketch = limit.any_heading_sketch(*question)
    if shortest >= sketch:
        return sketch, math.nan
    bound = limit.any_heading_bound(*question)
    return bound.distance, bound.tolerance


def _straight(
    experiment: ExperimentConfiguration, maneuver: limit.Maneuver, distances: FloatArray
) -> tuple[float, float]:
    if np.all(np.isnan(distances)) or maneuver.twist[2] != 0.0:
        return math.nan, math.nan
    question = experiment.vehicle, experiment.ground, maneuver
    sketch = limit.straight_sketch(*question)
    if np.nanmin(distances) >= sketch:
        return sketch, math.nan
    bound = limit.straight_bound(*question)
    return bound.distance, bound.tolerance


def _braking(run: FastRun, experiment: ExperimentConfiguration) -> FloatArray:
    """Return the poses from the start of braking on, shape (T, 3)."""
    ramp = experiment.maneuver.pedal_ramp_time > 0.0  # at whose start the pedal is still up
    return run.pose[run.brake_start - int(ramp) :]


def _maneuver(run: FastRun, experiment: ExperimentConfiguration) -> limit.Maneuver:
    """Return the motion at the start of braking; a residual yaw rate of the drive is set to 0."""
    scripted, pose = experiment.maneuver, _braking(run, experiment)
    twist = run.twist[-len(pose)].copy()
    if scripted.yaw_rate_deg == 0.0:
        twist[2] = 0.0
    return limit.Maneuver(pose[0], twist, scripted.pedal, scripted.pedal_ramp_time)


def _path(run: FastRun, experiment: ExperimentConfiguration) -> float:
    """Return the path of the center of gravity while braking [m]."""
    center = MassProperties.of(experiment.vehicle.body, experiment.vehicle.load).center
    pose = _braking(run, experiment)
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    arm = np.column_stack((cos * center[0] - sin * center[1], sin * center[0] + cos * center[1]))
    moved = np.diff(pose[:, :2] + arm, axis=0)
    return float(np.sum(np.hypot(*moved.T)))


def _kept(run: FastRun, experiment: ExperimentConfiguration, maneuver: limit.Maneuver) -> float:
    """Return the stopping distance of a run that keeps heading and line throughout, else NaN [m].

    A vehicle may leave its line to avoid low friction and return.
    """
    pose = _braking(run, experiment)
    path = pose[:, :2] - pose[0, :2]
    cos, sin = math.cos(pose[0, 2]), math.sin(pose[0, 2])
    v_x, v_y = maneuver.twist[0], maneuver.twist[1]
    along = np.array([cos * v_x - sin * v_y, sin * v_x + cos * v_y]) / math.hypot(v_x, v_y)
    aside = np.abs(along[0] * path[:, 1] - along[1] * path[:, 0])
    turned = float(np.max(np.abs(pose[:, 2] - pose[0, 2])))
    kept = turned <= limit.KEPT and float(np.max(aside)) <= math.tan(limit.KEPT) * float(
        along @ path[-1]
    )
    return math.hypot(*path[-1]) if kept else math.nan
