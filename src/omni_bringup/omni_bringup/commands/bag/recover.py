"""``./omni bag recover``: save what is whole of an unfinished or damaged recording.

Write every whole message into a new recording with index and metadata, and say what was kept. The
recording itself is not touched.
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
from omni_platform.configuration import Configuration
from omni_platform.quantities import SECOND_NS

WORK = "saving messages"


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni bag recover``."""

    bag: Path = bag_option()
    out: Path | None = out_option("recovered")
    json: bool = json_option()


def run(options: Options, _workspace: Path) -> int:
    """Do it and return the exit code."""
    return refusing("recover", lambda: _recover(options))


def _recover(options: Options) -> int:
    from omni_recording.actions.recover import recover

    result = recover(options.bag, options.out or beside(options.bag, "recovered"))
    if result is None:
        if options.json:
            print_json(document("bag_recover", {}) | {"folder": None, "problems": []})
        else:
            print(f"{options.bag}: nothing is wrong with it, so nothing was written")
        return EXIT_OK
    total = sum(result.counts.values())
    metrics: dict[str, tuple[float, str]] = {
        "messages": (total, "1"),
        "start": (result.first_ns / SECOND_NS, "s"),
        "end": (result.last_ns / SECOND_NS, "s"),
    }
    metrics |= {f"messages.{topic}": (n, "1") for topic, n in result.counts.items()}
    if options.json:
        counted = document("bag_recover", metrics)
        print_json(counted | {"folder": str(result.folder), "problems": result.problems})
        return EXIT_OK
    for line in result.problems:
        print(f"wrong: {printable(line)}")
    for topic, count in sorted(result.counts.items()):
        print(f"kept {count:>8} {printable(topic)}")
    print(
        f"kept {total:>8} messages from {result.first_ns / SECOND_NS:.3f} s to "
        f"{result.last_ns / SECOND_NS:.3f} s in {result.folder}"
    )
    return EXIT_OK
