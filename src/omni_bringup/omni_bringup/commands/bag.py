"""``./omni bag``: look into recordings, check them, save them, make tables of them.

Nothing of ROS is needed or imported.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_bringup.exit_codes import EXIT_FAILED, EXIT_OK, EXIT_REFUSED

if TYPE_CHECKING:
    from omni_recording.check import BagCheck
    from omni_recording.folder import Bag
    from omni_recording.mcap import McapSummary


_SECOND = 1e9  # [ns]
_MEGABYTE = 1e6  # [B]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the subcommands and their options to the parser of ``omni bag``."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    info = actions.add_parser(
        "info",
        help="show topics, types, counts and times",
        description="Show what a recording claims to hold, without reading its messages.",
    )
    check = actions.add_parser(
        "check",
        help="read everything and say what is wrong",
        description="Read a recording from end to end: every checksum, every message of a known "
        "type, the counts against the metadata, and gaps in the numbers of the messages. Exit "
        "code 1 if anything is wrong.",
    )
    export = actions.add_parser(
        "export",
        help="write the small topics as CSV or Parquet",
        description="Write one table for every topic whose messages are at most 256 values: times "
        "in nanoseconds, SI units, joints by name. Images are left out.",
    )
    export.add_argument(
        "--format", choices=("csv", "parquet"), default="csv", help="of the tables (%(default)s)"
    )
    export.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="NAME",
        help="export only this topic; may be repeated",
    )
    recover = actions.add_parser(
        "recover",
        help="save what is whole of an unfinished or damaged recording",
        description="Write every whole message into a new recording with index and metadata, and "
        "say what was kept. The recording itself is not touched.",
    )
    for action in (export, recover):
        action.add_argument(
            "--out",
            type=Path,
            metavar="DIR",
            help=f"new folder (default: beside the recording, BAG_{action.prog.split()[-1]}ed)",
        )
    for action in (info, check, export, recover):
        action.add_argument(
            "bag", type=Path, metavar="BAG", help="rosbag2 folder, or a single .mcap file"
        )
        action.add_argument("--json", action="store_true", help="print the results as JSON")


def bag(options: argparse.Namespace) -> int:
    """Do to a recording what the command line asks and return the exit code."""
    from omni_recording.error import BagError
    from omni_recording.export import ExportError
    from omni_recording.write import RecordingError

    actions = {"info": _info, "check": _check, "export": _export, "recover": _recover}
    try:
        return actions[options.action](options)
    except (BagError, ExportError) as error:
        print(f"omni bag {options.action}: {printable(str(error))}", file=sys.stderr)
        return EXIT_REFUSED
    except RecordingError as error:
        print(f"omni bag {options.action}: {printable(str(error))}", file=sys.stderr)
        return EXIT_FAILED


def printable(text: str) -> str:
    """Return words from a recording without what would steer a terminal."""
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def _info(options: argparse.Namespace) -> int:
    from omni_recording.folder import bag_summary, open_bag

    found = open_bag(options.bag)
    summary = bag_summary(found)
    size = sum(file.stat().st_size for file in found.files)
    if options.json:
        types = {channel.topic: channel.type_name for channel in summary.channels}
        document = _document("bag_info", _info_metrics(summary, size))
        _print_json(document | {"topics": types, "ros_distro": found.ros_distro})
    else:
        _print_info(found, summary, size)
    return EXIT_OK


def _info_metrics(summary: McapSummary, size: int) -> dict[str, tuple[float, str]]:
    duration = (summary.last_ns - summary.first_ns) / _SECOND
    metrics: dict[str, tuple[float, str]] = {
        "size": (size, "B"),
        "start": (summary.first_ns / _SECOND, "s"),
        "duration": (duration, "s"),
        "messages": (sum(summary.counts.values()), "1"),
        "chunks": (summary.chunks, "1"),
    }
    return metrics | {f"messages.{topic}": (n, "1") for topic, n in summary.counts.items()}


def _print_info(found: Bag, summary: McapSummary, size: int) -> None:
    duration = (summary.last_ns - summary.first_ns) / _SECOND
    rows = [("topic", "type", "messages", "per second")]
    for channel in sorted(summary.channels, key=lambda channel: channel.topic):
        count = summary.counts[channel.topic]
        rate = f"{(count - 1) / duration:.1f}" if duration > 0.0 and count > 1 else ""
        rows.append((printable(channel.topic), printable(channel.type_name), str(count), rate))
    left, right = (max(len(row[column]) for row in rows) for column in (0, 1))
    for topic, kind, messages, rate in rows:
        print(f"{topic:<{left}}  {kind:<{right}}  {messages:>8}  {rate:>10}".rstrip())
    total = sum(summary.counts.values())
    print(f"{total} messages in {duration:.3f} s from {summary.first_ns / _SECOND:.3f} s on")
    packed = ", ".join(printable(word or "uncompressed") for word in summary.compressions)
    print(
        f"{size / _MEGABYTE:.1f} MB in {len(found.files)} file(s), {summary.chunks} chunks, "
        f"{packed or 'empty'}"
    )


def _check(options: argparse.Namespace) -> int:
    from omni_recording.check import check_bag

    result = check_bag(options.bag)
    code = EXIT_FAILED if result.problems else EXIT_OK
    if options.json:
        metrics = {f"messages.{topic}": (float(n), "1") for topic, n in result.counts.items()}
        metrics["problems"] = (float(len(result.problems)), "1")
        document = _document("bag_check", metrics)
        _print_json(document | {"problems": result.problems, "remarks": result.remarks})
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


def _export(options: argparse.Namespace) -> int:
    from omni_recording.export import export_bag

    folder = options.out or _beside(options.bag, "exported")
    result = export_bag(options.bag, folder, options.format, options.topic)
    if options.json:
        metrics = {f"rows.{topic}": (float(count), "1") for topic, count in result.rows.items()}
        files = {topic: str(file) for topic, file in result.files.items()}
        _print_json(_document("bag_export", metrics) | {"files": files, "skipped": result.skipped})
        return EXIT_OK
    for topic, file in result.files.items():
        print(f"wrote {file}: {result.rows[topic]} rows")
    for topic, why in result.skipped.items():
        print(f"left out {printable(topic)}: {printable(why)}")
    return EXIT_OK


def _recover(options: argparse.Namespace) -> int:
    from omni_recording.recover import recover

    result = recover(options.bag, options.out or _beside(options.bag, "recovered"))
    if result is None:
        if options.json:
            _print_json(_document("bag_recover", {}) | {"folder": None, "problems": []})
        else:
            print(f"{options.bag}: nothing is wrong with it, so nothing was written")
        return EXIT_OK
    total = sum(result.counts.values())
    metrics: dict[str, tuple[float, str]] = {
        "messages": (total, "1"),
        "start": (result.first_ns / _SECOND, "s"),
        "end": (result.last_ns / _SECOND, "s"),
    }
    metrics |= {f"messages.{topic}": (n, "1") for topic, n in result.counts.items()}
    if options.json:
        document = _document("bag_recover", metrics)
        _print_json(document | {"folder": str(result.folder), "problems": result.problems})
        return EXIT_OK
    for line in result.problems:
        print(f"wrong: {printable(line)}")
    for topic, count in sorted(result.counts.items()):
        print(f"kept {count:>8} {printable(topic)}")
    print(
        f"kept {total:>8} messages from {result.first_ns / _SECOND:.3f} s to "
        f"{result.last_ns / _SECOND:.3f} s in {result.folder}"
    )
    return EXIT_OK


def _beside(path: Path, ending: str) -> Path:
    path = path.absolute()
    return path.with_name(f"{path.stem if path.is_file() else path.name}_{ending}")


def _document(name: str, metrics: Mapping[str, tuple[float, str]]) -> dict[str, Any]:
    entries = {key: {"value": value, "unit": unit} for key, (value, unit) in metrics.items()}
    return {"name": name, "metrics": entries}


def _print_json(document: Mapping[str, Any]) -> None:
    print(json.dumps(document, indent=2, allow_nan=False))
