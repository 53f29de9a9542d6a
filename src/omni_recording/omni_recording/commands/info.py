"""``./omni bag info``: show topics, types, counts and times.

Show the index of a recording without reading its messages. The exit code is 1 if the times in the
index are impossible.
"""

import math
from pathlib import Path

from omni_core import quantities
from omni_core.commands.command_options import CommandOptions
from omni_core.commands.command_report import Report, entries, printable
from omni_core.commands.workspace import Workspace
from omni_recording.commands import bag_option

WORK = "reading the recording"


class Options(CommandOptions):
    """Options of ``omni bag info``."""

    bag: Path = bag_option()


def run(options: Options, _workspace: Workspace) -> Report:
    """Read the index of the recording, and report topics, types, counts and times."""
    from omni_recording.folder import bag_summary, open_bag
    from omni_recording.mcap import is_possible

    found = open_bag(options.bag)
    summary = bag_summary(found)
    size = sum(file.stat().st_size for file in found.files)
    start = summary.first_ns / quantities.SECOND_NS
    end = summary.last_ns / quantities.SECOND_NS
    problems = []
    if not is_possible(summary.last_ns) or summary.first_ns > summary.last_ns:
        problems.append(
            f"{options.bag}: the index gives impossible times, from {start:.3f} s to {end:.3f} s; "
            "`omni bag recover` keeps the messages with possible times"
        )
    duration = math.nan if problems else end - start
    extent = "" if problems else f" within {duration:.3f} s, beginning at {start:.3f} s"
    total = sum(summary.counts.values())
    metrics: dict[str, tuple[float, str]] = {
        "size": (size, "B"),
        "start": (start, "s"),
        "duration": (duration, "s"),
        "messages": (total, "1"),
        "chunks": (summary.chunks, "1"),
    }
    metrics |= {f"messages.{topic}": (n, "1") for topic, n in summary.counts.items()}
    rows = [("topic", "type", "messages", "per second")]
    for channel in sorted(summary.channels, key=lambda channel: channel.topic):
        count = summary.counts[channel.topic]
        rate = f"{(count - 1) / duration:.1f}" if duration > 0.0 and count > 1 else ""
        rows.append((printable(channel.topic), printable(channel.type_name), str(count), rate))
    left, right = (max(len(row[column]) for row in rows) for column in (0, 1))
    packed = ", ".join(printable(word or "uncompressed") for word in summary.compressions)
    return Report(
        metrics=entries(metrics),
        details={
            "topics": {channel.topic: channel.type_name for channel in summary.channels},
            "ros_distro": found.ros_distro,
        },
        text=(
            *(
                f"{topic:<{left}}  {kind:<{right}}  {messages:>8}  {rate:>10}".rstrip()
                for topic, kind, messages, rate in rows
            ),
            f"{total} messages{extent}",
            f"{size / 1e6:.1f} MB in {len(found.files)} file(s), {summary.chunks} chunks, "
            f"{packed or 'empty'}",
        ),
        problems=problems,
    )
