"""Removal of the fixed pattern before the flat field is estimated.

Dirt, steps of the dark signal or unequal pixels are the same in every line, and bias every match
towards zero: on a ground of low contrast by half a pixel per line, at any speed. The mean of all
lines so far contains them, and a share of the ground that decreases with the distance. It is
subtracted, and the lines are matched again: if the displacement changes, the first one was biased.

Single defective pixels differ from their neighbors in the mean of a batch, in which moving ground
is smeared, and in every line of it. They are interpolated. At rest some features of the ground may
be interpolated too, without harm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.measurements import Lines
from omni_platform.kernels import njit
from omni_platform.quantities import FloatArray

Floats = NDArray[np.float32]

STRUCTURE = 0.12
"""Smallest correlation of neighboring pixels of a difference that is not only noise."""

_REMEMBERED = 200.0  # batches that show all new ground
_RANGE = 30000.0  # of 16 bit to either side
_MIDDLE = 32768.0
_FORGOTTEN = 0.999  # of the largest change of late
_FEWEST_LINES = 8
_SIDE = 2  # px to either side, with whose median a pixel is compared
_OUTSTANDING = 9.0  # times the median of all differences from it: 6 standard deviations
_IN_EACH = 0.5  # of that, in every line
_MOST_DEFECTIVE = 0.03  # share of a line


@njit(cache=True, error_model="numpy")
def structure_of(change: Floats | FloatArray) -> tuple[float, float]:
    """Return the mean product of neighboring pixels of a difference, and its mean square.

    Args:
        change: of a line, shape (n,).
    """
    mean = 0.0
    for i in range(len(change)):
        mean += change[i]
    mean /= len(change)
    structure, square, before = 0.0, 0.0, 0.0
    for i in range(len(change)):
        value = change[i] - mean
        structure += value * before
        square += value * value
        before = value
    return structure, square


class StillView:
    """Mean of the lines of one camera, with batches weighted by their share of new ground.

    Attributes:
        weight: equivalent number of batches over new ground so far, 0 if none moved.
    """

    def __init__(self, pixels: int) -> None:
        """Start without lines.

        Args:
            pixels: n of a line.
        """
        self.weight = 0.0
        self._mean: Floats = np.zeros(pixels, np.float32)
        self._largest = 0.0

    def learn(self, lines: Lines) -> None:
        """Add a batch.

        Args:
            lines: that follow each other, oldest first, shape (m, n).
        """
        structure, square = structure_of(lines[-1].astype(np.float32) - lines[0])
        if structure <= STRUCTURE * square:
            return
        self._largest = max(self._largest * _FORGOTTEN, structure)
        share = structure / self._largest
        self.weight = min(self.weight + share, _REMEMBERED)
        _enter(lines, share / self.weight, self._mean)

    def without(self, lines: Lines) -> Lines:
        """Return lines without the fixed pattern, 16 bit, shape (m, n)."""
        rest = lines - self._mean
        rest -= rest.mean(axis=1, keepdims=True)
        scale = np.float32(_RANGE / max(float(np.abs(rest).max()), 1.0))
        moving: Lines = np.rint(rest * scale + np.float32(_MIDDLE)).astype(np.uint16)
        return moving


@njit(cache=True, error_model="numpy")
def _average(lines: Lines) -> Floats:
    """Return the mean of lines, shape (n,)."""
    total = np.zeros(lines.shape[1], np.int32)
    for row in range(len(lines)):
        line = lines[row]
        for i in range(len(total)):
            total[i] += np.int32(line[i])
    return (total / len(lines)).astype(np.float32)


@njit(cache=True, error_model="numpy")
def _enter(lines: Lines, share: float, mean: Floats) -> None:
    """Update the mean with that of new lines, without its level."""
    own = _average(lines)
    level = own.mean()
    for i in range(len(mean)):
        mean[i] += np.float32(share) * (own[i] - level - mean[i])


@njit(cache=True, error_model="numpy")
def _median_of_three(a: float, b: float, c: float) -> float:
    middle: float = max(min(a, b), min(max(a, b), c))
    return middle


@njit(cache=True, error_model="numpy")
def _stand_out(mean: Floats, out: Floats) -> bool:
    """Write the difference of each pixel of the mean to its neighbors.

    Returns:
        Whether any difference may exceed `_OUTSTANDING` times the median.
    """
    count = len(mean)
    highest = np.float32(0.0)
    for i in range(count):  # the ends count more often
        a, b = mean[max(i - 2, 0)], mean[max(i - 1, 0)]
        c, d = mean[min(i + 1, count - 1)], mean[min(i + 2, count - 1)]
        low = max(min(a, b), min(c, d))
        high = min(max(a, b), max(c, d))
        out[i] = mean[i] - _median_of_three(low, high, mean[i])
        highest = max(highest, abs(out[i]))
    least = highest * np.float32(1.001 / _OUTSTANDING)
    below = 0
    for i in range(count):
        below += abs(out[i]) <= least
    return bool(highest > np.float32(1.0)) and below > count // 2


@njit(cache=True, error_model="numpy")
def _defects(lines: Lines) -> NDArray[np.int64]:
    """Return the pixels that differ from their neighbors, in the mean and in every line."""
    pixels = lines.shape[1]
    none = np.empty(0, np.int64)
    out = np.empty(pixels, np.float32)
    if not _stand_out(_average(lines), out):
        return none
    deviation = np.abs(out)
    middle = float(np.partition(deviation, pixels // 2)[pixels // 2])
    limit = max(_OUTSTANDING * middle, 1.0)
    found = np.flatnonzero(deviation > np.float32(limit))
    if not 0 < len(found) <= _MOST_DEFECTIVE * pixels:
        return none
    defective = np.zeros(len(found), np.bool_)
    near = np.empty(2 * _SIDE + 1)
    for k in range(len(found)):
        i = found[k]
        sign = 1.0 if out[i] > np.float32(0.0) else -1.0
        least = np.inf
        for row in range(len(lines)):
            for j in range(len(near)):
                near[j] = lines[row, min(max(i + j - _SIDE, 0), pixels - 1)]
            near.sort()
            least = min(least, (float(lines[row, i]) - near[_SIDE]) * sign)
        defective[k] = least > _IN_EACH * limit
    return found[defective]


def without_defects(lines: Lines) -> Lines:
    """Return lines whose defective pixels are interpolated, the same lines if there are none.

    Args:
        lines: that follow each other, shape (m, n).
    """
    if len(lines) < _FEWEST_LINES:
        return lines
    pixels = lines.shape[1]
    defective = _defects(lines)
    if len(defective) == 0:
        return lines
    sound = np.setdiff1d(np.arange(pixels), defective, assume_unique=True)
    after = np.searchsorted(sound, defective).clip(1, len(sound) - 1)
    left, right = sound[after - 1], sound[after]
    share = ((defective - left) / (right - left)).clip(0.0, 1.0).astype(np.float32)
    mended: Lines = lines.copy()
    between = (1.0 - share) * lines[:, left] + share * lines[:, right]
    mended[:, defective] = np.rint(between).astype(lines.dtype)
    return mended
