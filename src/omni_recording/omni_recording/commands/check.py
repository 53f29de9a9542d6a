"""``./omni bag check``: read a recording completely and list its problems.

Read a recording completely. Check every checksum, every message of a known type, the counts in the
metadata, the continuity of the message numbers, and whether the clock jumped during the recording.
The exit code is 1 if there is any problem.
"""

from pathlib import Path

from omni_core.commands import command_report, workspace
from omni_core.commands.command_options import CommandOptions
from omni_recording.commands import bag_option

WORK = "reading every message"


class Options(CommandOptions):
    """Options of ``omni bag check``."""

    bag: Path = bag_option()


def run(options: Options, _workspace: workspace.Workspace) -> command_report.Report:
    """Read the recording completely, and report its counts and problems."""
    from omni_recording.actions.check import check_bag

    result = check_bag(options.bag)
    metrics = {f"messages.{topic}": (float(n), "1") for topic, n in result.counts.items()}
    metrics["problems"] = (float(len(result.problems)), "1")
    summary = f"{len(result.problems)} problem(s)" if result.problems else "sound"
    total = sum(result.counts.values())
    return command_report.Report(
        metrics=command_report.entries(metrics),
        details={"problems": result.problems, "remarks": result.remarks},
        text=(
            *(f"wrong: {command_report.printable(line)}" for line in result.problems),
            *(f"note: {command_report.printable(line)}" for line in result.remarks),
            f"{options.bag}: {summary}, {total} messages on {len(result.counts)} topics read",
        ),
        ok=not result.problems,
    )
