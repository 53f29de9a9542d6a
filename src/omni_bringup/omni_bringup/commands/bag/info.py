"""``./omni bag info``: show topics, types, counts and times.

Show the index of a recording without reading its messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from omni_bringup.command_report import Report, entries, printable
from omni_bringup.commands.bag import bag_option
from omni_bringup.workspace import Workspace
from omni_platform import quantities
from omni_platform.command_options import CommandOptions

if TYPE_CHECKING:
    from omni_recording.folder import Bag
    from omni_recording.mcap import McapSummary


WORK = "reading the recording"


class Options(CommandOptions):
    """Options of ``omni bag info``."""

    bag: Path = bag_option()


def run(options: Options, _workspace: Workspace) -> Report:
    """Read the index of the recording."""
    from omni_recording.folder import bag_summary, open_bag

    found = open_bag(options.bag)
    summary = bag_summary(found)
    metrics: dict[str, tuple[float, str]] = {
        "size": (sum(file.stat().st_size for file in found.files), "B"),
        "start": (summary.first_ns / quantities.SECOND_NS, "s"),
        "duration": ((summary.last_ns - summary.first_ns) / quantities.SECOND_NS, "s"),
        "messages": (sum(summary.counts.values()), "1"),
        "chunks": (summary.chunks, "1"),
    }
    metrics |= {f"messages.{topic}": (n, "1") for topic, n in summary.counts.items()}
    return Report(
        metrics=entries(metrics),
        details={
            "topics": {channel.topic: channel.type_name for channel in summary.channels},
            "ros_distro": found.ros_distro,
        },
        text=_text(found, summary, metrics),
    )


def _text(
    found: Bag, summary: McapSummary, metrics: Mapping[str, tuple[float, str]]
) -> Iterator[str]:
    duration = metrics["duration"][0]
    rows = [("topic", "type", "messages", "per second")]
    for channel in sorted(summary.channels, key=lambda channel: channel.topic):
        count = summary.counts[channel.topic]
        rate = f"{(count - 1) / duration:.1f}" if duration > 0.0 and count > 1 else ""
        rows.append((printable(channel.topic), printable(channel.type_name), str(count), rate))
    left, right = (max(len(row[column]) for row in rows) for column in (0, 1))
    for topic, kind, messages, rate in rows:
        yield f"{topic:<{left}}  {kind:<{right}}  {messages:>8}  {rate:>10}".rstrip()
    total, start = metrics["messages"][0], metrics["start"][0]
    yield f"{total} messages in {duration:.3f} s from {start:.3f} s on"
    packed = ", ".join(printable(word or "uncompressed") for word in summary.compressions)
    yield (
        f"{metrics['size'][0] / 1e6:.1f} MB in {len(found.files)} file(s), "
        f"{summary.chunks} chunks, {packed or 'empty'}"
    )
