"""``./omni bag``: show, check, export or recover a recording.

Look into recordings, check them, save them and make tables of them; nothing of ROS is needed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from omni_bringup.exit_codes import EXIT_FAILED, EXIT_REFUSED
from omni_platform.command_options import option

PACKAGE = __name__
_LONGEST_WORDS = 1000  # letters of what a recording may say


def bag_option() -> Any:
    """Declare the recording that an action is about."""
    return option(
        positional=True, metavar="BAG", description="rosbag2 folder, or a single .mcap file"
    )


def out_option(ending: str) -> Any:
    """Declare the new folder of what an action writes."""
    words = f"new folder (default: beside the recording, BAG_{ending})"
    return option(None, metavar="DIR", description=words)


def refusing(action: str, act: Callable[[], int]) -> int:
    """Return the exit code of an action, or say why it cannot be done."""
    from omni_recording.actions.export import ExportError
    from omni_recording.error import BagError
    from omni_recording.write import RecordingError

    try:
        return act()
    except (BagError, ExportError) as error:
        code = EXIT_REFUSED
        words = str(error)
    except RecordingError as error:
        code = EXIT_FAILED
        words = str(error)
    print(f"omni bag {action}: {printable(words)}", file=sys.stderr)
    return code


def printable(text: str) -> str:
    """Return words from a recording without what would steer a terminal, or fill it."""
    if len(text) > _LONGEST_WORDS:
        text = f"{text[:_LONGEST_WORDS]}... ({len(text)} letters)"
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def beside(path: Path, ending: str) -> Path:
    """Return the folder beside a recording for what is made of it."""
    path = path.absolute()
    return path.with_name(f"{path.stem if path.is_file() else path.name}_{ending}")


def document(name: str, metrics: Mapping[str, tuple[float, str]]) -> dict[str, Any]:
    """Return the document of what was counted, given as (value, unit) by name."""
    entries = {key: {"value": value, "unit": unit} for key, (value, unit) in metrics.items()}
    return {"name": name, "metrics": entries}


def print_json(document: Mapping[str, Any]) -> None:
    """Print a document for programs."""
    print(json.dumps(document, indent=2, allow_nan=False))
