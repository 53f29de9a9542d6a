"""``./omni bag export``: write topics as CSV or Parquet tables.

Write one table for each topic whose messages have at most 256 values, with times in nanoseconds,
all other quantities in SI units, and one column for each joint. Larger messages such as images are
omitted. The exit code is 1 if any other topic, or a topic chosen with ``--topic``, is left out.
"""

from pathlib import Path

from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, entries, printable
from omni_core.commands.workspace import Workspace
from omni_recording.commands import bag_option, beside, out_option

WORK = "writing tables"


class Options(CommandOptions):
    """Options of ``omni bag export``."""

    bag: Path = bag_option()
    format: str = option("csv", choices=("csv", "parquet"))
    """format of the tables"""
    topic: tuple[str, ...] = option(())
    """export only this topic"""
    out: Path | None = out_option("exported")


def run(options: Options, _workspace: Workspace) -> Report:
    """Write the tables of the chosen topics."""
    from omni_recording.actions.export import export_bag

    folder = options.out or beside(options.bag, "exported")
    result = export_bag(options.bag, folder, options.format, options.topic)
    skipped = {
        topic: f"left out {printable(topic)}: {printable(why)}"
        for topic, why in result.skipped.items()
    }
    return Report(
        metrics=entries({f"rows.{topic}": (float(n), "1") for topic, n in result.rows.items()}),
        details={
            "files": {topic: str(file) for topic, file in result.files.items()},
            "skipped": result.skipped,
            "failed": sorted(result.failed),
        },
        text=(
            *(f"wrote {file}: {result.rows[topic]} rows" for topic, file in result.files.items()),
            *(line for topic, line in skipped.items() if topic not in result.failed),
        ),
        problems=[skipped[topic] for topic in sorted(result.failed)],
    )
