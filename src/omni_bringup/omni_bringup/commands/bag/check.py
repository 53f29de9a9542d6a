"""``./omni bag check``: read everything and list the problems.

Read a recording from end to end: every checksum, every message of a known type, the counts against
the metadata, and gaps in the numbers of the messages. Exit code 1 if anything is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from omni_bringup.command_report import Report, entries, printable
from omni_bringup.commands.bag import bag_option
from omni_bringup.workspace import Workspace
from omni_platform.command_options import json_option
from omni_platform.configuration import Configuration

WORK = "reading every message"


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni bag check``."""

    bag: Path = bag_option()
    json: bool = json_option()


def run(options: Options, _workspace: Workspace) -> Report:
    """Read the recording from end to end."""
    from omni_recording.actions.check import check_bag

    result = check_bag(options.bag)
    metrics = {f"messages.{topic}": (float(n), "1") for topic, n in result.counts.items()}
    metrics["problems"] = (float(len(result.problems)), "1")
    summary = f"{len(result.problems)} problem(s)" if result.problems else "sound"
    total = sum(result.counts.values())
    return Report(
        name="bag_check",
        metrics=entries(metrics),
        details={"problems": result.problems, "remarks": result.remarks},
        text=(
            *(f"wrong: {printable(line)}" for line in result.problems),
            *(f"note: {printable(line)}" for line in result.remarks),
            f"{options.bag}: {summary}, {total} messages on {len(result.counts)} topics read",
        ),
        ok=not result.problems,
    )
