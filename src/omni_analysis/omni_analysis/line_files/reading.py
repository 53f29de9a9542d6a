"""Reads the lines of a camera from the files that frame grabbers and cameras leave.

A *stack* is a folder of pictures, taken in the order of their names, or a single one with one or
many pages. Every row of a picture is a line, unless `Cut` takes one row or the mean of a band of
each, as of an area camera that looks at the ground. Arrays (NPY), tables (CSV, a line in a row) and
raw bytes hold lines alone; a video needs OpenCV.
"""

from __future__ import annotations

import dataclasses
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageSequence

from linescan_odometry.measurements import Lines
from omni_platform.configuration import ConfigurationError

PICTURES = (".png", ".tif", ".tiff", ".bmp", ".pgm", ".jpg", ".jpeg")
VIDEOS = (".avi", ".mp4", ".mkv", ".mov", ".m4v")
RAW = (".raw", ".bin", ".dat")

_GREY_8 = ("L", "P", "1", "RGB", "RGBA", "LA")
_DEEPEST = {8: np.uint8, 16: np.uint16}
_MOST = 1 << 32  # bytes of lines that are taken into memory


class LineFileError(ConfigurationError):
    """A file holds no lines; names it and says what is wrong."""


@dataclasses.dataclass(frozen=True)
class Cut:
    """What of a file is lines.

    Attributes:
        rows: first row of each picture that counts and the one behind the last; None for all.
        mean: whether the rows of a picture are averaged to one line.
        columns: whether the lines are the columns of the pictures.
        pixels: of a line in raw bytes; 0 where the file says it.
        bits: of a pixel in raw bytes, 8 or 16 (little endian).
    """

    rows: tuple[int, int] | None = None
    mean: bool = False
    columns: bool = False
    pixels: int = 0
    bits: int = 8


def read_lines(path: Path, cut: Cut) -> Lines:
    """Return the lines of a file or folder, oldest first, 8 or 16 bit, shape (m, n).

    Raises:
        LineFileError: it cannot be read, holds no line, or lines of different lengths.
    """
    if not path.exists():
        raise LineFileError(str(path), "there is no such file or folder")
    lengths: set[tuple[int, str]] = set()
    parts: list[Lines] = []
    size = 0
    try:
        for frame in _frames(path, cut):
            part = _cut(path, frame, cut)
            lengths.add((part.shape[1], str(part.dtype)))
            if len(lengths) > 1:
                told = " and ".join(f"{n} px of {kind}" for n, kind in sorted(lengths))
                raise LineFileError(str(path), f"holds lines of {told}; they must be alike")
            size += part.nbytes
            if size > _MOST:
                raise LineFileError(
                    str(path), f"holds more than {_MOST >> 30} GiB of lines: import it in pieces"
                )
            parts.append(part)
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        if isinstance(error, LineFileError):
            raise
        words = " ".join(str(error).split())
        raise LineFileError(str(path), f"cannot be read: {words}") from None
    if not any(len(part) for part in parts):
        raise LineFileError(str(path), "holds no line")
    lines: Lines = np.ascontiguousarray(np.concatenate(parts))
    return lines


def _frames(path: Path, cut: Cut) -> Iterator[NDArray[Any]]:
    """Yield the pictures of a file or folder as arrays of two dimensions."""
    suffix = path.suffix.lower()
    if path.is_dir():
        files = [p for p in path.iterdir() if p.suffix.lower() in PICTURES and p.is_file()]
        if not files:
            raise LineFileError(str(path), f"holds no picture ({', '.join(PICTURES)})")
        for file in sorted(files, key=_by_number):
            yield from _pages(file)
    elif suffix in PICTURES:
        yield from _pages(path)
    elif suffix == ".npy":
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        yield from array if array.ndim == 3 else (array,)
    elif suffix in {".csv", ".txt"}:
        yield _table(path)
    elif suffix in RAW:
        if cut.pixels <= 0:
            raise LineFileError(str(path), "is raw: say how many pixels a line has with --pixels")
        values = np.fromfile(path, np.dtype(_DEEPEST[cut.bits]).newbyteorder("<"))
        if len(values) % cut.pixels:
            raise LineFileError(
                str(path), f"{len(values)} pixels are no whole number of lines of {cut.pixels} px"
            )
        yield values.reshape(-1, cut.pixels)
    elif suffix in VIDEOS:
        yield from _video(path)
    else:
        known = ", ".join((*PICTURES, ".npy", ".csv", *RAW, *VIDEOS))
        raise LineFileError(str(path), f"is none of {known}, nor a folder of pictures")


def _by_number(path: Path) -> list[Any]:
    """Order names as people count: frame2 before frame10."""
    words = re.split(r"(\d+)", path.name)
    return [int(word) if word.isdigit() else word for word in words]


def _pages(path: Path) -> Iterator[NDArray[Any]]:
    with Image.open(path) as image:
        for page in ImageSequence.Iterator(image):
            grey = page if page.mode.startswith("I") else page.convert("L")
            if page.mode not in _GREY_8 and not page.mode.startswith("I"):
                raise LineFileError(str(path), f"has pixels of the mode {page.mode}, not grey")
            yield np.array(grey)


def _table(path: Path) -> NDArray[Any]:
    text = path.read_text(encoding="utf-8-sig")
    delimiter = next((mark for mark in ";\t," if mark in text), None)
    rows = [line for line in text.splitlines() if line.strip()]
    if rows and re.search(r"[^\s\d.,;+eE-]", rows[0]):
        rows = rows[1:]  # names of the columns
    return np.loadtxt(rows, delimiter=delimiter, ndmin=2) if rows else np.empty((0, 1), np.uint8)


def _video(path: Path) -> Iterator[NDArray[Any]]:
    try:
        cv2: Any = importlib.import_module("cv2")
    except ImportError:
        raise LineFileError(
            str(path),
            "is a video, which needs OpenCV: ./omni exec python -m pip install --no-deps "
            "--require-hashes -r requirements/benchmarks.lock; or give its frames as pictures",
        ) from None
    film = cv2.VideoCapture(str(path))
    try:
        while True:
            there, frame = film.read()
            if not there:
                return
            yield frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    finally:
        film.release()


def _cut(path: Path, frame: NDArray[Any], cut: Cut) -> Lines:
    """Return what of a picture is lines."""
    if frame.ndim != 2:
        raise LineFileError(str(path), f"has {frame.ndim} dimensions, a stack of lines has two")
    rows = frame.T if cut.columns else frame
    if cut.rows is not None:
        first, end = cut.rows
        if not 0 <= first < end <= len(rows):
            raise LineFileError(
                str(path), f"has {len(rows)} rows, of which {first}:{end} cannot be taken"
            )
        rows = rows[first:end]
    if cut.mean:
        rows = rows.mean(axis=0, keepdims=True)
    return _whole(path, rows)


def _whole(path: Path, rows: NDArray[Any]) -> Lines:
    """Return grey levels as 8 or 16 bit."""
    if rows.dtype in (np.uint8, np.uint16):
        return np.ascontiguousarray(rows)
    low, high = float(np.min(rows, initial=0)), float(np.max(rows, initial=0))
    if not (np.isfinite([low, high]).all() and low >= 0.0 and high <= 65535.0):
        raise LineFileError(str(path), f"has grey levels from {low:g} to {high:g}, not 0 to 65535")
    wide = rows.dtype.kind not in "fb" and rows.dtype.itemsize > 1 and high > 255.0
    rounded = np.rint(rows)
    whole: Lines = rounded.astype(np.uint16 if wide or high > 255.0 else np.uint8)
    return whole
