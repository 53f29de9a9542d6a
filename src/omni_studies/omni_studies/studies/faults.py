"""Stops with faults of sensors or brakes: whether they end at rest, distance and rotation.

Both laws brake several vehicles, with and without an IMU. The faults are faults of one sensor,
faults that two sensors share, and brakes that fail before or during the stop. Every eighth stop is
the worst result of a local search. The reference for sensor faults is the longer distance and the
larger rotation of two stops: unassisted, and assisted without the fault. The reference for brake
faults is the stop with all other brakes on.
"""

from collections.abc import Sequence

from matplotlib.figure import Figure

from omni_figures import style
from omni_loop.metrics import Metric
from omni_loop.options import LoopOptions
from omni_platform.configuration import parameter
from omni_studies.campaign.sensor_faults import FaultyStops, Stop, limits, loss_of_twist
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions


class Options(CampaignOptions, LoopOptions):
    """Number of stops, and workers."""

    runs: int = parameter(4000, minimum=1, maximum=10_000_000)
    """number of stops"""
    seed: int = parameter(0, minimum=0)
    """seed of the first stop; the others follow"""
    worst: int = parameter(20, minimum=0, maximum=1000)
    """number of stops in each table of the worst stops, one by distance and one by rotation"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run the stops, write their table, the worst of them and a figure."""
    work = FaultyStops(study.experiments, options.changes)
    seeds = range(options.seed, options.seed + options.runs)
    stops = study.campaign(work, seeds, Stop, options, work.fingerprint)
    groups = {
        group: [stop for stop in stops if stop.group == group]
        for group in sorted({stop.group for stop in stops})
    }
    metrics = {"runs.all": Metric(len(stops), "1")}
    for group, chosen in groups.items():
        metrics |= _metrics(group, chosen)
    rotation = loss_of_twist(work)
    metrics["rotation_after_loss.straight_line"] = Metric(rotation, "deg")
    worst = sorted(stops, key=lambda stop: -stop.distance)[: options.worst]
    worst += sorted(stops, key=lambda stop: -stop.rotation)[: options.worst]
    study.table("worst.csv", Stop._fields, worst)
    study.figure("stops.png", _draw(groups))
    findings = (*map(_finding, groups.values()), f"Loss of the twist: {rotation:.1f} deg")
    return study.result(metrics, *findings)


def _metrics(group: str, stops: Sequence[Stop]) -> dict[str, Metric]:
    limit = limits(stops[0].extent, imu=bool(stops[0].imu))
    counted = [stop for stop in stops if stop.counted]
    rest = 100.0 * sum(stop.rest for stop in counted) / max(len(counted), 1)
    assisting = 100.0 * sum(stop.assisting for stop in stops) / len(stops)
    distance = max((stop.distance for stop in counted), default=0.0)
    rotation = max((stop.rotation for stop in counted), default=0.0)
    metrics = {
        f"runs.{group}": Metric(len(counted), "1"),
        f"comes_to_rest.{group}": Metric(rest, "%"),
        f"worst_distance_ratio.{group}": Metric(distance, "1", at_most=limit.distance),
        f"worst_extra_rotation.{group}": Metric(rotation, "deg", at_most=limit.rotation),
        f"still_assisting.{group}": Metric(assisting, "%", at_least=limit.assisting),
    }
    if stops[0].extent == "brake":
        known = max((stop.all_on_rotation for stop in counted), default=0.0)
        metrics[f"worst_all_on_rotation.{group}"] = Metric(known, "deg")
    return metrics


def _finding(stops: Sequence[Stop]) -> str:
    worst = max(stops, key=lambda stop: (stop.counted, 1 - stop.rest, stop.distance))
    rest = sum(stop.rest for stop in stops if stop.counted)
    return (
        f"{worst.group}: {rest} of {sum(stop.counted for stop in stops)} come to rest; longest "
        f"{worst.distance:.2f} times the distance ({worst.case}: {worst.channel} {worst.kind} "
        f"{worst.amplitude:g} from {worst.onset:g} s)"
    )


def _draw(groups: dict[str, list[Stop]]) -> Figure:
    """Draw distance and rotation of all stops, one panel for each group."""
    figure, grid = style.panels("", -(-len(groups) // 3), 3, size=(11.0, 9.0), sharey=True)
    for axes, (group, stops) in zip(grid.flat, groups.items(), strict=False):
        for index, channel in enumerate(sorted({stop.channel for stop in stops})):
            chosen = [stop for stop in stops if stop.counted and stop.channel == channel]
            places = [stop.distance for stop in chosen], [stop.rotation for stop in chosen]
            axes.plot(*places, ".", color=f"C{index % 10}", markersize=3, label=channel)
        limit = limits(stops[0].extent, imu=bool(stops[0].imu))
        for value, draw in ((limit.distance, axes.axvline), (limit.rotation, axes.axhline)):
            if value is not None:
                draw(value, color=style.GRAY, linewidth=0.8, linestyle="--")
        axes.set_title(group)
        axes.legend(loc="lower right", fontsize="x-small")
    figure.supxlabel("distance / reference distance [1]")
    figure.supylabel("rotation beyond the reference [deg]")
    return figure
