"""``./omni compare``: compare recordings in a table with one column for each stop.

Compute the metrics of each stop: distance, rotation, odometry error and odometry drift (absolute
trajectory error ATE, and relative pose error RPE over 1 m).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from omni_core.commands import command_report, workspace
from omni_core.commands.command_options import CommandOptions, option

WORK = "measuring the recordings"


class Options(CommandOptions):
    """Options of ``omni compare``."""

    bags: tuple[Path, ...] = option(positional=True, metavar="BAG")
    """rosbag2 folder of omni run or omni drive, or a single .mcap file"""
    max_distance: float | None = option(None, metavar="M", minimum=0.0, maximum=1.0e4)
    """limit on the stopping distance; if a stop is longer, the exit code is 1"""
    max_rotation: float | None = option(None, metavar="DEG", minimum=0.0, maximum=3600.0)
    """limit on the change of orientation; if a change is larger, the exit code is 1"""
    csv: Path | None = option(None, metavar="FILE")
    """file to which the table is also written"""


def run(options: Options, _workspace: workspace.Workspace) -> command_report.Report:
    """Compute the metrics of the recordings and return them as one table."""
    from omni_runs.figures.tables.comparison_table import ComparisonTable
    from omni_runs.figures.tables.data_table import write_cases
    from omni_runs.metrics import results_document
    from omni_tools.report.recording import compared_runs, differing_values, run_names

    columns = {
        command_report.printable(name): metrics
        for path, base in zip(options.bags, run_names(options.bags), strict=True)
        for name, metrics in compared_runs(path, base).items()
    }
    limits = {"stopping_distance": options.max_distance, "orientation_change": options.max_rotation}
    missed = []
    for name, metrics in columns.items():
        for key, limit in limits.items():
            if key not in metrics:  # limits apply to stops, not to a complete drive
                continue
            metrics[key] = replace(metrics[key], at_most=limit)
            if metrics[key].status == "missed":
                found = f"{metrics[key].value:.3g} {metrics[key].unit}"
                words = f"{name}: {key.replace('_', ' ')} is {found}, must be at most {limit:g}"
                missed.append(command_report.printable(words))
    if options.csv is not None:
        values = {name: {key: m.value for key, m in one.items()} for name, one in columns.items()}
        write_cases(options.csv, "stop", values)
    differences, problems = differing_values(options.bags)
    unread = [
        command_report.printable(f"{path}: its configuration is not compared: {problem}")
        for path, problem in problems.items()
    ]
    return command_report.Report(
        **results_document("compare", columns),
        details={"differences": differences},
        text=(ComparisonTable(columns), *_in_words(differences), *unread, *missed),
        ok=not missed,
    )


def _in_words(differences: Mapping[str, Sequence[str]], most: int = 3) -> Iterator[str]:
    """Yield a line with example values for each part of the configuration that differs."""
    parts: dict[str, list[str]] = {}
    for key, values in differences.items():
        part, _, name = key.partition(".")
        shown = " | ".join(value or "none" for value in values)
        parts.setdefault(part, []).append(f"{name} {shown}".strip())
    for part, words in parts.items():
        more = f" and {len(words) - most} more" if len(words) > most else ""
        yield command_report.printable(f"{part} differs: {', '.join(words[:most])}{more}")
