"""Selection of the lines in a picture: rows, the mean of rows, or columns."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_core.configuration import ConfigurationError
from omni_core.signals import Lines


class FrameError(ValueError):
    """A picture contains no usable lines; the message states the reason."""


@dataclasses.dataclass(frozen=True)
class Cut:
    """Rows or columns of a picture that are used as lines.

    Attributes:
        rows: index of the first row, and index of the row after the last; None for all rows.
        mean: whether these rows are averaged into one line.
        columns: whether the lines are the columns of the picture.
    """

    rows: tuple[int, int] | None = None
    mean: bool = False
    columns: bool = False

    def lines(self, picture: NDArray[Any]) -> Lines:
        """Return the lines of a picture as 8 or 16 bit integers, shape (m, n).

        Raises:
            FrameError: the picture is not two-dimensional, does not contain the selected rows, or
                has values that are not gray levels.
        """
        if picture.ndim != 2:
            raise FrameError(f"has {picture.ndim} dimensions; an array of lines must have two")
        rows = picture.T if self.columns else picture
        if self.rows is not None:
            first, end = self.rows
            if not 0 <= first < end <= len(rows):
                raise FrameError(f"has {len(rows)} rows, but rows {first}:{end} are selected")
            rows = rows[first:end]
        if rows.dtype.kind == "f" and 0.0 < np.max(rows, initial=0.0) <= 1.0 and np.any(rows % 1.0):
            raise FrameError("has gray levels of at most 1: multiply them by 255")
        if self.mean:
            rows = rows.mean(axis=0, keepdims=True)
        return _whole(rows)


def row_range(text: str, key: str) -> tuple[int, int] | None:
    """Return the range of rows that a parameter selects; None for an empty text.

    The range consists of the index of the first row and the index of the row after the last.

    Args:
        text: value of the parameter, such as ``240`` or ``236:244``.
        key: name of the parameter, for messages.

    Raises:
        ConfigurationError: the text is neither a row nor a range of rows.
    """
    if not text:
        return None
    first, colon, end = text.partition(":")
    try:
        begin = int(first)
        return begin, int(end) if colon else begin + 1
    except ValueError:
        raise ConfigurationError(key, f"{text!r} is neither a row nor FIRST:END") from None


def _whole(rows: NDArray[Any]) -> Lines:
    """Return gray levels, rounded to 8-bit or 16-bit integers, in the shape of `rows`.

    Raises:
        FrameError: a gray level is outside 0 to 65535.
    """
    if rows.dtype in (np.uint8, np.uint16):
        return np.ascontiguousarray(rows)
    low, high = float(np.min(rows, initial=0)), float(np.max(rows, initial=0))
    if not (np.isfinite([low, high]).all() and low >= 0.0 and high <= 65535.0):
        raise FrameError(f"has gray levels from {low:g} to {high:g}, not 0 to 65535")
    wide = rows.dtype.kind not in "fb" and rows.dtype.itemsize > 1 and high > 255.0
    rounded = np.rint(rows)
    whole: Lines = rounded.astype(np.uint16 if wide or high > 255.0 else np.uint8)
    return whole
