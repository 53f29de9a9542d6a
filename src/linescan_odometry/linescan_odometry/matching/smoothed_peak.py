"""Searches the peak of the similarity again on smoothed lines, near the first shift.

On coarse textures of low contrast the similarity hardly changes from one pixel to the next, and
noise moves its peak by two or three pixels, too far for Gauss-Newton steps. Smoothing by a Gaussian
of two pixels removes most of the noise and little of such a texture.
"""

import math

import numpy as np

from linescan_odometry.measurements import Lines
from omni_platform.kernels import njit
from omni_platform.quantities import FloatArray

_SIGMA = 2.0  # px
_RADIUS = 5  # px
_KERNEL = np.exp(-0.5 * (np.arange(-_RADIUS, _RADIUS + 1) / _SIGMA) ** 2)
_KERNEL /= _KERNEL.sum()


@njit(cache=True, error_model="numpy")
def smoothed_peak(old: Lines, new: Lines, shift: int, reach: int) -> int:
    """Return the shift at which the smoothed lines match best.

    Args:
        old: a line, shape (n,).
        new: the line after it, shape (n,).
        shift: best shift without smoothing [px].
        reach: largest distance from this shift that is searched [px].
    """
    smooth_old, smooth_new = _smooth(old), _smooth(new)
    best, best_shift = -math.inf, shift
    for away in range(reach + 1):
        for s in (shift - away, shift + away):
            r = correlation(smooth_old, smooth_new, s)
            if r > best:
                best, best_shift = r, s
    return best_shift


@njit(cache=True, error_model="numpy")
def _smooth(line: Lines) -> FloatArray:
    smooth = np.zeros(max(0, len(line) - 2 * _RADIUS))
    for k in range(len(_KERNEL)):
        for i in range(len(smooth)):
            smooth[i] += _KERNEL[k] * line[i + k]
    return smooth


@njit(cache=True, error_model="numpy")
def correlation(old: Lines | FloatArray, new: Lines | FloatArray, shift: int) -> float:
    """Return Pearson's correlation at a shift [px]; -1 where it is not defined.

    Args:
        old: a line, shape (n,).
        new: the line after it, shape (n,).
        shift: shift of the ground towards smaller indices.
    """
    overlap = len(new) - abs(shift)
    if overlap < 2:
        return -1.0
    x = new[max(0, -shift) :][:overlap]
    y = old[max(0, shift) :][:overlap]
    mean_x, mean_y = x.mean(), y.mean()
    xx, yy, xy = 0.0, 0.0, 0.0
    for i in range(overlap):
        a, b = x[i] - mean_x, y[i] - mean_y
        xx += a * a
        yy += b * b
        xy += a * b
    return xy / math.sqrt(xx * yy) if xx * yy > 0.0 else -1.0
