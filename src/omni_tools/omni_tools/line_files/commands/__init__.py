"""``./omni lines``: import, show and correct lines of real cameras.

Import the lines of real cameras from files into a recording that `omni replay` can read, show the
lines of a recording, and compute tables that correct the fixed pattern of a camera.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from omni_core.commands.command_options import option
from omni_core.configuration import Configuration, ConfigurationError, parameter

if TYPE_CHECKING:
    from omni_tools.line_files.reading import RawFormat
    from omni_vehicle.camera.cut import Cut

PACKAGE = __name__


class FileOptions(Configuration):
    """Command-line options for the layout of lines in pictures and in raw bytes."""

    rows: str = option("", metavar="ROWS")
    """rows of each picture to use, such as 240 or 236:244 (default: all)"""
    band: bool = parameter(False)
    """average these rows into one line per picture"""
    columns: bool = parameter(False)
    """use the columns of the pictures as lines"""
    pixels: int = option(0, minimum=0, maximum=16384, unit="px")
    """number of pixels per line in raw bytes, which cannot be read without it"""
    bits: str = parameter("8", choices=("8", "16"))
    """number of bits per pixel in raw bytes"""

    @property
    def cut(self) -> Cut:
        """Selection of the rows or columns of each picture that are used as lines."""
        from omni_vehicle.camera.cut import Cut, row_range

        return Cut(row_range(self.rows, "--rows"), self.band, self.columns)

    @property
    def raw(self) -> RawFormat:
        """Layout of files with raw bytes, from the options."""
        from omni_tools.line_files.reading import RawFormat

        return RawFormat(self.pixels, int(self.bits))


def camera_files(
    sources: Sequence[str], known: Collection[str], where: str, key: str = "CAMERA=FILE"
) -> dict[str, Path]:
    """Return each camera's file, keyed by camera name, from texts such as ``left=left.npy``.

    Args:
        sources: arguments of the command line.
        known: names of the cameras.
        where: text that states where the camera names are defined, for error messages.
        key: key of the option, for error messages.

    Raises:
        ConfigurationError: an argument does not name a known camera, or two arguments name the same
            camera.
    """
    files: dict[str, Path] = {}
    for source in sources:
        name, equals, path = source.partition("=")
        if not equals or not path:
            raise ConfigurationError(
                key, f"{source!r} lacks the name of a camera, such as left={source}"
            )
        if name not in known:
            raise ConfigurationError(
                key, f"{name!r} is not a camera of {where}; cameras: {', '.join(known)}"
            )
        if name in files:
            raise ConfigurationError(key, f"{name} is given twice")
        files[name] = Path(path).expanduser()
    return files
