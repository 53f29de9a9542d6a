"""Interpolation of single defective pixels.

The optics blur every detail of the ground over several pixels. If a pixel differs from its
neighbors both in the mean of a batch and in each line, it is defective, or a speck of dirt covers
it. At rest, some sharp features of the ground may be interpolated too, which does no harm.
"""

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.joint.spectra import Floats
from omni_platform.kernels import kernel
from omni_platform.signals import Lines

FEWEST_LINES = 8
"""Smallest number of lines from which a fixed pattern is estimated."""

_OUTSTANDING = 9.0  # times the median difference of all pixels, or 6 standard deviations


@kernel
def _outstanding(lines: Lines) -> tuple[NDArray[np.int64], Floats]:
    """Return the pixels whose mean is far from the median of the pixels within 2 px.

    Returns:
        The pixels, shape (d,); mean minus median of every pixel, shape (n,).
    """
    m, n = lines.shape
    mean = np.zeros(n, np.float32)
    for k in range(m):
        for i in range(n):
            mean[i] += lines[k, i]
    mean /= np.float32(m)
    excess = np.empty(n, np.float32)
    for i in range(n):
        a, b = mean[max(i - 2, 0)], mean[max(i - 1, 0)]
        c, d = mean[min(i + 1, n - 1)], mean[min(i + 2, n - 1)]
        low, high = max(min(a, b), min(c, d)), min(max(a, b), max(c, d))
        excess[i] = mean[i] - min(max(mean[i], min(low, high)), max(low, high))
    deviation = np.abs(excess)
    limit = max(_OUTSTANDING * np.median(deviation), 1.0)
    found: NDArray[np.int64] = np.flatnonzero(deviation > limit)
    return found, excess


def _defects(lines: Lines) -> NDArray[np.int64]:
    """Return the pixels that differ from the median of the pixels within 2 px, in every line."""
    found, excess = _outstanding(lines)
    if len(found) == 0:
        return np.asarray(found)
    near = (found[:, np.newaxis] + np.arange(-2, 3)).clip(0, lines.shape[1] - 1)
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
