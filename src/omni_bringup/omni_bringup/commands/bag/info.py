"""``./omni bag info``: show topics, types, counts and times.

Show what a recording claims to hold, without reading its messages.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omni_bringup.commands.bag import bag_option, document, print_json, printable, refusing
from omni_bringup.exit_codes import EXIT_OK
from omni_platform.command_options import json_option
from omni_platform.configuration import Configuration
from omni_platform.quantities import SECOND_NS

if TYPE_CHECKING:
    from omni_recording.folder import Bag
    from omni_recording.mcap import McapSummary

_MEGABYTE = 1e6  # [B]

WORK = "reading the recording"


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Options of ``omni bag info``."""

    bag: Path = bag_option()
    json: bool = json_option()


def run(options: Options, _workspace: Path) -> int:
    """Do it and return the exit code."""
    return refusing("info", lambda: _info(options))


def _info(options: Options) -> int:
    from omni_recording.folder import bag_summary, open_bag

    found = open_bag(options.bag)
    summary = bag_summary(found)
    size = sum(file.stat().st_size for file in found.files)
    if options.json:
        types = {channel.topic: channel.type_name for channel in summary.channels}
        counted = document("bag_info", _info_metrics(summary, size))
        print_json(counted | {"topics": types, "ros_distro": found.ros_distro})
    else:
        _print_info(found, summary, size)
    return EXIT_OK


def _info_metrics(summary: McapSummary, size: int) -> dict[str, tuple[float, str]]:
    duration = (summary.last_ns - summary.first_ns) / SECOND_NS
    metrics: dict[str, tuple[float, str]] = {
        "size": (size, "B"),
        "start": (summary.first_ns / SECOND_NS, "s"),
        "duration": (duration, "s"),
        "messages": (sum(summary.counts.values()), "1"),
        "chunks": (summary.chunks, "1"),
    }
    return metrics | {f"messages.{topic}": (n, "1") for topic, n in summary.counts.items()}


def _print_info(found: Bag, summary: McapSummary, size: int) -> None:
    duration = (summary.last_ns - summary.first_ns) / SECOND_NS
    rows = [("topic", "type", "messages", "per second")]
    for channel in sorted(summary.channels, key=lambda channel: channel.topic):
        count = summary.counts[channel.topic]
        rate = f"{(count - 1) / duration:.1f}" if duration > 0.0 and count > 1 else ""
        rows.append((printable(channel.topic), printable(channel.type_name), str(count), rate))
    left, right = (max(len(row[column]) for row in rows) for column in (0, 1))
    for topic, kind, messages, rate in rows:
        print(f"{topic:<{left}}  {kind:<{right}}  {messages:>8}  {rate:>10}".rstrip())
    total = sum(summary.counts.values())
    print(f"{total} messages in {duration:.3f} s from {summary.first_ns / SECOND_NS:.3f} s on")
    packed = ", ".join(printable(word or "uncompressed") for word in summary.compressions)
    print(
        f"{size / _MEGABYTE:.1f} MB in {len(found.files)} file(s), {summary.chunks} chunks, "
        f"{packed or 'empty'}"
    )
