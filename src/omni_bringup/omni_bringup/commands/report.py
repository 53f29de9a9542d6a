"""``./omni report``: show recordings as a page for a browser.

Write one HTML file that needs nothing else: the vehicle from above, the plots in step with it, the
results, what the line cameras saw as the pedal went down, and the configuration with its
differences.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK, EXIT_REFUSED
from omni_platform.command_options import json_option, option
from omni_platform.configuration import Configuration

if TYPE_CHECKING:
    from omni_analysis.report.recording import ReportedRun


_SUFFIXES = (".html", ".htm")
_LONGEST_TITLE = 200  # characters
_SEEN = 0.2  # [s] of lines that are shown


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni report``."""

    bags: tuple[Path, ...] = option(
        positional=True,
        metavar="BAG",
        description="rosbag2 folder, or a single .mcap file; several are laid over each other",
    )
    out: Path | None = option(
        None,
        metavar="FILE",
        description="the page (default: report.html beside the first recording)",
    )
    json: bool = json_option()


def run(options: Options, _workspace: Path) -> int:
    """Write the report that the command line asks for and return the exit code."""
    from omni_analysis.loop.metrics import results_document
    from omni_analysis.report.page import report_page
    from omni_analysis.report.recording import read_reported_run, run_names, stops_apart
    from omni_bringup.commands.bag import printable
    from omni_bringup.progress_bar import progress_bar
    from omni_recording.error import BagError

    file: Path = options.out or options.bags[0].resolve().parent / "report.html"
    try:
        if file.suffix not in _SUFFIXES:
            raise ValueError(f"--out: {file} must end in {' or '.join(_SUFFIXES)}")
        runs: list[ReportedRun] = []
        seen: dict[str, bytes] = {}
        names = run_names(options.bags)
        with progress_bar("report") as report:
            for place, (path, name) in enumerate(zip(options.bags, names, strict=True)):
                report(place / len(names), name)
                whole = read_reported_run(path, name)
                runs += stops_apart(whole)
                seen |= _seen(path, whole)
        page = report_page(_title(runs), runs, seen)
    except (BagError, ValueError) as error:
        print(f"omni report: {printable(str(error))}", file=sys.stderr)
        return EXIT_REFUSED
    try:
        _write(file, page)
    except OSError as error:
        print(f"omni report: cannot write {file}: {error.strerror}", file=sys.stderr)
        return EXIT_FAILED
    if options.json:
        document = results_document("report", {run.name: run.metrics for run in runs})
        print(json.dumps(document | {"file": str(file)}, indent=2, allow_nan=False))
    else:
        for run in runs:
            for note in run.notes:
                print(printable(f"{run.name}: {note}"))
        print(f"report {file} ({file.stat().st_size / 1e6:.1f} MB)")
    return EXIT_OK


def _seen(path: Path, run: ReportedRun) -> dict[str, bytes]:
    """Return a picture (PNG) of a recording's lines about the pedal, if it holds any."""
    from omni_analysis.figures.style import picture_of
    from omni_analysis.line_files.kymograph import draw_sights, see
    from omni_bringup.replay.lines import read_batches
    from omni_bringup.replay.plan import lines_topic
    from omni_recording.folder import bag_summary, open_vehicle

    if run.configuration is None:
        return {}  # the notes of the run say so
    bag, odometry = open_vehicle(path), run.configuration.odometry
    counts = bag_summary(bag).counts
    cameras = [camera for camera in odometry.sensors if counts.get(lines_topic(camera))]
    if not cameras:
        return {}
    braking = -float(run.history.braking_time[0])
    batches = read_batches(bag, cameras, max(braking - 0.25 * _SEEN, 0.0), _SEEN)
    sights = {
        camera: see(odometry.sensors[camera], own, odometry) for camera, own in batches.items()
    }
    return {run.name: picture_of(draw_sights(sights, ""))}


def _title(runs: Sequence[ReportedRun]) -> str:
    """Return what the runs are about in their own words, if they say so."""
    words = [run.configuration.description for run in runs if run.configuration is not None]
    title = " | ".join(dict.fromkeys(filter(None, words))) or ", ".join(run.name for run in runs)
    return title[:_LONGEST_TITLE]


def _write(file: Path, text: str) -> None:
    """Write a file whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    scratch = file.with_name(f".{file.name}.part")
    try:
        scratch.write_text(text, encoding="utf-8")
        scratch.replace(file)
    finally:
        scratch.unlink(missing_ok=True)
