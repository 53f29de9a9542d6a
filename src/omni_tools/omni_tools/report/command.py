"""``./omni report``: show recordings as a page for a browser.

Write one self-contained HTML file. It contains an animation of the vehicle from above with
synchronized plots, the results, the camera lines at the start of braking, and the configurations
with their differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, make_folder, printable, write_text
from omni_core.configuration import ConfigurationError
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_tools.report.recording import ReportedRun


_SUFFIXES = (".html", ".htm")


class Options(CommandOptions):
    """Options of ``omni report``."""

    bags: tuple[Path, ...] = option(positional=True, metavar="BAG")
    """rosbag2 folder, or a single .mcap file; several runs are drawn in the same view"""
    out: Path | None = option(None, metavar="FILE")
    """file of the page (default: report.html next to the first recording)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Write the HTML page of the recordings."""
    from omni_runs.metrics import results_document
    from omni_tools.report.document import report_page
    from omni_tools.report.recording import read_reported_run, run_names, stops_apart

    file: Path = options.out or options.bags[0].resolve().parent / "report.html"
    if file.suffix not in _SUFFIXES:
        raise ConfigurationError("--out", f"{file} must end in {' or '.join(_SUFFIXES)}")
    make_folder(file.parent)
    runs: list[ReportedRun] = []
    seen: dict[str, bytes] = {}
    names = run_names(options.bags)
    with workspace.progress() as progress:
        for place, (path, name) in enumerate(zip(options.bags, names, strict=True)):
            progress(place / len(names), name)
            whole = read_reported_run(path, name)
            runs += stops_apart(whole)
            seen |= _seen(path, whole)
    write_text(file, report_page(_title(runs), runs, seen))
    return Report(
        **results_document("report", {run.name: run.metrics for run in runs}),
        details={"file": str(file)},
        text=(
            *(printable(f"{run.name}: {note}") for run in runs for note in run.notes),
            f"report {file} ({file.stat().st_size / 1e6:.1f} MB)",
        ),
    )


def _seen(path: Path, run: ReportedRun, shown: float = 0.2) -> dict[str, bytes]:
    """Return a PNG picture of the camera lines around the start of braking, keyed by run name.

    The result is empty if the recording contains no lines or the run has no configuration.

    Args:
        path: the recording.
        run: the run of this recording.
        shown: duration of the lines in the picture [s].
    """
    from omni_recording.folder import open_vehicle
    from omni_runs.figures.style import picture_of
    from omni_runs.replay.lines import read_batches, recorded_cameras
    from omni_tools.line_files.kymograph import draw_kymographs, match_lines

    if run.configuration is None:
        return {}  # a note in the results of the run states the reason
    bag, odometry = open_vehicle(path), run.configuration.odometry
    cameras = recorded_cameras(bag, odometry.sensors)
    if not cameras:
        return {}
    braking = -float(run.history.braking_time[0])
    batches = read_batches(bag, cameras, max(braking - 0.25 * shown, 0.0), shown)
    kymographs = {
        name: match_lines(odometry.sensors[name], own, odometry) for name, own in batches.items()
    }
    return {run.name: picture_of(draw_kymographs(kymographs, ""))}


def _title(runs: Sequence[ReportedRun]) -> str:
    """Return the title of the page: all descriptions, or all names if no run has a description."""
    words = [run.configuration.description for run in runs if run.configuration is not None]
    title = " | ".join(dict.fromkeys(filter(None, words))) or ", ".join(run.name for run in runs)
    return title[:200]  # characters
