"""Random stops that compare control laws on proportional and on on-off brakes.

As in the robustness campaign, a seed determines vehicle, load, ground, motion and sensor noise, but
there are no sensor faults. The seed also determines whether the brakes have a lag, and whether the
law is informed of this lag. The torque, mass and wheel inertia that the law assumes have random
errors.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from omni_brake_assist.configuration import AllocationConfiguration
from omni_core.brakes import ON_OFF, PROPORTIONAL
from omni_core.quantities import FloatArray
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary, changed
from omni_runs.metrics import Metric
from omni_studies.campaign.random_braking import ALLOWED, RandomBraking, draw, without

_KINDS = (PROPORTIONAL, ON_OFF)
_ALL_ON = ""  # name of the case with all brakes on
_LARGEST_DEAD_TIME, _LARGEST_TIME_CONSTANT = 0.05, 0.1  # limits of the drawn brake lag [s]
_LARGEST_ERROR = 1.6  # limit on the factor by which assumed torque, mass or inertia are wrong [1]
_SETS = ("first", "second")  # independent sets of stops of an ablation

NEUTRAL = {
    "target_slip": 1.0,
    "observer_time": 0.001,
    "relaxation_speed": 0.0,
    "return_share": 10.0,
    "deviation_weight": 0.0,
    "locked_share": 0.0,
}
"""Values of fields of `AllocationConfiguration` that disable the filter, limit or cost to which the
field belongs."""


class LawTrial(NamedTuple):
    """Result of one stop with one law and one kind of brakes.

    Attributes:
        seed: number of the trial. Each seed of the random draws has one trial for each of
            `LawTrials.cases`.
        distance: stopping distance [m].
        rotation: change of orientation while braking [deg].
        stopped: whether the vehicle came to rest, 0 or 1.
    """

    seed: int
    distance: float
    rotation: float
    stopped: int


class LawTrials:
    """Callable that runs the trial with a given number; worker processes receive an instance.

    Args:
        library: library that contains the vehicle files.
        laws: names of the laws to compare; each seed is also run with all brakes on.
        first: first seed of the draws.
    """

    def __init__(self, library: ExperimentLibrary, laws: Sequence[str], first: int) -> None:
        self._braking = RandomBraking(library)
        self._first = first
        self.cases = tuple((kind, law) for kind in _KINDS for law in (_ALL_ON, *laws))

    @property
    def fingerprint(self) -> str:
        """Digest of all settings that determine the runs."""
        return "-".join((self._braking.fingerprint, str(self._first), *map(str, self.cases)))

    def __call__(self, number: int) -> LawTrial:
        """Run the trial with this number, and return the result."""
        seed, case = divmod(number, len(self.cases))
        run = run_fast_loop(self.configuration(self._first + seed, *self.cases[case]))
        return LawTrial(number, run.stopping_distance, run.orientation_change, int(run.stopped))

    def configuration(self, seed: int, kind: str, law: str) -> ExperimentConfiguration:
        """Return the experiment drawn with a seed, with given brakes and law.

        Args:
            seed: seed of the random draws.
            kind: kind of brakes, `PROPORTIONAL` or `ON_OFF`.
            law: name of the law, empty for all brakes on; ``allocation@field=value`` is
                `allocation` with one changed parameter of `AllocationConfiguration`.
        """
        law, _, change = law.partition("@")
        variant = "assisted" if law else "unassisted"
        base = self._braking.configurations(without(draw(seed), "failure"))[variant]
        random = np.random.default_rng([seed, 1])
        lag = str(random.choice(["none", "nominal", "unmodeled"]))
        dead_time = float(random.uniform(0.0, _LARGEST_DEAD_TIME))
        time_constant = float(random.uniform(0.0, _LARGEST_TIME_CONSTANT))
        torque, mass, inertia = _LARGEST_ERROR ** random.uniform(-1.0, 1.0, 3)
        brake = dataclasses.replace(base.vehicle.brake, kind=kind)
        lagging = dataclasses.replace(brake, dead_time=dead_time, time_constant=time_constant)
        nominal = lagging if lag == "nominal" else brake
        assist = base.brake_assist
        field, _, value = change.partition("=")
        assumed = {
            "allocation": {field: float(value)} if change else {},
            "law": law or assist.law,
            "brake": dataclasses.replace(nominal, max_torque=brake.max_torque * torque),
            "nominal_mass": assist.nominal_mass * mass,
            "wheel_inertia": assist.wheel_inertia * inertia,
        }
        true = {"brake": brake if lag == "none" else lagging}
        return changed(base, vehicle=true, brake_assist=assumed)


def ablations() -> dict[str, str]:
    """Return variants of the law `allocation` that differ in one parameter, keyed by label.

    The parameter is halved, doubled or disabled. The values are names of laws as in
    `LawTrials.configuration`.
    """
    laws = {"allocation": "allocation"}
    for field, neutral in NEUTRAL.items():
        value = getattr(AllocationConfiguration(), field)
        for word, other in (("half", 0.5 * value), ("double", 2.0 * value), ("neutral", neutral)):
            laws[f"{field}_{word}"] = f"allocation@{field}={other:g}"
    return laws


def ablation_costs(trials: Sequence[LawTrial], laws: Sequence[str]) -> dict[str, Metric]:
    """Return how much each law changes distance and rotation compared with the first law.

    The trials are divided into two equal sets. The changes of each set are metrics, keyed by name;
    a name ends with the name of the set.

    Args:
        trials: all trials of an even number of seeds, in the order of `LawTrials`.
        laws: names of the laws.
    """
    middle = len(trials) // 2
    metrics: dict[str, Metric] = {}
    for name, part in zip(_SETS, (trials[:middle], trials[middle:]), strict=True):
        found = compare(part, laws)
        metrics |= {f"{key}_{name}": m for key, m in found.items() if "_change" in key}
    return metrics


def removable(metrics: Mapping[str, Metric]) -> list[str]:
    """Return the parameters that could be removed from the law `allocation`.

    A parameter is needed if disabling it significantly increases the distance or the rotation in
    both sets of stops, on either kind of brakes. `metrics` are those of `ablation_costs`.
    """

    def worse(key: str) -> bool:
        return metrics[key].value > 2.0 * metrics[key.replace("_change", "_change_error")].value

    return [
        field
        for field in NEUTRAL
        if not any(
            all(worse(f"{quantity}_change.{field}_neutral_{kind}_{name}") for name in _SETS)
            for quantity in ("distance", "rotation")
            for kind in _KINDS
        )
    ]


def compare(trials: Sequence[LawTrial], laws: Sequence[str]) -> dict[str, Metric]:
    """Return metrics that compare every law with unassisted braking and with the first law.

    The metrics are keyed by name.

    Args:
        trials: all trials of each seed, in the order of `LawTrials`.
        laws: names of the laws.
    """
    shape = -1, len(_KINDS), 1 + len(laws)
    distance, rotation, stopped = (
        np.reshape([getattr(trial, name) for trial in trials], shape)
        for name in ("distance", "rotation", "stopped")
    )
    distance = np.maximum(distance, ALLOWED.shortest)
    metrics: dict[str, Metric] = {}
    for k, kind in enumerate(_KINDS):
        free = distance[:, k, 0]
        for j, law in enumerate(laws, start=1):
            ratio = distance[:, k, j] / free
            turned = rotation[:, k, j] - rotation[:, k, 0]
            broken = (ratio > ALLOWED.distance) | (turned > ALLOWED.orientation)
            broken |= stopped[:, k, j] < stopped[:, k, 0]
            found = {
                "median_ratio": Metric(float(np.median(ratio)), "1"),
                "p95_ratio": Metric(float(np.quantile(ratio, 0.95)), "1"),
                "worst_ratio": Metric(float(np.max(ratio)), "1"),
                "extra_rotation": Metric(float(np.max(turned)), "deg"),
                "violations": Metric(float(np.sum(broken)), "1"),
            }
            if j > 1:
                longer: FloatArray = 100.0 * (distance[:, k, j] / distance[:, k, 1] - 1.0)
                turning: FloatArray = rotation[:, k, j] - rotation[:, k, 1]
                for name, change, unit in (("distance", longer, "%"), ("rotation", turning, "deg")):
                    error = float(np.std(change)) / math.sqrt(max(change.size - 1, 1))
                    found[f"{name}_change"] = Metric(float(np.mean(change)), unit)
                    found[f"{name}_change_error"] = Metric(error, unit)
            metrics |= {f"{name}.{law}_{kind}": metric for name, metric in found.items()}
    return metrics
