"""``./omni compare``: put recordings side by side, each stop of a drive by itself.

Measure recordings again and print a table with a column for each stop: distance, swerve, odometry
error and drift (ATE, and RPE over 1 m).
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from omni_bringup.exit_codes import EXIT_OK, EXIT_REFUSED
from omni_platform.command_options import json_option, option
from omni_platform.configuration import Configuration

WORK = "measuring the recordings"


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni compare``."""

    bags: tuple[Path, ...] = option(
        positional=True,
        metavar="BAG",
        description="rosbag2 folder of a run or a drive, or a single .mcap file",
    )
    csv: Path | None = option(None, metavar="FILE", description="write the table here too")
    json: bool = json_option()


def run(options: Options, _workspace: Path) -> int:
    """Print the table and return the exit code."""
    from rich.console import Console

    from omni_analysis.figures.comparison_table import comparison_table
    from omni_analysis.figures.data_table import write_table
    from omni_analysis.loop.metrics import results_document
    from omni_analysis.report.recording import compared_runs, run_names
    from omni_bringup.commands.bag import printable
    from omni_recording.error import BagError

    try:
        names = run_names(options.bags)
        columns = {
            printable(name): metrics
            for path, base in zip(options.bags, names, strict=True)
            for name, metrics in compared_runs(path, base).items()
        }
        if options.csv is not None:
            quantities = list(dict.fromkeys(key for one in columns.values() for key in one))
            rows = [
                [name, *(one[key].value if key in one else "" for key in quantities)]
                for name, one in columns.items()
            ]
            write_table(options.csv, ["stop", *quantities], rows)
    except (BagError, ValueError, OSError) as error:
        print(f"omni compare: {printable(str(error))}", file=sys.stderr)
        return EXIT_REFUSED
    if options.json:
        print(json.dumps(results_document("compare", columns), indent=2, allow_nan=False))
    else:
        Console().print(comparison_table(columns))
    return EXIT_OK
