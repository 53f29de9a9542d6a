"""Stops during which a sensor lies or fails: whether the vehicle stops, how far, how much it turns.

Thousands of lies of one channel at a time (twist, gyro, accelerometer, one encoder), with and
without an IMU, on several vehicles; every eighth is the worst of a local search. Compared with the
longer stop and the larger rotation of unassisted and honest assisted braking.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from omni_analysis.campaign.lies import (
    DISTANCE_LIMITS,
    ROTATION_LIMIT,
    LyingSensors,
    Stop,
    loss_of_twist,
)
from omni_analysis.campaign.runner import CampaignOptions, run_campaign
from omni_analysis.figures.style import save_figure
from omni_analysis.loop.metrics import Metric
from omni_analysis.loop.options import LoopOptions
from omni_analysis.studies import StudyResult, StudyRun
from omni_platform.configuration import parameter

_LOSS_ONSET, _LOSS_LIMIT = 0.3, 8.0  # [s] after the pedal, [deg]
_WORST = 20  # stops in the table of the worst


@dataclass(frozen=True, kw_only=True)
class Options(CampaignOptions, LoopOptions):
    """How many stops are run, and where."""

    runs: int = parameter(3000, description="number of lies", minimum=1, maximum=10_000_000)
    seed: int = parameter(0, description="seed of the first; the others follow", minimum=0)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run the stops, write their table, the worst of them and a figure."""
    work = LyingSensors(study.experiments, options.changes)
    seeds = range(options.seed, options.seed + options.runs)
    path = study.folder / "stops.csv"
    stops = run_campaign(work, seeds, Stop, options, path, work.fingerprint, study.report)
    metrics = _metrics(stops)
    rotation = loss_of_twist(work, _LOSS_ONSET)
    metrics["rotation_after_loss.straight_line"] = Metric(rotation, "deg", limit=_LOSS_LIMIT)
    files = (
        path,
        _write_worst(stops, study.folder / "worst.csv"),
        save_figure(_draw(stops), study.folder / "stops.png"),
    )
    return StudyResult(metrics, files, _findings(stops, rotation))


def _metrics(stops: Sequence[Stop]) -> dict[str, Metric]:
    metrics = {"runs.all": Metric(len(stops), "1")}
    for imu, case in ((True, "imu"), (False, "no_imu")):
        chosen = [stop for stop in stops if stop.imu == imu]
        if not chosen:
            continue
        limit = DISTANCE_LIMITS[imu]
        rest = 100.0 * sum(stop.rest for stop in chosen) / len(chosen)
        assisting = 100.0 * sum(stop.assisting for stop in chosen) / len(chosen)
        rotation = max(stop.rotation for stop in chosen)
        over = sum(stop.distance > limit for stop in chosen)
        metrics |= {
            f"runs.{case}": Metric(len(chosen), "1"),
            f"comes_to_rest.{case}": Metric(rest, "%", limit=100.0),
            f"worst_distance_over_unassisted.{case}": Metric(
                max(stop.distance for stop in chosen), "1", limit=limit
            ),
            f"worst_extra_rotation.{case}": Metric(
                rotation, "deg", limit=ROTATION_LIMIT if imu else None
            ),
            f"still_assisting.{case}": Metric(assisting, "%"),
            f"beyond_distance_limit.{case}": Metric(over, "1"),
            f"beyond_rotation_limit.{case}": Metric(
                sum(stop.rotation > ROTATION_LIMIT for stop in chosen), "1"
            ),
        }
    return metrics


def _findings(stops: Sequence[Stop], rotation: float) -> tuple[str, ...]:
    worst = max(stops, key=lambda stop: (1 - stop.rest, stop.distance))
    turned = max((stop for stop in stops), key=lambda stop: stop.rotation)
    rest = sum(stop.rest for stop in stops)

    def words(stop: Stop) -> str:
        imu = "" if stop.imu else ", no IMU"
        return (
            f"{stop.case}{imu}: {stop.channel} {stop.kind} {stop.amplitude:g} from {stop.onset:g} s"
        )

    return (
        f"{rest} of {len(stops)} stops with a lying sensor come to rest",
        f"The longest takes {worst.distance:.2f} times the distance ({words(worst)})",
        f"The vehicle turns by at most {turned.rotation:.1f} deg more ({words(turned)})",
        f"Without the twist from {_LOSS_ONSET:g} s on straight_line turns by {rotation:.1f} deg",
    )


def _write_worst(stops: Sequence[Stop], path: Path) -> Path:
    """Write the stops that went farthest and those that turned most."""
    chosen = sorted(stops, key=lambda stop: -stop.distance)[:_WORST]
    chosen += sorted(stops, key=lambda stop: -stop.rotation)[:_WORST]
    lines = [",".join(Stop._fields)] + [",".join(str(value) for value in stop) for stop in chosen]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _draw(stops: Sequence[Stop]) -> Figure:
    """Draw distance and rotation of all stops, by channel."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.5), sharey=True, layout="constrained")
    channels = sorted({stop.channel for stop in stops})
    for panel, imu in zip(panels, (True, False), strict=True):
        for index, channel in enumerate(channels):
            chosen = [stop for stop in stops if stop.imu == imu and stop.channel == channel]
            if chosen:
                values = np.array([(stop.distance, stop.rotation) for stop in chosen])
                panel.plot(*values.T, ".", color=f"C{index}", markersize=3, label=channel)
        panel.axvline(DISTANCE_LIMITS[imu], color="0.4", linewidth=0.8, linestyle="--")
        if imu:
            panel.axhline(ROTATION_LIMIT, color="0.4", linewidth=0.8, linestyle="--")
        panel.set_title("with an IMU" if imu else "wheel speeds only")
        panel.set_xlabel("distance over the longer of unassisted and honest assisted [1]")
        panel.legend(loc="lower right", fontsize="small")
    panels[0].set_ylabel("rotation beyond the larger of the two [deg]")
    return figure
