"""Interpolation of single defective pixels.

The optics blur every detail of the ground over several pixels. A pixel that differs from its
neighbors in the mean of a batch and in every line of it is defective, or a speck on the sensor. At
rest some sharp features of the ground may be interpolated too, without harm.
"""

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.measurements import Lines
from omni_platform.kernels import njit

Floats = NDArray[np.float32]

_FEWEST_LINES = 8
_SIDE = 2  # px to either side; a pixel is compared with their median
_OUTSTANDING = 9.0  # times the median difference of all pixels: 6 standard deviations
_IN_EACH = 0.5  # share of this limit that the pixel must exceed in every line
_MOST_DEFECTIVE = 0.03  # share of a line; if more pixels stand out, none counts as defective


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
    for i in range(count):  # beyond an end its pixel is repeated
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
        lines: consecutive lines, shape (m, n).
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
