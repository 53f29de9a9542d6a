"""Finds the peak of the similarity again on smoothed lines, near a whole pixel that noise chose.

Where the texture is coarse and weak the similarity hardly changes from one pixel to the next, and
noise moves its peak by two pixels or three: too far for Gauss-Newton steps. Smoothing by a
Gaussian of two pixels takes out most of the noise and little of such a texture.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.measurements import Lines

_SIGMA = 2.0  # px
_RADIUS = 5  # px
_KERNEL = np.exp(-0.5 * (np.arange(-_RADIUS, _RADIUS + 1) / _SIGMA) ** 2)
_KERNEL /= _KERNEL.sum()


def smoothed_peak(old: Lines, new: Lines, shift: int, reach: int) -> int:
    """Return the shift at which the smoothed lines match best.

    Args:
        old: a line, shape (n,).
        new: the line after it, shape (n,).
        shift: where they match best without smoothing [px].
        reach: how far to look from there [px].
    """
    smooth_old, smooth_new = _smooth(old), _smooth(new)
    length = len(smooth_new)
    best, best_shift = -math.inf, shift
    for s in sorted(range(shift - reach, shift + reach + 1), key=lambda s: abs(s - shift)):
        overlap = length - abs(s)
        if overlap < 2:
            continue
        x = smooth_new[max(0, -s) :][:overlap]
        y = smooth_old[max(0, s) :][:overlap]
        r = _correlation(x, y)
        if r > best:
            best, best_shift = r, s
    return best_shift


def _smooth(line: Lines) -> NDArray[np.float64]:
    return np.convolve(line.astype(np.float64), _KERNEL, mode="valid")


def _correlation(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    a, b = x - x.mean(), y - y.mean()
    norm = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / norm if norm > 0.0 else -1.0
