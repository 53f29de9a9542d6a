"""``./omni bag recover``: recover the complete messages of an unfinished or damaged recording.

Write every complete message into a new recording with index and metadata, and report the numbers of
recovered and of lost messages. The original recording is not changed.
"""

from pathlib import Path

from omni_core import quantities
from omni_core.commands.command_options import CommandOptions
from omni_core.commands.command_report import Report, entries, printable
from omni_core.commands.workspace import Workspace
from omni_recording.commands import bag_option, beside, out_option

WORK = "saving messages"


class Options(CommandOptions):
    """Options of ``omni bag recover``."""

    bag: Path = bag_option()
    out: Path | None = out_option("recovered")


def run(options: Options, _workspace: Workspace) -> Report:
    """Write the complete messages into a new recording."""
    from omni_recording.actions.recover import recover

    result = recover(options.bag, options.out or beside(options.bag, "recovered"))
    if result is None:
        return Report(
            details={"folder": None, "problems": []},
            text=(f"{options.bag}: the recording is undamaged, so nothing was written",),
        )
    total = sum(result.counts.values())
    start, end = result.first_ns / quantities.SECOND_NS, result.last_ns / quantities.SECOND_NS
    metrics: dict[str, tuple[float, str]] = {
        "messages": (total, "1"),
        "start": (start, "s"),
        "end": (end, "s"),
    }
    metrics |= {f"messages.{topic}": (n, "1") for topic, n in result.counts.items()}
    metrics["lost"] = (sum(result.lost.values()), "1")
    metrics |= {f"lost.{topic}": (n, "1") for topic, n in result.lost.items()}
    return Report(
        metrics=entries(metrics),
        details={"folder": str(result.folder), "problems": result.problems},
        text=(
            *(f"wrong: {printable(line)}" for line in result.problems),
            *(f"kept {n:>8} {printable(topic)}" for topic, n in sorted(result.counts.items())),
            *(
                f"lost {n:>8} {printable(topic or 'unknown topic')}"
                for topic, n in sorted(result.lost.items())
            ),
            f"kept {total:>8} messages from {start:.3f} s to {end:.3f} s in {result.folder}",
        ),
    )
