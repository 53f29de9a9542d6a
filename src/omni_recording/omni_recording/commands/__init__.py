"""``./omni bag``: show, check, export or recover a recording.

Show the content of recordings, check them, recover them, and export tables; ROS is not needed.
"""

from pathlib import Path
from typing import Any

from omni_core.commands.command_options import option

PACKAGE = __name__


def bag_option() -> Any:
    """Declare the argument for the recording."""
    return option(
        positional=True, metavar="BAG", description="rosbag2 folder, or a single .mcap file"
    )


def out_option(ending: str) -> Any:
    """Declare the option for the folder into which a command writes its files."""
    words = f"new folder (default: next to the recording, BAG_{ending})"
    return option(None, metavar="DIR", description=words)


def beside(path: Path, ending: str) -> Path:
    """Return the path of a folder next to a recording, for files computed from the recording."""
    path = path.absolute()
    return path.with_name(f"{path.stem if path.is_file() else path.name}_{ending}")
