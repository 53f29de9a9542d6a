"""Reading of a camera's lines from files of frame grabbers and cameras.

A *stack* is a folder of pictures in the order of their names, or a single picture with one or more
pages. Each row of a picture is a line. For an area camera, `Cut` selects one row or the mean of
several rows of each picture. Arrays (NPY), tables (CSV, one line per row) and raw bytes contain
only lines. Reading a video requires OpenCV.
"""

import dataclasses
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageSequence

from omni_core import configuration, signals
from omni_vehicle.camera.cut import Cut, FrameError
from omni_vehicle.camera.sources import INSTALL, VIDEOS

PICTURES = (".png", ".tif", ".tiff", ".bmp", ".pgm", ".jpg", ".jpeg")
RAW = (".raw", ".bin", ".dat")

_GRAY_8 = ("L", "P", "1", "RGB", "RGBA", "LA")
_MOST_BYTES = 1 << 32  # limit on the size of all lines of a file or folder [B]


class LineFileError(configuration.ConfigurationError):
    """A file cannot be read as lines; the message names the file and the reason."""

    def __init__(self, path: Path | str, problem: str) -> None:
        super().__init__(str(path), problem)


@dataclasses.dataclass(frozen=True)
class RawFormat:
    """Layout of a file of raw bytes.

    Attributes:
        pixels: number of pixels per line; 0 if unknown, in which case raw bytes cannot be read.
        bits: number of bits per pixel, 8 or 16 (little endian).
    """

    pixels: int = 0
    bits: int = 8


def read_lines(path: Path, cut: Cut, raw: RawFormat = RawFormat()) -> signals.Lines:
    """Return the lines in a file or folder, oldest first, as 8 or 16 bit integers, shape (m, n).

    Args:
        path: file, or folder of pictures.
        cut: rows or columns of each picture that are used as lines.
        raw: layout of files with raw bytes.

    Raises:
        LineFileError: the file cannot be read, contains no line or more than 4 GiB, or its lines
            differ in length or type.
    """
    if not path.exists():
        raise LineFileError(path, "there is no such file or folder")
    lengths: set[tuple[int, str]] = set()
    parts: list[signals.Lines] = []
    size = 0
    try:
        for frame in _frames(path, raw):
            part = cut.lines(frame)
            lengths.add((part.shape[1], str(part.dtype)))
            if len(lengths) > 1:
                found = " and ".join(f"{n} px of {kind}" for n, kind in sorted(lengths))
                raise LineFileError(
                    path, f"contains lines of {found}; all lines must be equally long"
                )
            size += part.nbytes
            if size > _MOST_BYTES:
                raise LineFileError(
                    path,
                    f"contains more than {_MOST_BYTES >> 30} GiB of lines: import it in pieces",
                )
            parts.append(part)
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        if isinstance(error, LineFileError):
            raise
        if isinstance(error, FrameError):
            raise LineFileError(path, str(error)) from None
        words = " ".join(str(error).split())
        raise LineFileError(path, f"cannot be read: {words}") from None
    if not any(len(part) for part in parts):
        raise LineFileError(path, "contains no line")
    return np.ascontiguousarray(np.concatenate(parts))


def constant_rate(path: Path, counts: set[int]) -> tuple[float, int]:
    """Return line rate [1/s] and stamp of the first line [ns] from the times of all lines.

    Args:
        path: CSV or NPY file with the time of each line [s].
        counts: numbers of lines of the cameras.

    Raises:
        LineFileError: the file cannot be read, has another number of times, or the times are not
            those of lines at a constant rate, within half a period.
    """
    try:
        read = np.load(path, allow_pickle=False) if path.suffix == ".npy" else _table(path)
        times = np.asarray(read, np.float64).ravel()
    except (OSError, ValueError, EOFError) as error:
        raise LineFileError(path, f"cannot be read: {' '.join(str(error).split())}") from None
    if counts != {len(times)} or len(times) < 2:
        found = " and ".join(map(str, sorted(counts)))
        raise LineFileError(path, f"has {len(times)} times for {found} lines")
    numbers = np.arange(len(times))
    period, first = np.polyfit(numbers, times - times[0], 1)
    late = times - times[0] - first - period * numbers
    if not np.all(np.isfinite(times)) or period <= 0.0 or np.max(np.abs(late)) > 0.5 * period:
        steps = 1e3 * np.diff(times)
        raise LineFileError(
            path,
            f"the lines have no constant rate: {np.min(steps):.3g} to {np.max(steps):.3g} ms from "
            "line to line; lines were lost, or an encoder triggers the camera: let it run freely, "
            "or trigger it by a clock",
        )
    return float(1.0 / period), round(1e9 * float(times[0] + first))


def _frames(path: Path, raw: RawFormat) -> Iterator[NDArray[Any]]:
    """Yield the pictures of a file or folder as arrays of two dimensions."""
    suffix = path.suffix.lower()
    if path.is_dir():
        files = [p for p in path.iterdir() if p.suffix.lower() in PICTURES and p.is_file()]
        if not files:
            raise LineFileError(path, f"holds no picture ({', '.join(PICTURES)})")
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
        if raw.pixels <= 0:
            raise LineFileError(
                path, "contains raw bytes: set the number of pixels per line with --pixels"
            )
        values = np.fromfile(path, f"<u{raw.bits // 8}")
        if len(values) % raw.pixels:
            raise LineFileError(
                path, f"{len(values)} pixels are not a whole number of lines of {raw.pixels} px"
            )
        yield values.reshape(-1, raw.pixels)
    elif suffix in VIDEOS:
        yield from _video(path)
    else:
        known = ", ".join((*PICTURES, ".npy", ".csv", *RAW, *VIDEOS))
        raise LineFileError(path, f"is none of {known}, nor a folder of pictures")


def _by_number(path: Path) -> list[Any]:
    """Return a key that sorts names by the numbers in them: frame2 before frame10."""
    words = re.split(r"(\d+)", path.name)
    return [int(word) if word.isdigit() else word for word in words]


def _pages(path: Path) -> Iterator[NDArray[Any]]:
    with Image.open(path) as image:
        for page in ImageSequence.Iterator(image):
            gray = page if page.mode.startswith("I") else page.convert("L")
            if page.mode not in _GRAY_8 and not page.mode.startswith("I"):
                raise LineFileError(path, f"has pixels of the mode {page.mode}, not gray")
            yield np.array(gray)


def _table(path: Path) -> NDArray[Any]:
    text = path.read_text(encoding="utf-8-sig")
    delimiter = next((mark for mark in ";\t," if mark in text), None)
    rows = [line for line in text.splitlines() if line.strip()]
    if rows and re.search(r"[^\s\d.,;+eE-]", rows[0]):
        rows = rows[1:]  # without the column names
    return np.loadtxt(rows, delimiter=delimiter, ndmin=2) if rows else np.empty((0, 1), np.uint8)


def _video(path: Path) -> Iterator[NDArray[Any]]:
    try:
        cv2: Any = importlib.import_module("cv2")
    except ImportError:
        raise LineFileError(
            path,
            f"is a video, which requires OpenCV: {INSTALL.format('opencv')}; or give its frames as "
            "pictures",
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
