"""Random stops under every law, with the lower bounds of their distances."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from omni_core.geometry import turned
from omni_core.quantities import FloatArray
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.history import FastRun
from omni_runs.limit import bounds as limit
from omni_runs.limit.stop_kinds import KEPT, Maneuver
from omni_sim.configuration import GroundConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_studies.campaign.random_braking import RandomBraking, draw

LAWS: dict[str, tuple[str, ...]] = {
    "unassisted": (),
    "sliding_mode": (),
    "allocation_on_off": ("brake_assist.law=allocation",),
    "allocation": ("brake_assist.law=allocation", "vehicle.brake.kind=proportional"),
}
"""Overrides of `RandomBraking`, keyed by law."""


class BoundTrial(NamedTuple):
    """Results of a stop under each of the `LAWS`, with the bounds.

    Attributes:
        seed: seed of the random stop.
        vehicle: name of the vehicle's file.
        any_heading: lower bound of the path length of the center of gravity, or an upper estimate
            of this bound [m].
        any_heading_slack: tolerance of the bound `any_heading` [m]; NaN if the upper estimate
            sufficed.
        straight: lower bound of the distance of a stop that keeps heading and line, or an upper
            estimate of this bound [m]; NaN if braking starts while the vehicle rotates, if no run
            keeps heading and line, or if no bound can be computed.
        straight_slack: tolerance of the bound `straight` [m]; NaN if the upper estimate sufficed.
        path_unassisted: path of the center of gravity with all brakes on [m].
        path_sliding_mode: path of the center of gravity with `sliding_mode` [m].
        path_allocation_on_off: path of the center of gravity with `allocation` on on-off brakes
            [m].
        path_allocation: path of the center of gravity with `allocation` on proportional brakes [m].
        kept_unassisted: stopping distance with all brakes on [m]; NaN if the heading changed, or
            the path left the line of motion, by more than half a degree.
        kept_sliding_mode: stopping distance with `sliding_mode` [m]; NaN as for `kept_unassisted`.
        kept_allocation_on_off: stopping distance with `allocation` on on-off brakes [m]; NaN as for
            `kept_unassisted`.
        kept_allocation: stopping distance with `allocation` on proportional brakes [m]; NaN as for
            `kept_unassisted`.
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
    """Callable that runs the stop of a seed with every law; worker processes receive an instance.

    Args:
        library: library that contains the vehicle files.
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
        """Run the stop of a seed with every law, and compute the bounds of this stop."""
        drawn = draw(seed)
        tried = {law: one.configurations(drawn) for law, one in self._brakings.items()}
        first = tried["sliding_mode"]["unassisted"]
        runs = {"unassisted": run_fast_loop(first)}
        runs |= {law: run_fast_loop(both["assisted"]) for law, both in tried.items()}
        maneuver = _maneuver(runs["unassisted"], first)
        paths = [_path(run, first) for run in runs.values()]
        kept = [_kept(run, first, maneuver) for run in runs.values()]
        question = first.vehicle, first.ground, maneuver
        bounds = _bound(limit.any_heading_sketch, limit.any_heading_bound, question, paths)
        straight = math.nan, math.nan
        if maneuver.twist[2] == 0.0 and not np.all(np.isnan(kept)):
            straight = _bound(limit.straight_sketch, limit.straight_bound, question, kept)
        return BoundTrial(seed, drawn["vehicle"], *bounds, *straight, *paths, *kept)


def _bound(
    sketch: Callable[..., float],
    solve: Callable[..., limit.Bound],
    question: tuple[VehicleConfiguration, GroundConfiguration, Maneuver],
    distances: Sequence[float],
) -> tuple[float, float]:
    """Return a bound and its tolerance [m].

    If all runs are at least as long as an upper estimate of the bound, the slow computation of the
    bound is omitted, and the estimate is returned with the tolerance NaN.

    Args:
        sketch: function that returns the upper estimate [m].
        solve: function that returns the bound.
        question: arguments of both functions.
        distances: distances of the runs [m]; NaN for a run to which the bound does not apply.
    """
    estimate = sketch(*question)
    if np.nanmin(distances) >= estimate:
        return estimate, math.nan
    bound = solve(*question)
    return bound.distance, bound.tolerance


def _maneuver(run: FastRun, experiment: ExperimentConfiguration) -> Maneuver:
    """Return the motion at the start of braking; a residual yaw rate is set to zero."""
    scripted, pose = experiment.maneuver, _braking(run, experiment)
    twist = run.twist[-len(pose)].copy()
    if scripted.yaw_rate_deg == 0.0:
        twist[2] = 0.0
    return Maneuver(pose[0], twist, scripted.pedal, scripted.pedal_ramp_time)


def _braking(run: FastRun, experiment: ExperimentConfiguration) -> FloatArray:
    """Return x, y [m], yaw [rad] of base_link from the start of braking on, shape (T, 3)."""
    ramp = experiment.maneuver.pedal_ramp_time > 0.0  # a ramp starts with the pedal up
    return run.pose[(run.brake_start or 0) - int(ramp) :]


def _path(run: FastRun, experiment: ExperimentConfiguration) -> float:
    """Return the length of the path of the center of gravity while braking [m]."""
    center = experiment.vehicle.masses.center
    pose = _braking(run, experiment)
    moved = np.diff(pose[:, :2] + turned(np.asarray(center), pose[:, 2]), axis=0)
    return float(np.sum(np.hypot(*moved.T)))


def _kept(run: FastRun, experiment: ExperimentConfiguration, maneuver: Maneuver) -> float:
    """Return the stopping distance [m] if a run always keeps heading and line, otherwise NaN.

    The whole run is checked, because a vehicle may leave its line on a slippery patch and return to
    it.
    """
    pose = _braking(run, experiment)
    path = pose[:, :2] - pose[0, :2]
    cos, sin = math.cos(pose[0, 2]), math.sin(pose[0, 2])
    v_x, v_y = maneuver.twist[0], maneuver.twist[1]
    along = np.array([cos * v_x - sin * v_y, sin * v_x + cos * v_y]) / math.hypot(v_x, v_y)
    lateral = np.abs(along[0] * path[:, 1] - along[1] * path[:, 0])
    turned = float(np.max(np.abs(pose[:, 2] - pose[0, 2])))
    kept = turned <= KEPT and float(np.max(lateral)) <= math.tan(KEPT) * float(along @ path[-1])
    return math.hypot(*path[-1]) if kept else math.nan


def over_bound(stops: Sequence[BoundTrial], bound: str) -> FloatArray:
    """Return the distance of each stop under each law, divided by a bound, shape (stops, laws).

    The ratio is NaN if the stop has no bound, or if the bound does not apply to the run.
    """
    part = "path" if bound == "any_heading" else "kept"
    taken = np.array([[getattr(one, f"{part}_{law}") for law in LAWS] for one in stops])
    return np.asarray(taken / np.array([[getattr(one, bound)] for one in stops]))


def below(stops: Sequence[BoundTrial], bound: str) -> int:
    """Return how many runs are shorter than a bound by more than the tolerance of this bound.

    Args:
        stops: the stops, each with one run for each law.
        bound: ``any_heading`` or ``straight``.
    """
    slack = np.array([[getattr(one, f"{bound}_slack") / getattr(one, bound)] for one in stops])
    return int(np.sum(over_bound(stops, bound) < 1.0 - np.nan_to_num(slack)))
