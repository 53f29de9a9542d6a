"""Random stops of many vehicles, with random conditions or with faults.

``robustness`` writes a table of all runs, a table of violations with their causes, and experiment
files of the worst runs, which ``./omni run`` can repeat over the ROS graph.

In ``faults``, several vehicles are braked under both laws, with and without an IMU. The faults are
faults of one sensor, faults that two or three sensors share, permanent or intermittent, and faults
of a brake before or during the stop. The events are ice under one side of the vehicle, a payload at
one corner, of which the assistant does not know, and a push against one corner. In every eighth
stop, a local search varies the fault to make its effect as harmful as possible. For a sensor fault,
two stops without the fault are simulated, one unassisted and one assisted; the longer distance and
the larger rotation of these two are the reference. For a brake fault or an event, the reference is
the unassisted stop with the same fault or event. The worst stops of the first and of the second
half of the seeds are reported with their seeds.
"""

import itertools
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from omni_core.commands.command_report import write_text
from omni_core.configuration import parameter
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_runs.options import LoopOptions
from omni_studies.campaign import lost_brakes, random_braking
from omni_studies.campaign.random_braking import ALLOWED, Outcome
from omni_studies.campaign.sensor_faults import FaultyStops, StopWithFault, limits, loss_of_twist
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions

CASES = {
    "robustness": "Stops of thousands of random vehicles in random conditions, unassisted and "
    "assisted",
    "faults": "Stops with faults of sensors or brakes: whether they end at rest, distance and "
    "rotation",
}

_PERCENTILES = (50, 95, 100)
_VARIANTS = ("unassisted", "assisted")
_COLUMNS = {
    "orientation_unassisted": "deg",
    "orientation_assisted": "deg",
    "distance_unassisted": "m",
    "distance_assisted": "m",
    "rejected_share": "1",
    "tipping": "1",
}
"""Columns of the table of violations, except the cause, and the unit of each column."""


class Options(CampaignOptions, LoopOptions):
    """Options of ``robustness``: runs of the campaign, first seed, and worker processes."""

    runs: int = parameter(1000, minimum=1, maximum=10_000_000)
    """number of runs"""
    seed: int = parameter(0, minimum=0)
    """seed of the first run; the seeds of the other runs follow it"""
    worst: int = parameter(3, minimum=0, maximum=1000)
    """write experiments of this number of runs with the worst orientation, and of as many with the
    worst distance"""


class _Faults(Options):
    """Options of ``faults``: number of stops, and workers."""

    runs: int = parameter(4000, minimum=1, maximum=10_000_000)
    """number of stops"""
    worst: int = parameter(20, minimum=0, maximum=1000)
    """list this number of stops with the worst distance in worst.csv, and as many with the worst
    rotation"""


OPTIONS = {"faults": _Faults}


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run the campaign and write tables, figures and cases to replay."""
    braking = random_braking.RandomBraking(study.experiments, options.changes)
    work = partial(random_braking.outcome, braking)
    seeds = range(options.seed, options.seed + options.runs)
    results = study.campaign(work, seeds, Outcome, options, braking.fingerprint, "runs.csv")
    header = ("seed", "vehicle", "limit", "cause")
    words = (f"{name.replace('_', ' ')} [{unit}]" for name, unit in _COLUMNS.items())
    rows = (
        (result.seed, result.vehicle, limit, cause, *(getattr(result, name) for name in _COLUMNS))
        for result in results
        for limit in random_braking.LIMITS
        if (cause := getattr(result, limit))
    )
    study.table("violations.csv", (*header, *words), rows, digits=6)
    study.figure("runs.png", draw_runs(results))
    study.figure("distributions.png", draw_distributions(results))
    study.written.extend(_write_worst(results, braking, study.folder, options.worst))
    return study.result(_metrics(results))


def _metrics(results: Sequence[Outcome]) -> dict[str, Metric]:
    metrics = {"runs.all": Metric(len(results), "1")}
    for limit in random_braking.LIMITS:
        causes = Counter(getattr(result, limit) for result in results)
        metrics[f"violations.{limit}"] = Metric(len(results) - causes[""], "1")
        metrics |= {
            f"violations.{limit}_{cause}": Metric(causes[cause], "1")
            for cause in random_braking.CAUSES
            if causes[cause]
        }
    cases = random_braking.VEHICLES, {"orientation": "deg", "distance": "m"}.items(), _VARIANTS
    for vehicle, (name, unit), variant in itertools.product(*cases):
        own = [result for result in results if result.vehicle == vehicle]
        values = np.array([getattr(result, f"{name}_{variant}") for result in own])
        for share in _PERCENTILES if own else ():
            percentile = float(np.percentile(values, share))
            metrics[f"{name}_p{share}.{vehicle}_{variant}"] = Metric(percentile, unit)
    rises = [max(result.energy_rise_unassisted, result.energy_rise_assisted) for result in results]
    metrics["energy_rise.largest"] = Metric(max(rises), "1")
    better = sum(r.orientation_assisted < r.orientation_unassisted for r in results)
    metrics["better_share.all"] = Metric(better / len(results), "1")
    tipping = sum(result.tipping for result in results)
    metrics["tipping_share.all"] = Metric(tipping / len(results), "1")
    return metrics


def _write_worst(
    results: Sequence[Outcome], braking: random_braking.RandomBraking, folder: Path, count: int
) -> list[Path]:
    """Write an experiment file for each of the worst runs, and remove older files."""
    for old in folder.glob("worst_*.yaml"):
        old.unlink()
    files = []
    shortest = ALLOWED.shortest
    goodness: dict[str, Callable[[Outcome], float]] = {
        "orientation": lambda r: r.orientation_unassisted - r.orientation_assisted,
        "distance": lambda r: -r.distance_assisted / max(r.distance_unassisted, shortest),
    }
    for limit, key in goodness.items():
        for rank, result in enumerate(sorted(results, key=key)[:count], 1):
            words = (
                f"{result.orientation_unassisted:.1f} deg and {result.distance_unassisted:.2f} m "
                f"unassisted, {result.orientation_assisted:.1f} deg and "
                f"{result.distance_assisted:.2f} m assisted"
            )
            cause = getattr(result, limit)
            words += f"; cause: {cause}" if cause else ""
            path = folder / f"worst_{limit}_{rank}.yaml"
            files.append(write_text(path, braking.experiment_file(result.seed, words)))
    return files


_TITLES = {
    "mecanum_forklift": "Mecanum, four wheels",
    "three_wheel_robot": "Kiwi, three wheels",
    "six_wheel_mecanum": "Mecanum, six wheels",
}
_QUANTITIES = {"orientation": "orientation change [deg]", "distance": "stopping distance [m]"}


def draw_runs(results: Sequence[Outcome]) -> Figure:
    """Draw the results of the assisted runs versus those of the unassisted runs, with the limits.

    Args:
        results: results of the campaign.
    """
    title, size = "Every run: above the line, a limit is violated", (12.0, 8.0)
    figure, panels = style.panels(
        title, 2, len(_TITLES), size=size, y=[f"assisted {name}" for name in _QUANTITIES.values()]
    )
    limits: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "orientation": lambda x: x + ALLOWED.orientation,
        "distance": lambda x: ALLOWED.distance * x,
    }
    for row, (quantity, label) in zip(panels, _QUANTITIES.items(), strict=True):
        for axes, (vehicle, title) in zip(row, _TITLES.items(), strict=True):
            chosen = [result for result in results if result.vehicle == vehicle]
            kept = [result for result in chosen if not getattr(result, quantity)]
            broken = [result for result in chosen if getattr(result, quantity)]
            dots = min(max(3000.0 / max(len(chosen), 1), 3.0), 14.0)
            for part, look in (
                (kept, {"s": dots, "color": style.BLUE, "alpha": 0.5}),
                # Not clipped at the axes.
                (broken, {"s": 24.0, "color": style.VERMILLION, "clip_on": False, "zorder": 5}),
            ):
                axes.scatter(*_pairs(part, quantity), linewidths=0, **look)
            largest = max([1.0, *_pairs(chosen, quantity)[0], *_pairs(chosen, quantity)[1]])
            line = np.array([0.0, largest])
            axes.plot(line, line, color=style.GRAY, linewidth=0.8)
            axes.plot(line, limits[quantity](line), color=style.VERMILLION, linewidth=1.0)
            axes.set(xlim=(0.0, 1.03 * largest), ylim=(0.0, 1.03 * largest))
            axes.set(title=f"{title}: {len(broken)} of {len(chosen)}", xlabel=f"unassisted {label}")
    return figure


def draw_distributions(results: Sequence[Outcome]) -> Figure:
    """Draw cumulative distributions of the results of all runs.

    Args:
        results: results of the campaign.
    """
    title, size = "Cumulative share of runs", (12.0, 7.0)
    words = "share of runs [1]"
    figure, panels = style.panels(title, 2, len(_TITLES), size=size, y=words, sharey=True)
    for row, (quantity, label) in zip(panels, _QUANTITIES.items(), strict=True):
        for axes, (vehicle, title) in zip(row, _TITLES.items(), strict=True):
            chosen = [result for result in results if result.vehicle == vehicle]
            pairs = _pairs(chosen, quantity)
            for values, name, color in zip(
                pairs, ("unassisted", "assisted"), (style.ORANGE, style.BLUE), strict=True
            ):
                share = (np.arange(len(values)) + 1.0) / max(len(values), 1)
                axes.step(np.sort(values), share, where="post", color=color, label=name)
            axes.set_xlim(left=0.0)
            axes.set_ylim(0.0, 1.0)
            axes.set(title=title, xlabel=label)
    panels[0, 0].legend(loc="lower right")
    return figure


def _pairs(results: Sequence[Outcome], quantity: str) -> tuple[np.ndarray, np.ndarray]:
    unassisted = np.array([getattr(result, f"{quantity}_unassisted") for result in results])
    assisted = np.array([getattr(result, f"{quantity}_assisted") for result in results])
    return unassisted, assisted


def _faults(options: _Faults, study: StudyRun) -> StudyResult:
    """Run the stops; write their table, the tables of the worst stops, and a figure."""
    work = FaultyStops(study.experiments, options.changes)
    seeds = range(options.seed, options.seed + options.runs)
    stops = study.campaign(work, seeds, StopWithFault, options, work.fingerprint)
    groups = {
        group: [stop for stop in stops if stop.group == group]
        for group in sorted({stop.group for stop in stops})
    }
    metrics = {"runs.all": Metric(len(stops), "1")}
    second = options.seed + options.runs // 2
    for group, chosen in groups.items():
        metrics |= _fault_metrics(group, chosen) | worst_of_two_sets(group, chosen, second)
    metrics |= lost_brakes.metrics(stops)
    rotation = loss_of_twist(work)
    metrics["rotation_after_loss.straight_line"] = Metric(rotation, "deg")
    worst = sorted(stops, key=lambda stop: -stop.distance)[: options.worst]
    worst += sorted(stops, key=lambda stop: -stop.rotation)[: options.worst]
    study.table("worst.csv", StopWithFault._fields, worst)
    study.figure("stops.png", _draw_stops(groups))
    findings = (*map(_finding, groups.values()), f"Loss of the twist: {rotation:.1f} deg")
    return study.result(metrics, *findings)


def _fault_metrics(group: str, stops: Sequence[StopWithFault]) -> dict[str, Metric]:
    limit = limits(stops[0].extent, imu=bool(stops[0].imu))
    counted = [stop for stop in stops if stop.counted]
    rest = 100.0 * sum(stop.rest for stop in counted) / max(len(counted), 1)
    assisting = 100.0 * sum(stop.assisting for stop in stops) / len(stops)
    distance = max((stop.distance for stop in counted), default=0.0)
    rotation = max((stop.rotation for stop in counted), default=0.0)
    return {
        f"runs.{group}": Metric(len(counted), "1"),
        f"comes_to_rest.{group}": Metric(rest, "%"),
        f"worst_distance_ratio.{group}": Metric(distance, "1", at_most=limit.distance),
        f"worst_extra_rotation.{group}": Metric(rotation, "deg", at_most=limit.rotation),
        f"still_assisting.{group}": Metric(assisting, "%", at_least=limit.assisting),
        f"false_brake.{group}": Metric(sum(stop.false_brake for stop in stops), "1", at_most=0.0),
    }


def worst_of_two_sets(group: str, stops: Sequence[StopWithFault], second: int) -> dict[str, Metric]:
    """Return the worst results of each of two independent sets of stops, with their seeds.

    Args:
        group: name of the group of all stops.
        stops: stops of both sets.
        second: first seed of the second set.
    """
    metrics = {}
    for quantity, unit in (("distance", "1"), ("rotation", "deg")):
        for name, later in (("first", False), ("second", True)):
            own = [stop for stop in stops if stop.counted and (stop.seed >= second) is later]
            worst = max(own, key=lambda stop: getattr(stop, quantity), default=None)
            if worst is not None:
                value = float(getattr(worst, quantity))
                metrics[f"worst_{quantity}_{name}.{group}"] = Metric(value, unit)
                metrics[f"seed_of_worst_{quantity}_{name}.{group}"] = Metric(worst.seed, "1")
    return metrics


def _finding(stops: Sequence[StopWithFault]) -> str:
    worst = max(stops, key=lambda stop: (stop.counted, 1 - stop.rest, stop.distance))
    rest = sum(stop.rest for stop in stops if stop.counted)
    return (
        f"{worst.group}: {rest} of {sum(stop.counted for stop in stops)} come to rest; longest: "
        f"{worst.distance:.2f} times the reference ({worst.case}: {worst.channel} {worst.kind} "
        f"{worst.amplitude:g} from {worst.onset:g} s, seed {worst.seed})"
    )


def _draw_stops(groups: dict[str, list[StopWithFault]]) -> Figure:
    """Draw distance and rotation of all stops, one panel for each group.

    A channel has the same color in all panels.
    """
    labels = {"x": "distance / reference [1]", "y": "rotation - reference [deg]"}
    look = {"sharex": True, "sharey": True, **labels}
    figure, panels = style.tiles("", len(groups), 3, size=(3.67, 2.8), **look)
    channels = sorted({stop.channel for stops in groups.values() for stop in stops})
    for axes, (group, stops) in zip(panels, groups.items(), strict=True):
        for index, channel in enumerate(channels):
            chosen = [stop for stop in stops if stop.counted and stop.channel == channel]
            places = [stop.distance for stop in chosen], [stop.rotation for stop in chosen]
            if chosen:
                axes.plot(*places, ".", color=f"C{index % 10}", markersize=3, label=channel)
        limit = limits(stops[0].extent, imu=bool(stops[0].imu))
        for value, draw in ((limit.distance, axes.axvline), (limit.rotation, axes.axhline)):
            if value is not None:
                draw(value, color=style.GRAY, linewidth=0.8, linestyle="--")
        axes.set_title(group.replace("_", " "))
    style.legend_below(figure, 6, markerscale=3.0)
    return figure


RUNS = {"faults": _faults}
