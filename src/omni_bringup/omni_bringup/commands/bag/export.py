"""``./omni bag export``: write the small topics as CSV or Parquet.

Write one table for every topic whose messages are at most 256 values: times in nanoseconds, SI
units, joints by name. Images are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from omni_bringup.commands.bag import (
    bag_option,
    beside,
    document,
    out_option,
    print_json,
    printable,
    refusing,
)
from omni_bringup.exit_codes import EXIT_OK
from omni_platform.command_options import json_option
from omni_platform.configuration import Configuration, parameter

WORK = "writing tables"


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni bag export``."""

    bag: Path = bag_option()
    format: str = parameter("csv", choices=("csv", "parquet"), description="of the tables")
    topic: tuple[str, ...] = parameter((), description="export only this topic")
    out: Path | None = out_option("exported")
    json: bool = json_option()


def run(options: Options, _workspace: Path) -> int:
    """Do it and return the exit code."""
    return refusing("export", lambda: _export(options))


def _export(options: Options) -> int:
    from omni_recording.actions.export import export_bag

    folder = options.out or beside(options.bag, "exported")
    result = export_bag(options.bag, folder, options.format, options.topic)
    if options.json:
        metrics = {f"rows.{topic}": (float(count), "1") for topic, count in result.rows.items()}
        files = {topic: str(file) for topic, file in result.files.items()}
        print_json(document("bag_export", metrics) | {"files": files, "skipped": result.skipped})
        return EXIT_OK
    for topic, file in result.files.items():
        print(f"wrote {file}: {result.rows[topic]} rows")
    for topic, why in result.skipped.items():
        print(f"left out {printable(topic)}: {printable(why)}")
    return EXIT_OK
