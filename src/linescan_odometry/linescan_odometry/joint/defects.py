"""Interpolation of single defective pixels.

The optics blur every detail of the ground over several pixels. If a pixel differs from its
neighbors both in the mean of a batch and in each line, it is defective, or a speck of dirt covers
it. At rest, some sharp features of the ground may be interpolated too, which does no harm.
"""

import numpy as np
from numpy.typing import NDArray

from omni_platform.signals import Lines

FEWEST_LINES = 8
"""Smallest number of lines from which a fixed pattern is estimated."""

_OUTSTANDING = 9.0  # times the median difference of all pixels, or 6 standard deviations


def _defects(lines: Lines) -> NDArray[np.int64]:
    """Return the pixels that differ from the median of the pixels within 2 px, in every line."""
    mean = lines.mean(axis=0, dtype=np.float32)
    around = np.pad(mean, 2, mode="edge")
    a, b, c, d = around[:-4], around[1:-3], around[3:-1], around[4:]
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    excess = mean - np.clip(mean, np.minimum(low, high), np.maximum(low, high))
    deviation = np.abs(excess)
    found = np.flatnonzero(deviation > max(_OUTSTANDING * float(np.median(deviation)), 1.0))
    near = (found[:, np.newaxis] + np.arange(-2, 3)).clip(0, len(mean) - 1)
    in_lines = lines[:, found] - np.median(lines[:, near], axis=2)
    defective = (in_lines * np.sign(excess[found])).min(axis=0) > 0.0
    return np.asarray(found[defective])


def without_defects(lines: Lines) -> Lines:
    """Interpolate the defective pixels; without any, the same lines are returned.

    Args:
        lines: consecutive lines, shape (m, n).
    """
    if len(lines) < FEWEST_LINES:
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
