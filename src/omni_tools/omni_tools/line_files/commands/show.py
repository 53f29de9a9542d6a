"""``./omni lines show``: show the lines of a recording.

Draw the lines of a recording over time, the displacements and correlations of consecutive lines,
and the estimates of the odometry.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omni_core.commands.command_options import CommandOptions, option, overrides_option
from omni_core.commands.command_report import Report, entries_by_case, in_words
from omni_core.configuration import ConfigurationError, check_choice
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_tools.line_files.kymograph import Kymograph

WORK = "matching lines"


class Options(CommandOptions):
    """Options of ``omni lines show``."""

    bag: Path = option(positional=True, metavar="BAG")
    """rosbag2 folder of a run or of omni lines import"""
    sensor: tuple[str, ...] = option((), metavar="NAME")
    """camera to show (default: all)"""
    start: float = option(0.0, minimum=0.0, unit="s", maximum=1.0e6)
    """start of the lines to show, as time since the first line of the recording"""
    duration: float = option(0.2, above=0.0, maximum=60.0, unit="s")
    """duration of the lines to show"""
    overrides: tuple[str, ...] = overrides_option("odometry.median_lines=5")
    out: Path | None = option(None, metavar="FILE")
    """file of the figure, .png or .svg (default: results/lines/BAG.png)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Draw the recorded lines and the estimates that the odometry computes from them."""
    from omni_recording import error, folder
    from omni_runs.figures.style import save_figure
    from omni_runs.replay import lines, plan
    from omni_tools.line_files.kymograph import draw_kymographs, match_lines

    name_of_bag = options.bag.resolve().name
    target = options.out or workspace.results(None, "lines") / f"{name_of_bag}.png"
    if target.suffix not in {".png", ".svg"}:
        raise ConfigurationError("--out", f"{target.name} is neither .png nor .svg")
    bag = folder.open_vehicle(options.bag)
    odometry = plan.recorded_configuration(bag, options.overrides).odometry
    for name in options.sensor:
        check_choice("--sensor", name, odometry.sensors)
    names = options.sensor or lines.recorded_cameras(bag, odometry.sensors)
    if not names:
        raise error.BagError(bag.path, "contains no lines of a camera in its configuration")
    batches = lines.read_batches(bag, names, options.start, options.duration)
    kymographs = {
        name: match_lines(odometry.sensors[name], own, odometry) for name, own in batches.items()
    }
    picture = save_figure(draw_kymographs(kymographs, f"Lines of {name_of_bag}"), target)
    values = {name: _quantities(kymograph) for name, kymograph in kymographs.items()}
    text = []
    for name, own in values.items():
        text.append(f"{name}: {in_words(own)}")
        reasons = {r.reason for r in kymographs[name].readings if not r.measured}
        text += [f"    not measured: {reason}" for reason in sorted(reasons)[:3]]
    return Report(
        metrics=entries_by_case(values),
        details={"figure": str(picture)},
        text=(*text, f"wrote {picture}"),
    )


def _quantities(kymograph: Kymograph) -> dict[str, tuple[float, str]]:
    """Return statistics of a camera's lines as pairs (value, unit), keyed by name."""
    matched = np.isfinite(kymograph.displacement)
    velocity = [reading.velocity for reading in kymograph.readings if reading.measured]
    values = {}
    if matched.any():
        values["displacement"] = (float(np.median(kymograph.displacement[matched])), "px")
    values["correlation"] = (float(np.mean(kymograph.correlation)), "1")
    values["matched_share"] = (float(np.mean(matched)), "1")
    values["measured_share"] = (kymograph.measured, "1")
    if velocity:
        values["velocity"] = (float(np.median(velocity)), "m/s")
    return values
