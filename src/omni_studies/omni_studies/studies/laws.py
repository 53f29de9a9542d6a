"""Comparison of the control laws with each other and with the shortest possible stops.

In ``laws``, the feedback is ideal unless the case states otherwise. A case is named
``<maneuver>_<law>``, where the law includes the kind of the brakes; a condition may follow.

In ``bounds``, random stops are compared with two lower bounds. The path length of the center of
gravity is compared with the bound for all stops, whatever their heading. If a stop keeps heading
and line within half a degree, its distance is also compared with the bound for such stops.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from omni_core.brakes import typical_changes
from omni_core.configuration import ConfigurationError, parameter
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.figures import style
from omni_runs.limit.bounds import any_heading_bound, maneuver_of, straight_bound
from omni_runs.loop import run_closed_loop
from omni_runs.metrics import Metric, run_metrics
from omni_studies.campaign import law_trials
from omni_studies.campaign.bound_trials import LAWS, BoundTrial, BoundTrials, below, over_bound
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions, digest
from omni_tools.limit.front import IDEAL

CASES = {
    "laws": "Comparison of the control laws: stops of chapter 3, other directions, unknown "
    "conditions",
    "bounds": "Comparison of random stops under each control law with lower bounds of the distance",
}

_SENSOR = ("feedback=velocity_sensor",)
_ALLOCATION = ("brake_assist.law=allocation",)
_PROPORTIONAL = "vehicle.brake.kind=proportional"
_LAG = (_PROPORTIONAL, "vehicle.brake.dead_time=0.02", "vehicle.brake.time_constant=0.05")

_VARIANTS = {
    "straight_line": ("assisted",),
    "three_wheel_diagonal": ("assisted",),
    "ice_patch": ("assisted",),
    "turn_while_translate": ("zero", "cosine", "k1", "k7"),
}
_ROTATIONS = (0.5, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 46.0)
_NEVER = (
    1.05,
    5.0,
)  # limits in unknown conditions: ratio to the unassisted distance [1], rotation [deg]
# Changes of vehicle, sensors, ground, pedal and initial speed. The assistant's parameters do not
# follow the changes of vehicle and ground, with one exception: kind and timing of the brakes, their
# power and their ramp.
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
    **{f"pedal_{p}_percent": (f"maneuver.pedal={p / 100}",) for p in (20, 30, 50)},
    **{f"speed_{v}": (f"maneuver.speed={v}",) for v in (1, 2, 3, 4)},
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
    """Options of the study ``laws``: laws, random stops, and worker processes."""

    without_optical: bool = parameter(False)
    """omit the stop with line cameras, which takes the longest time"""
    law: tuple[str, ...] = parameter(())
    """your own law as `my_module:MyLaw`, which is compared with the built-in laws in every
    experiment"""
    random: int = parameter(0, minimum=0, maximum=10**6)
    """number of random stops to run instead of the experiments, under each --law (without --law:
    under allocation); further laws are compared with the first one"""
    seed: int = parameter(0, minimum=0)
    """seed of the first random stop"""
    ablate: bool = parameter(False)
    """set each parameter of the law `allocation` to half its default, twice its default and a
    neutral value, on two independent sets of --random stops"""

    def check_consistency(self) -> None:
        """Check that an ablation has random stops and names no laws.

        Raises:
            ConfigurationError: there are no random stops, or laws are named.
        """
        super().check_consistency()
        if self.ablate and (not self.random or self.law):
            raise ConfigurationError("--ablate", "needs --random N, and no --law")


class _Bounds(CampaignOptions):
    """Options of the study ``bounds``: number of runs, first seed, and worker processes."""

    runs: int = parameter(10_000, minimum=4, maximum=10**7)
    """number of runs; each random stop is run under four laws"""
    seed: int = parameter(0, minimum=0)
    """seed of the first stop; the seeds of the other stops follow it"""


OPTIONS = {"bounds": _Bounds}


class _Case(NamedTuple):
    """A run with a given experiment, variant and overrides, or a bound for such runs."""

    maneuver: str
    law: str
    experiment: str
    variant: str
    changes: tuple[str, ...]
    condition: str = ""

    @property
    def name(self) -> str:
        """Name in metrics and tables: maneuver, law or bound, and any condition."""
        return "_".join(filter(None, (self.maneuver, self.law, self.condition)))


class LawStop(NamedTuple):
    """Result of the stop, or the bound, of one case.

    Attributes:
        seed: number of the case.
        case: name of the case.
        distance: stopping distance, or its bound [m].
        rotation: change of orientation [deg], NaN for a bound.
        note: reason why a number is missing, or tolerance of a bound.
    """

    seed: int
    case: str
    distance: float
    rotation: float
    note: str


class LawStops:
    """Callable that simulates the case with a given index; worker processes receive an instance."""

    def __init__(self, library: ExperimentLibrary, cases: Iterable[_Case]) -> None:
        """Create the callable for a list of cases.

        Args:
            library: library that contains the experiment files.
            cases: cases to run; the number of a case is its index.
        """
        self._library = library
        self.cases = tuple(cases)

    @property
    def fingerprint(self) -> str:
        """Digest of the cases and their experiments."""
        used = sorted({(case.experiment, case.variant) for case in self.cases})
        return digest(self.cases, [self._library.load(*names) for names in used])

    def __call__(self, number: int) -> LawStop:
        """Run the case with this index."""
        case = self.cases[number]
        experiment = self._library.load(case.experiment, case.variant, case.changes)
        if case.law in _BOUNDS:
            maneuver = maneuver_of(experiment.maneuver)
            found = _BOUNDS[case.law](experiment.vehicle, experiment.ground, maneuver)
            note = found.reason or f"with a tolerance of {1e3 * found.tolerance:.0f} mm"
            return LawStop(number, case.name, found.distance, math.nan, note)
        optical = experiment.feedback == "optical"
        history = run_closed_loop(experiment) if optical else run_fast_loop(experiment)
        metrics = run_metrics(history)
        distance, turned = metrics["stopping_distance"], metrics["orientation_change"]
        return LawStop(
            number, case.name, distance.value, turned.value, distance.note or turned.note
        )


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run all cases, compare the results with targets and bounds, and draw them."""
    for law in options.law:  # raises an error before anything runs
        changes = (f"brake_assist.law={law.partition('@')[0]}",)
        study.experiments.load("straight_line", "assisted", changes).check_drivable()
    if options.random:
        return _run_random(options, study)
    work = LawStops(study.experiments, _cases(study.experiments, options))
    numbers = range(len(work.cases))
    stops = study.campaign(work, numbers, LawStop, options, work.fingerprint)
    results = [(work.cases[stop.seed], stop) for stop in stops]
    metrics = _metrics(results)
    if len(stops) < len(numbers):
        return study.result(metrics, f"{len(stops)} of {len(numbers)} cases were run.")
    study.figure("laws.png", _front(results, options.law))
    return study.result(metrics, *_findings(results))


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
    words = ", ".join(law_trials.removable(costs)) or "none"
    return study.result(costs, f"Parameters without a benefit in both sets: {words}.")


def _label(law: str) -> str:
    return law.rpartition(":")[2]


def _cases(library: ExperimentLibrary, options: Options) -> Iterator[_Case]:
    """Yield all cases of the study."""
    straight = "straight_line"
    if not options.without_optical:  # first, because these runs take the longest time
        optical = (*_ALLOCATION, _PROPORTIONAL, "feedback=optical")
        yield _Case(straight, "allocation_optical", straight, "assisted", optical)
    for name, variants in _VARIANTS.items():
        yield _Case(name, "unassisted", name, "unassisted", IDEAL)
        for variant in variants:
            words = "sliding_mode" if variant == "assisted" else f"sliding_mode_{variant}"
            yield _Case(name, f"{words}_on_off", name, variant, IDEAL)
        base = library.variants(name)[-1]
        brakes = {"proportional": (_PROPORTIONAL,), "on_off": (), "lag": _LAG}
        for kind, changes in brakes.items():
            law = (*IDEAL, *_ALLOCATION, *changes)
            yield _Case(name, f"allocation_{kind}", name, base, law)
        for other in options.law:
            for kind in ("on_off", "proportional"):
                law = (*IDEAL, f"brake_assist.law={other}", *brakes[kind])
                yield _Case(name, f"{_label(other)}_{kind}", name, base, law)
        yield from _bounds(name, name, IDEAL)
    noisy = (*_SENSOR, *_ALLOCATION, _PROPORTIONAL)
    patch = "ice_patch_noisy"
    yield _Case(patch, "sliding_mode_on_off", patch, "noisy", _SENSOR)
    yield _Case(patch, "allocation_proportional", patch, "noisy", noisy)
    turn = "turn_while_translate"
    for rotation in _ROTATIONS:  # limits on the rotation in the turn of Table 2
        spent = (*IDEAL, *_ALLOCATION, _PROPORTIONAL, f"brake_assist.max_rotation={rotation}")
        yield _Case(turn, "allocation_proportional", turn, "k7", spent, f"{rotation:g}_deg")
    for word, changes in _UNKNOWN.items():
        for kind, variant, settings in (*_COMPARED, ("allocation_on_off", "assisted", _ALLOCATION)):
            yield _Case(straight, kind, straight, variant, (*IDEAL, *settings, *changes), word)
    for direction in range(0, 181, 15):
        moving = (*IDEAL, f"maneuver.direction_deg={direction}")
        name = f"straight_line_{direction}_deg"
        yield from _bounds(name, straight, moving)
        for kind, variant, settings in _COMPARED:
            yield _Case(name, kind, straight, variant, (*moving, *settings))


def _bounds(maneuver: str, experiment: str, changes: tuple[str, ...]) -> Iterator[_Case]:
    for bound in _BOUNDS:
        yield _Case(maneuver, bound, experiment, "unassisted", changes)


Results = Sequence[tuple[_Case, LawStop]]


def _metrics(results: Results) -> dict[str, Metric]:
    free = {case.condition: stop.distance for case, stop in results if case.law == "unassisted"}
    metrics: dict[str, Metric] = {}
    for case, stop in results:
        longest, most = None, None
        if case.condition in _UNKNOWN and case.law.startswith("allocation"):
            longest, most = _NEVER[0] * free.get(case.condition, math.nan), _NEVER[1]
        metrics[f"stopping_distance.{case.name}"] = Metric(
            stop.distance, "m", at_most=longest, note=stop.note
        )
        if case.law not in _BOUNDS:
            metrics[f"orientation_change.{case.name}"] = Metric(
                stop.rotation, "deg", at_most=most, note=stop.note
            )
    return metrics


def _front(results: Results, own: Sequence[str]) -> Figure:
    """Draw rotation versus distance of all laws, and the bound, in one panel per experiment."""
    title = "Distance against rotation under every law"
    x = "stopping distance [m]"
    figure, grid = style.panels(title, 2, 2, size=(9.0, 6.4), x=x, y="orientation change [deg]")
    for axes, name in zip(grid.flat, _VARIANTS, strict=True):
        axes.set_title(name.replace("_", " "), loc="left")
        here = [
            (case.law, stop)
            for case, stop in results
            if case.maneuver == name and case.condition not in _UNKNOWN
        ]
        bound = dict(here)["bound"].distance
        if math.isfinite(bound):
            axes.axvline(bound, color=style.GRAY, linestyle="--", label="bound, heading kept")
        for words, color, law in (
            ("all brakes on", style.BLACK, "unassisted"),
            ("sliding mode", style.BLUE, "sliding_mode"),
            ("allocation, on-off valves", style.GREEN, "allocation_on_off"),
            ("allocation, proportional", style.VERMILLION, "allocation_proportional"),
            *((_label(law), style.PURPLE, _label(law)) for law in own),
        ):
            stops = [stop for found, stop in here if found.startswith(law)]
            places = [stop.distance for stop in stops], [stop.rotation for stop in stops]
            axes.plot(*places, "o", color=color, label=words)
    grid[0, 0].legend()
    return figure


def _findings(results: Results) -> Iterator[str]:
    """Yield a sentence for each bound, and for each unassisted stop shorter than its bound."""
    bounds = {case.maneuver: stop.distance for case, stop in results if case.law == "bound"}
    for case, stop in results:
        least = bounds.get(case.maneuver, math.nan)
        if case.law == "bound" and math.isfinite(stop.distance):
            yield (
                f"{case.maneuver}: no stop that keeps its heading is shorter than {least:.2f} m, "
                f"{stop.note}."
            )
        if case.law == "unassisted" and not case.condition and stop.distance < least:
            yield (
                f"{case.maneuver}: with all brakes on the stop of {stop.distance:.2f} m is shorter "
                f"than any that keeps its heading ({least:.2f} m)."
            )


def _run_bounds(options: _Bounds, study: StudyRun) -> StudyResult:
    """Run the stops, and count those that are shorter than a bound by more than its tolerance."""
    work = BoundTrials(study.experiments)
    seeds = range(options.seed, options.seed + math.ceil(options.runs / len(LAWS)))
    stops = study.campaign(work, seeds, BoundTrial, options, work.fingerprint)
    metrics = {"runs.all": Metric(len(LAWS) * len(stops), "1")}
    for bound in ("any_heading", "straight"):
        shares, lower = over_bound(stops, bound), below(stops, bound)
        count = int(np.sum(~np.isnan(shares)))
        solved = sum(not math.isnan(getattr(one, f"{bound}_slack")) for one in stops)
        metrics |= {
            f"compared.{bound}": Metric(count, "1"),
            f"solved.{bound}": Metric(solved, "1"),
            f"below_bound.{bound}": Metric(lower, "1"),
        }
        if count:
            metrics[f"least_over_bound.{bound}"] = Metric(float(np.nanmin(shares)), "1")
    study.figure("bounds.png", _draw_bounds(stops))
    return study.result(metrics)


_COLORS = (style.BLACK, style.BLUE, style.GREEN, style.VERMILLION)  # of the laws


def _draw_bounds(stops: Sequence[BoundTrial]) -> Figure:
    """Draw the distributions of path and stopping distance relative to the bounds for each law."""
    bounds = {
        "any_heading": "path of the center of gravity / its bound [1]",
        "straight": "distance of stops that keep heading and line / its bound [1]",
    }
    x, y = tuple(bounds.values()), "share of the runs below [1]"
    figure, (panels,) = style.panels(
        "No stop is below its bound", 1, 2, size=(10.0, 4.4), x=x, y=y, sharey=True
    )
    for axes, bound in zip(panels, bounds, strict=True):
        shares = over_bound(stops, bound)
        for column, (law, color) in enumerate(zip(LAWS, _COLORS, strict=True)):
            values = np.sort(shares[~np.isnan(shares[:, column]), column])
            label = law.replace("_", " ")
            axes.step(values, np.linspace(0.0, 1.0, len(values)), color=color, label=label)
        axes.axvline(1.0, color=style.GRAY, linestyle="--")
        axes.set_xlim(0.9, 2.0)
    panels[1].legend(fontsize=9)
    return figure


RUNS = {"bounds": _run_bounds}
