"""Median filter over consecutive displacements (dissertation, section 4.6, Enhancements).

A point error is a single line pair that matches at a wrong peak. A displacement that is far from
the median of n consecutive displacements counts as a point error and is rejected. The remaining
displacements are averaged, because their mean is more accurate than the median. The error of a line
affects two consecutive displacements with opposite signs, so in a mean over m displacements the
errors of all lines cancel except those of the first and the last line. The error of the mean is
therefore proportional to 1 / m, whereas the mean of independent errors would be proportional to 1 /
sqrt(m).
"""

import numpy as np

from omni_platform.kernels import kernel
from omni_platform.quantities import BoolArray, FloatArray


@kernel
def mark_inliers(
    displacement: FloatArray,
    usable: BoolArray,
    group_lines: int,
    tolerance: float,
    inlier: BoolArray,
) -> None:
    """Write to `inlier` whether each displacement is close to the median of its group.

    The pairs are divided into groups of nearly equal size, with at most `group_lines` pairs each.
    If at most half of the pairs of a group are close to the median, the whole group is rejected.

    Args:
        displacement: displacements of m consecutive pairs [px], shape (m,).
        usable: whether each pair has a displacement, shape (m,).
        group_lines: limit on the number of pairs in a group.
        tolerance: limit on the distance from the median [px].
        inlier: output, whether each displacement agrees with the median, shape (m,).
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


def find_inliers(
    displacement: FloatArray, usable: BoolArray, group_lines: int, tolerance: float
) -> tuple[BoolArray, float]:
    """Return whether each displacement is an inlier, shape (m,), and the share of inliers, 0 to 1.

    An inlier is close to the median of its group. The arguments are those of `mark_inliers`.
    """
    inlier = np.empty(len(usable), np.bool_)
    mark_inliers(displacement, usable, group_lines, tolerance, inlier)
    return inlier, np.count_nonzero(inlier) / len(inlier)


@kernel
def average(displacement: FloatArray, inlier: BoolArray, weight: FloatArray) -> float:
    """Return the mean of the inliers, corrected for acceleration.

    Args:
        displacement: displacements of m consecutive pairs [px], shape (m,).
        inlier: whether to include each displacement in the mean; at least one is true, shape (m,).
        weight: output, weight of each displacement in the mean, with the sum 1, shape (m,).

    Returns:
        Value of a straight line, fitted to the inliers, in the middle of the batch [px]. The
        omission of outliers therefore causes no bias while the platform accelerates. If at most
        half of the displacements are inliers, their plain mean is returned.
    """
    total = displacement.shape[0]
    count = 0
    s_t, s_tt = 0.0, 0.0
    for i in range(total):
        if inlier[i]:
            t = i - 0.5 * (total - 1)
            count += 1
            s_t += t
            s_tt += t * t
    middle = s_t / count
    spread = s_tt - s_t * middle
    tilt = middle / spread if 2 * count > total and count >= 3 else 0.0
    mean = 0.0
    for i in range(total):
        weight[i] = 0.0
        if inlier[i]:
            weight[i] = 1.0 / count - tilt * (i - 0.5 * (total - 1) - middle)
            mean += weight[i] * displacement[i]
    return mean
