"""Median filter over groups of consecutive displacements (section 4.6, Enhancements).

Point errors, single pairs that lock onto a wrong peak, are told by their distance from the
median of n consecutive displacements and left out; the rest is averaged. The mean of the members
near the median keeps what the median alone would lose: the error of a line enters two consecutive
displacements with opposite signs, so in a mean over m of them all but the first and the last
cancel, and the error falls with m where white noise would fall with sqrt(m).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def mark_inliers(
    displacement: NDArray[np.float64],
    usable: NDArray[np.bool_],
    group_lines: int,
    tolerance: float,
    inlier: NDArray[np.bool_],
) -> None:
    """Mark the displacements that agree with the median of their group.

    The pairs are cut into groups of nearly equal size, at most `group_lines` each. A group in
    which no more than half of all pairs agree has no valid member at all.

    Args:
        displacement: of m consecutive pairs [px], shape (m,).
        usable: whether the pair gave a displacement at all, shape (m,).
        group_lines: n of the median.
        tolerance: largest distance from the median [px].
        inlier: receives the marks, shape (m,).
    """
    total = displacement.shape[0]
    groups = -(-total // group_lines)
    values = np.empty(min(group_lines, total), np.float64)
    for group in range(groups):
        first = group * total // groups
        last = (group + 1) * total // groups
        count = 0
        for i in range(first, last):
            inlier[i] = False
            if usable[i]:
                values[count] = displacement[i]
                count += 1
        if count == 0:
            continue
        values[:count].sort()
        median = 0.5 * (values[(count - 1) // 2] + values[count // 2])
        agreeing = 0
        for i in range(first, last):
            if usable[i] and abs(displacement[i] - median) <= tolerance:
                inlier[i] = True
                agreeing += 1
        if 2 * agreeing <= last - first:
            inlier[first:last] = False


@njit(cache=True, nogil=True)
def average(
    displacement: NDArray[np.float64], variance: NDArray[np.float64], inlier: NDArray[np.bool_]
) -> tuple[float, float]:
    """Average the inliers.

    Args:
        displacement: of m consecutive pairs [px], shape (m,).
        variance: of each displacement, from its match [px^2], shape (m,).
        inlier: which to average, at least one, shape (m,).

    Returns:
        The mean [px], taken from the straight line through the inliers in the middle of the
        batch, and its variance [px^2].

    The variance of one displacement is the larger of that of the matches and of the scatter about
    the line. How it falls with their number depends on where the errors come from. Moving
    straight they are the noise of the lines; consecutive ones cancel, and V / m is on the safe
    side. Moving sideways, texture enters and leaves across the axis. The match of any two strips
    of ground is then wrong twice in the same sense, once when the second one enters the view and
    once when the first one leaves it: 2 V / m. The correlation of consecutive errors, -1/2 or
    about 0, tells which it is.
    """
    total = displacement.shape[0]
    count = 0
    s_t, s_d, s_tt, s_td, s_v = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(total):
        if inlier[i]:
            t = i - 0.5 * (total - 1)
            count += 1
            s_t += t
            s_d += displacement[i]
            s_tt += t * t
            s_td += t * displacement[i]
            s_v += variance[i]
    mean = s_d / count
    middle = s_t / count
    single = s_v / count
    spread_t = s_tt - s_t * middle
    slope, leverage = 0.0, 1.0 / count
    if 2 * count > total and count >= 3:
        slope = (s_td - s_t * mean) / spread_t
        leverage += middle * middle / spread_t
    scatter, product, neighbours = 0.0, 0.0, 0
    before = 0.0
    for i in range(total):
        if inlier[i]:
            rest = displacement[i] - mean - slope * (i - 0.5 * (total - 1) - middle)
            scatter += rest * rest
            if i > 0 and inlier[i - 1]:
                product += before * rest
                neighbours += 1
            before = rest
    most = 2.0 - 1.0 / count
    persistence = most
    if count >= 4 and scatter > 0.0 and neighbours > 0:
        single = max(single, scatter / (count - 2))
        correlation = (product / neighbours) / (scatter / count)
        persistence = min(max(2.0 + 4.0 * correlation, 1.0), most)
    return mean - slope * middle, persistence * single * leverage
