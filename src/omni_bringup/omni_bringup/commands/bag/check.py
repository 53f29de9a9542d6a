"""``./omni bag check``: read everything and say what is wrong.

Read a recording from end to end: every checksum, every message of a known type, the counts against
the metadata, and gaps in the numbers of the messages. Exit code 1 if anything is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omni_bringup.commands.bag import bag_option, document, print_json, printable, refusing
from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK
from omni_platform.command_options import json_option
from omni_platform.configuration import Configuration

if TYPE_CHECKING:
    from omni_recording.actions.check import BagCheck

WORK = "reading every message"


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni bag check``."""

    bag: Path = bag_option()
    json: bool = json_option()


def run(options: Options, _workspace: Path) -> int:
    """Do it and return the exit code."""
    return refusing("check", lambda: _check(options))


def _check(options: Options) -> int:
    from omni_recording.actions.check import check_bag

    result = check_bag(options.bag)
    code = EXIT_FAILED if result.problems else EXIT_OK
    if options.json:
        metrics = {f"messages.{topic}": (float(n), "1") for topic, n in result.counts.items()}
        metrics["problems"] = (float(len(result.problems)), "1")
        counted = document("bag_check", metrics)
        print_json(counted | {"problems": result.problems, "remarks": result.remarks})
    else:
        _print_check(options.bag, result)
    return code


def _print_check(path: Path, result: BagCheck) -> None:
    for line in result.problems:
        print(f"wrong: {printable(line)}")
    for line in result.remarks:
        print(f"note: {printable(line)}")
    total = sum(result.counts.values())
    verdict = f"{len(result.problems)} problem(s)" if result.problems else "sound"
    print(f"{path}: {verdict}, {total} messages on {len(result.counts)} topics read")
