"""Comparison of the control laws: chapter 3, directions of travel, and unknown conditions.

Feedback is ideal unless the case states otherwise. A case is ``<experiment>_<law>_<brakes>``.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from matplotlib.figure import Figure

from omni_figures import style
from omni_loop.compiled import run_fast_loop
from omni_loop.experiment import ExperimentLibrary
from omni_loop.loop import run_closed_loop
from omni_loop.metrics import Metric, run_metrics
from omni_platform.brakes import typical_changes
from omni_platform.configuration import ConfigurationError, parameter
from omni_studies.campaign import law_trials
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions, digest
from omni_tools.limit.bounds import any_heading_bound, maneuver_of, straight_bound
from omni_tools.limit.front import IDEAL

_SENSOR = ("feedback=velocity_sensor",)
_ALLOCATION = ("brake_assist.law=allocation",)
_PROPORTIONAL = "vehicle.brake.kind=proportional"
_LAG = (_PROPORTIONAL, "vehicle.brake.dead_time=0.02", "vehicle.brake.time_constant=0.05")

# Limits of distance [m] and of the change of orientation [deg].
_TARGETS = {
    "straight_line_allocation_proportional": (9.0, 0.7),
    "straight_line_allocation_optical": (9.2, 1.0),
    "straight_line_allocation_on_off": (10.0, 2.5),
    "straight_line_allocation_lag": (10.2, 2.0),
}
_VARIANTS = {
    "straight_line": ("assisted",),
    "three_wheel_diagonal": ("assisted",),
    "ice_patch": ("assisted",),
    "turn_while_translate": ("zero", "cosine", "k1", "k7"),
}
_ROTATIONS = (0.5, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 46.0)
_NEVER = (1.05, 5.0)  # of unknown conditions: distance over unassisted [1], rotation [deg]
# Changes of the vehicle and ground; the assistant is configured only with kind and lag of the
# brakes.
_UNKNOWN: Mapping[str, tuple[str, ...]] = {
    **{f"damping_{d}": (f"vehicle.tire.damping={d}",) for d in (0, 50, 500, 20000)},
    **{f"stiffness_{c}": (f"vehicle.tire.stiffness={c}",) for c in (50000, 1000000)},
    **{
        f"brake_torque_{t}": (f"vehicle.brake.max_torque={t}", "brake_assist.brake.max_torque=1500")
        for t in (1100, 2000)
    },
    **{f"dead_time_{ms}_ms": (f"vehicle.brake.dead_time={ms / 1000}",) for ms in (5, 20, 50)},
    **{f"lag_{ms}_ms": (f"vehicle.brake.time_constant={ms / 1000}",) for ms in (10, 50, 100)},
    **{f"sensor_hold_{ms}_ms": (f"velocity_sensor.sample_time={ms / 1000}",) for ms in (20, 50)},
    **{
        f"noise_{share}_percent": (
            f"velocity_sensor.linear_noise={share / 100}",
            f"velocity_sensor.yaw_rate_noise={share / 100}",
            "brake_assist.maximum_speed_deviation=1.0",
            "brake_assist.speed_noise=3.0",
        )
        for share in (2, 5, 15)
    },
    **{
        f"wheel_inertia_{i}": (f"vehicle.wheel_inertia={i}", "brake_assist.wheel_inertia=0.5")
        for i in (0.25, 1.0)
    },
    **{f"nominal_mass_{m}": (f"brake_assist.nominal_mass={m}",) for m in (600, 2500)},
    "friction_0.5": ("ground.friction=0.5",),
    "rollers": ("vehicle.wheel_model=rollers",),
    "brakes_spring": typical_changes("spring"),
    "brakes_torque": (*typical_changes("torque"), "vehicle.brake.max_power=15000"),
    **{
        f"brakes_velocity_{ramp}": (*typical_changes("velocity"), f"vehicle.brake.ramp={ramp}")
        for ramp in (2, 4, 8)
    },
}
_COMPARED: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("unassisted", "unassisted", ()),
    ("sliding_mode_on_off", "assisted", ()),
    ("allocation_proportional", "assisted", (*_ALLOCATION, _PROPORTIONAL)),
)
_BOUNDS = {"bound": straight_bound, "bound_any_heading": any_heading_bound}


class Options(CampaignOptions):
    """Runs, and workers."""

    without_optical: bool = parameter(False)
    """leave out the stop on the line cameras, which takes longest"""
    law: tuple[str, ...] = parameter(())
    """your own law, as module:Class, compared with the built-in ones on every experiment"""
    random: int = parameter(0, minimum=0, maximum=10**6)
    """run this many random stops in place of the experiments and compare every --law with the first
    one (default: allocation alone)"""
    seed: int = parameter(0, minimum=0)
    """seed of the first random stop"""
    ablate: bool = parameter(False)
    """set each parameter of the law allocation to half, double and neutral on two independent sets
    of --random stops"""

    def check_consistency(self) -> None:
        """Refuse an ablation without random stops or with laws.

        Raises:
            ConfigurationError: there are no random stops, or laws are named.
        """
        super().check_consistency()
        if self.ablate and (not self.random or self.law):
            raise ConfigurationError("--ablate", "needs --random N, and no --law")


class _Case(NamedTuple):
    """A run with experiment, variant and overrides, or a bound of such runs."""

    experiment: str
    variant: str
    changes: tuple[str, ...]
    bound: str = ""


class LawStop(NamedTuple):
    """Result of a case.

    Attributes:
        seed: number of the case.
        case: its name.
        distance: stopping distance, or its bound [m].
        rotation: change of orientation [deg], NaN for a bound.
        note: why a number is missing, or the tolerance of a bound.
    """

    seed: int
    case: str
    distance: float
    rotation: float
    note: str


def _cases(library: ExperimentLibrary, options: Options) -> Iterator[tuple[str, _Case]]:
    """Yield all cases by name."""
    if not options.without_optical:  # first, as it takes longest
        optical = (*_ALLOCATION, _PROPORTIONAL, "feedback=optical")
        yield "straight_line_allocation_optical", _Case("straight_line", "assisted", optical)
    for name, variants in _VARIANTS.items():
        yield f"{name}_unassisted", _Case(name, "unassisted", IDEAL)
        for variant in variants:
            words = "sliding_mode" if variant == "assisted" else f"sliding_mode_{variant}"
            yield f"{name}_{words}_on_off", _Case(name, variant, IDEAL)
        base = library.variants(name)[-1]
        law = (*IDEAL, *_ALLOCATION)
        yield f"{name}_allocation_proportional", _Case(name, base, (*law, _PROPORTIONAL))
        yield f"{name}_allocation_on_off", _Case(name, base, law)
        yield f"{name}_allocation_lag", _Case(name, base, (*law, *_LAG))
        for other in options.law:
            own = (*IDEAL, f"brake_assist.law={other}")
            yield f"{name}_{_label(other)}_on_off", _Case(name, base, own)
            yield f"{name}_{_label(other)}_proportional", _Case(name, base, (*own, _PROPORTIONAL))
        yield from _bounds(name, name, IDEAL)
    noisy = (*_SENSOR, *_ALLOCATION, _PROPORTIONAL)
    yield "ice_patch_noisy_sliding_mode_on_off", _Case("ice_patch_noisy", "noisy", _SENSOR)
    yield "ice_patch_noisy_allocation_proportional", _Case("ice_patch_noisy", "noisy", noisy)
    for rotation in _ROTATIONS:  # allowed in the turn of Table 2
        spent = (*IDEAL, *_ALLOCATION, _PROPORTIONAL, f"brake_assist.max_rotation={rotation}")
        name = f"turn_while_translate_allocation_proportional_{rotation:g}_deg"
        yield name, _Case("turn_while_translate", "k7", spent)
    for word, changes in _UNKNOWN.items():
        for kind, variant, settings in (*_COMPARED, ("allocation_on_off", "assisted", _ALLOCATION)):
            case = _Case("straight_line", variant, (*IDEAL, *settings, *changes))
            yield f"straight_line_{kind}_{word}", case
    for direction in range(0, 181, 15):
        moving = (*IDEAL, f"maneuver.direction_deg={direction}")
        name = f"straight_line_{direction}_deg"
        yield from _bounds(name, "straight_line", moving)
        for kind, variant, settings in _COMPARED:
            yield f"{name}_{kind}", _Case("straight_line", variant, (*moving, *settings))


def _bounds(name: str, experiment: str, changes: tuple[str, ...]) -> Iterator[tuple[str, _Case]]:
    for bound in _BOUNDS:
        yield f"{name}_{bound}", _Case(experiment, "unassisted", changes, bound)


def _label(law: str) -> str:
    return law.rpartition(":")[2]


class LawStops:
    """Runs one case after the other; sent to the workers."""

    def __init__(self, library: ExperimentLibrary, cases: Iterable[tuple[str, _Case]]) -> None:
        """Store the cases.

        Args:
            library: where the experiments are.
            cases: cases by name; the number of a case is its index.
        """
        self._library = library
        self._cases = tuple(cases)

    def __len__(self) -> int:
        return len(self._cases)

    @property
    def fingerprint(self) -> str:
        """Digest of the cases and of their experiments."""
        used = sorted({(case.experiment, case.variant) for _, case in self._cases})
        return digest(self._cases, [self._library.load(*names) for names in used])

    def __call__(self, number: int) -> LawStop:
        """Run a case."""
        name, case = self._cases[number]
        experiment = self._library.load(case.experiment, case.variant, case.changes)
        if case.bound:
            maneuver = maneuver_of(experiment.maneuver)
            found = _BOUNDS[case.bound](experiment.vehicle, experiment.ground, maneuver)
            note = found.reason or f"with a tolerance of {1e3 * found.tolerance:.0f} mm"
            return LawStop(number, name, found.distance, math.nan, note)
        optical = experiment.feedback == "optical"
        history = run_closed_loop(experiment) if optical else run_fast_loop(experiment).history()
        metrics = run_metrics(history)
        distance, turned = metrics["stopping_distance"], metrics["orientation_change"]
        return LawStop(number, name, distance.value, turned.value, distance.note or turned.note)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run every case, compare the numbers with targets and bounds, and draw them."""
    for law in options.law:  # refused before anything runs
        changes = (f"brake_assist.law={law.partition('@')[0]}",)
        study.experiments.load("straight_line", "assisted", changes).check_drivable()
    if options.random:
        return _run_random(options, study)
    work = LawStops(study.experiments, _cases(study.experiments, options))
    stops = study.campaign(work, range(len(work)), LawStop, options, work.fingerprint)
    metrics = _metrics(stops)
    study.columns("laws.csv", _columns(metrics))
    if len(stops) < len(work):
        return study.result(metrics, f"{len(stops)} of {len(work)} cases were run.")
    study.figure("laws.png", _front(metrics, options.law))
    return study.result(metrics, *_findings(metrics))


def _run_random(options: Options, study: StudyRun) -> StudyResult:
    """Compare the laws on random stops."""
    if options.ablate:
        laws = law_trials.ablations()
    else:
        given = options.law or ("allocation",)
        labels = [_label(law) for law in given]
        laws = dict(zip(labels if len(set(labels)) == len(given) else given, given, strict=True))
    work = law_trials.LawTrials(study.experiments, tuple(laws.values()), options.seed)
    numbers = range((1 + options.ablate) * options.random * len(work.cases))
    row = law_trials.LawTrial
    trials = study.campaign(work, numbers, row, options, work.fingerprint, "trials.csv")
    if len(trials) < len(numbers):
        return study.result({}, f"{len(trials)} of {len(numbers)} stops were run.")
    if not options.ablate:
        return study.result(law_trials.compare(trials, tuple(laws)))
    costs = law_trials.ablation_costs(trials, tuple(laws))
    words = ", ".join(law_trials.unpaid(costs)) or "none"
    return study.result(costs, f"Parameters that do not pay in both sets: {words}.")


def _metrics(stops: Sequence[LawStop]) -> dict[str, Metric]:
    limits = dict(_TARGETS)
    distances = {stop.case: stop.distance for stop in stops}
    for word in _UNKNOWN:
        free = distances.get(f"straight_line_unassisted_{word}", math.nan)
        for law in ("allocation_proportional", "allocation_on_off"):
            limits[f"straight_line_{law}_{word}"] = (_NEVER[0] * free, _NEVER[1])
    metrics: dict[str, Metric] = {}
    for stop in stops:
        longest, most = limits.get(stop.case, (None, None))
        metrics[f"stopping_distance.{stop.case}"] = Metric(
            stop.distance, "m", at_most=longest, note=stop.note
        )
        if not stop.case.endswith(tuple(_BOUNDS)):
            metrics[f"orientation_change.{stop.case}"] = Metric(
                stop.rotation, "deg", at_most=most, note=stop.note
            )
    return metrics


def _columns(metrics: Mapping[str, Metric]) -> dict[str, list[str] | list[float]]:
    names = [key.partition(".")[2] for key in metrics if key.startswith("stopping_distance.")]
    turned = [metrics.get(f"orientation_change.{name}") for name in names]
    return {
        "case": names,
        "stopping distance [m]": [metrics[f"stopping_distance.{name}"].value for name in names],
        "bound [m]": [_bound(metrics, name) for name in names],
        "orientation change [deg]": [math.nan if m is None else m.value for m in turned],
    }


def _bound(metrics: Mapping[str, Metric], case: str) -> float:
    """Return the bound of the stop of a case if it keeps its heading, NaN if there is none [m]."""
    for law in ("_unassisted", "_sliding_mode", "_allocation"):
        maneuver, found, change = case.partition(law)
        bound = metrics.get(f"stopping_distance.{maneuver}_bound")
        if found and bound and not any(word in change for word in _UNKNOWN):
            return bound.value
    return math.nan


def _front(metrics: Mapping[str, Metric], own: Sequence[str]) -> Figure:
    """Draw distance against rotation for every experiment, with the bound that keeps heading."""
    title = "Distance against rotation under every law"
    x = "stopping distance [m]"
    figure, grid = style.panels(title, 2, 2, size=(9.0, 6.4), x=x, y="orientation change [deg]")
    for axes, name in zip(grid.flat, _VARIANTS, strict=True):
        axes.set_title(name.replace("_", " "), loc="left")
        bound = metrics[f"stopping_distance.{name}_bound"].value
        if math.isfinite(bound):
            axes.axvline(bound, color=style.GRAY, linestyle="--", label="bound, heading kept")
        for words, color, part in (
            ("all brakes on", style.BLACK, "_unassisted"),
            ("sliding mode", style.BLUE, "_sliding_mode"),
            ("allocation, on-off valves", style.GREEN, "_allocation_on_off"),
            ("allocation, proportional", style.VERMILLION, "_allocation_proportional"),
            *((_label(law), style.PURPLE, f"_{_label(law)}") for law in own),
        ):
            cases = [
                case
                for key in metrics
                for quantity, _, case in (key.partition("."),)
                if quantity == "orientation_change" and case.startswith(name + part)
                if not any(word in case[len(name + part) :] for word in _UNKNOWN)
            ]
            distances, rotations = (
                [metrics[f"{quantity}.{case}"].value for case in cases]
                for quantity in ("stopping_distance", "orientation_change")
            )
            axes.plot(distances, rotations, "o", color=color, label=words)
    grid[0, 0].legend()
    return figure


def _findings(metrics: Mapping[str, Metric]) -> tuple[str, ...]:
    limited = {name: m for name, m in metrics.items() if m.status}
    missed = [n for n, m in limited.items() if m.status == "missed"]
    sentences = [f"{len(limited) - len(missed)} of {len(limited)} targets are met."]
    if missed:
        sentences.append(f"Missed: {', '.join(missed)}.")
    distance = metrics["stopping_distance.straight_line_allocation_proportional"].value
    bound = metrics["stopping_distance.straight_line_bound"]
    sentences.append(
        f"Proportional brakes stop straight_line in {distance:.2f} m; no stop that keeps its "
        f"heading is shorter than {bound.value:.2f} m, {bound.note}."
    )
    shorter = [
        f"{case.removesuffix('_unassisted')} ({metric.value:.2f} m, bound {bound:.2f} m)"
        for key, metric in metrics.items()
        for quantity, _, case in (key.partition("."),)
        if quantity == "stopping_distance" and case.endswith("_unassisted")
        for bound in (_bound(metrics, case),)
        if metric.value < bound
    ]
    sentences.append(
        "With all brakes on the stop is shorter than any that keeps its heading: "
        f"{', '.join(shorter) or 'nowhere'}."
    )
    return tuple(sentences)
