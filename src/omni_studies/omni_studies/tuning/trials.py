"""Trials of settings of the brake assistant for a vehicle: trade-off of rotation and distance.

A *setting* consists of the weighting with its k, Eqs. (58), (59), and the minimum dwell time of the
valves. Each setting is run with the dead time and the time constant of the vehicle's own brakes,
and with those of other brakes. Because of switching, a single run is sensitive to small deviations,
especially with long dwell times. A setting is therefore evaluated by its worst result in several
*situations*: the maneuver and slight deviations from it. All settings are run in the same
situations.
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from omni_core.quantities import FloatArray
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, changed
from omni_sim.configuration import GroundConfiguration
from omni_sim.ground.configuration import FrictionPatch
from omni_tools.campaign.runner import digest

Part = TypeVar("Part", GroundConfiguration, FrictionPatch)
# Limits on the deviations of speed [1], direction [deg], yaw rate [1] and friction [1].
_LARGEST_DEVIATIONS = (0.03, 3.0, 0.05, 0.05)


@dataclasses.dataclass(frozen=True)
class Setting:
    """A setting of the brake assistant.

    Attributes:
        weighting: ``zero``, ``cosine``, ``enhanced``, or ``off`` for no assistant.
        k: odd constant k of the enhanced weighting; other weightings ignore it.
        dwell_time: minimum time between two switching operations of a valve [s].
    """

    weighting: str
    k: int = 7
    dwell_time: float = 0.0

    @property
    def label(self) -> str:
        """Label of the setting's weighting for tables and figures."""
        return f"k{self.k}" if self.weighting == "enhanced" else self.weighting

    @property
    def overrides(self) -> tuple[str, ...]:
        """The setting as ``key=value`` texts for ``--set``."""
        texts = [f"brake_assist.weighting={self.weighting}"]
        if self.weighting == "enhanced":
            texts.append(f"brake_assist.k={self.k}")
        return (*texts, f"brake_assist.minimum_dwell_time={self.dwell_time:g}")


OFF = Setting("off")
"""Setting without the assistant."""


@dataclasses.dataclass(frozen=True)
class BrakeLag:
    """Dead time and lag of the brake pressure.

    Attributes:
        dead_time: dead time of the brakes [s].
        time_constant: time constant of the first-order lag [s].
    """

    dead_time: float = 0.0
    time_constant: float = 0.0

    @property
    def label(self) -> str:
        """Text with both times in milliseconds, or ``ideal`` if both are zero."""
        times = f"{1e3 * self.dead_time:g}_{1e3 * self.time_constant:g}_ms"
        return "ideal" if self == BrakeLag() else times


@dataclasses.dataclass(frozen=True, eq=False)
class TuningTrial:
    """Results of one setting with one brake lag in S situations.

    Attributes:
        setting: setting of the trial.
        lag: lag of the brakes.
        rotation: change of orientation [deg], infinite if the vehicle does not stop, shape (S,).
        distance: stopping distance [m], infinite if the vehicle does not stop, shape (S,).
        switchings: number of switching operations of all valves together [1], shape (S,).
    """

    setting: Setting
    lag: BrakeLag
    rotation: FloatArray
    distance: FloatArray
    switchings: FloatArray

    @property
    def worst_rotation(self) -> float:
        """Largest change of orientation in all situations [deg]."""
        return float(np.max(self.rotation))

    @property
    def worst_distance(self) -> float:
        """Longest stopping distance in all situations [m]."""
        return float(np.max(self.distance))


def situations(
    base: ExperimentConfiguration, count: int, seed: int
) -> tuple[ExperimentConfiguration, ...]:
    """Return a maneuver together with slight deviations from it.

    Args:
        base: undisturbed maneuver, the first situation.
        count: number of situations.
        seed: seed of the deviations.
    """
    random = np.random.default_rng(seed)
    result = [base]
    drawn = random.uniform(-1.0, 1.0, (max(count - 1, 0), 4))
    for speed, turn, yaw_rate, grip in (np.array(_LARGEST_DEVIATIONS) * drawn).tolist():
        maneuver = {
            "speed": base.maneuver.speed * (1.0 + speed),
            "direction_deg": base.maneuver.direction_deg + turn,
            "yaw_rate_deg": base.maneuver.yaw_rate_deg * (1.0 + yaw_rate),
        }
        patches = {name: _with_grip(patch, grip) for name, patch in base.ground.patches.items()}
        ground = changed(_with_grip(base.ground, grip), patches=patches)
        result.append(changed(base, maneuver=maneuver, ground=ground))
    return tuple(result)


def _with_grip(part: Part, grip: float) -> Part:
    """Return a copy of a ground or patch whose friction is multiplied by ``1 + grip``, up to 2."""
    return changed(part, friction=min(part.friction * (1.0 + grip), 2.0))


def configured(
    base: ExperimentConfiguration, setting: Setting, lag: BrakeLag
) -> ExperimentConfiguration:
    """Return a copy of an experiment with the given setting of the assistant and brake lag."""
    changes: dict[str, Any] = {"enabled": setting.weighting != OFF.weighting}
    if changes["enabled"]:
        changes |= {
            "weighting": setting.weighting,
            "k": setting.k,
            "minimum_dwell_time": setting.dwell_time,
        }
    brake = changed(base.vehicle.brake, **dataclasses.asdict(lag))
    return changed(base, brake_assist={"brake": brake, **changes}, vehicle={"brake": brake})


class Numbers(NamedTuple):
    """Result of one run: one setting with one brake lag in one situation.

    Attributes:
        seed: number of the run; situations vary fastest, then settings, then lags.
        rotation: change of orientation [deg], infinite if the vehicle does not stop.
        distance: stopping distance [m], infinite if the vehicle does not stop.
        switchings: number of switching operations of all valves together [1].
    """

    seed: int
    rotation: float
    distance: float
    switchings: float


@dataclasses.dataclass(frozen=True, eq=False)
class Trials:
    """Runs of every setting with every brake lag in every situation.

    Attributes:
        bases: configurations of the situations, with the velocity sensor.
        settings: the settings.
        lags: lags of the brakes.
    """

    bases: Sequence[ExperimentConfiguration]
    settings: Sequence[Setting]
    lags: Sequence[BrakeLag]

    @property
    def pairs(self) -> list[tuple[Setting, BrakeLag]]:
        """Pairs of setting and brake lag: all settings for the first lag, then for the next lag."""
        return [(setting, lag) for lag in self.lags for setting in self.settings]

    @property
    def count(self) -> int:
        """Number of all runs: situations times settings times brake lags."""
        return len(self.bases) * len(self.settings) * len(self.lags)

    @property
    def fingerprint(self) -> str:
        """Digest of settings, lags and situations."""
        pairs = [[dataclasses.astuple(one) for one in pair] for pair in self.pairs]
        return digest(self.bases, pairs)

    def run(self, number: int) -> Numbers:
        """Run the combination of situation, setting and lag with this number."""
        pair, situation = divmod(number, len(self.bases))
        run = run_fast_loop(configured(self.bases[situation], *self.pairs[pair]))
        enable = run.enable[max((run.brake_start or 0) - 1, 0) :]
        switchings = float(np.count_nonzero(np.diff(enable, axis=0)))
        if not run.stopped:
            return Numbers(number, math.inf, math.inf, switchings)
        return Numbers(number, run.orientation_change, run.stopping_distance, switchings)

    def collected(self, rows: Sequence[Numbers]) -> tuple[TuningTrial, ...]:
        """Return a trial for each of the `pairs`, from the results of all runs."""
        table = np.array([row[1:] for row in rows]).reshape(-1, len(self.bases), 3)
        return tuple(
            TuningTrial(*pair, *numbers.T) for pair, numbers in zip(self.pairs, table, strict=True)
        )


def front(trials: Iterable[TuningTrial]) -> tuple[TuningTrial, ...]:
    """Return the trials on the Pareto front of worst rotation and worst distance.

    Returns:
        Trials sorted by distance, with decreasing rotation; trials in which the vehicle does not
        stop are omitted.
    """
    best: list[TuningTrial] = []
    for trial in sorted(trials, key=lambda t: (t.worst_distance, t.worst_rotation)):
        stops = math.isfinite(trial.worst_distance)
        if stops and (not best or trial.worst_rotation < best[-1].worst_rotation):
            best.append(trial)
    return tuple(best)


def distance_at(trials: Iterable[TuningTrial], rotation: float) -> float:
    """Return the stopping distance for a limit on the change of orientation.

    Args:
        trials: trials whose Pareto front is interpolated linearly between settings.
        rotation: limit on the change of orientation [deg].

    Returns:
        Stopping distance [m], NaN if every setting rotates more.
    """
    best = front(trials)[::-1]
    if not best or best[0].worst_rotation > rotation:
        return math.nan
    rotations = [trial.worst_rotation for trial in best]
    return float(np.interp(rotation, rotations, [trial.worst_distance for trial in best]))


def recommended(
    trials: Sequence[TuningTrial],
    max_rotation: float | None,
    max_distance: float | None,
    equal: float = 0.01,
) -> tuple[TuningTrial | None, str]:
    """Choose a setting that meets the limits in every situation.

    If the rotation is limited, the setting with the shortest stop is chosen, otherwise the setting
    with the smallest rotation. Among settings that are about equally good, the one with the fewest
    switching operations is chosen.

    Args:
        trials: trials to choose from, at least one.
        max_rotation: limit on the change of orientation [deg].
        max_distance: limit on the stopping distance [m].
        equal: relative difference up to which settings count as equally good [1].

    Returns:
        The chosen trial (None if no setting meets the limits), and a sentence that describes it.
    """
    rotation, distance = max_rotation or math.inf, max_distance or math.inf

    def excess(trial: TuningTrial) -> float:
        return max(trial.worst_rotation / rotation, trial.worst_distance / distance)

    def price(trial: TuningTrial) -> float:
        return trial.worst_rotation if max_rotation is None else trial.worst_distance

    words = (
        ("an orientation change", max_rotation, "deg"),
        ("a stopping distance", max_distance, "m"),
    )
    limits = " and ".join(
        f"{quantity} of at most {limit:g} {unit}" for quantity, limit, unit in words if limit
    )
    stopping = [trial for trial in trials if math.isfinite(trial.worst_distance)]
    if not stopping:
        return None, f"No setting meets the limit ({limits}): the vehicle never stops."
    allowed = [trial for trial in stopping if excess(trial) <= 1.0]
    if not allowed:
        nearest = min(front(stopping), key=excess)
        return None, (
            f"No setting meets the limit ({limits}); the nearest setting, "
            f"{' '.join(nearest.setting.overrides)}, has {_numbers(nearest)}."
        )
    bound = (1.0 + equal) * min(map(price, allowed))
    choice = min(
        (trial for trial in allowed if price(trial) <= bound),
        key=lambda trial: (float(np.mean(trial.switchings)), price(trial)),
    )
    return choice, (
        f"For {limits}: {' '.join(choice.setting.overrides)}; at worst {_numbers(choice)}."
    )


def _numbers(trial: TuningTrial) -> str:
    return f"{trial.worst_rotation:.1f} deg and {trial.worst_distance:.2f} m"
