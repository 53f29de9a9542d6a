"""The method `pairs`: full search for the shift of each line pair, then a median filter.

Section 4.4 of the dissertation describes the method. Each line is compared with the previous one at
all shifts up to `shift_limit`, by one of six metrics, and the best shift is refined to a fraction
of a pixel. Displacements that are impossible for the platform, or far from the median of their
neighbors (section 4.6), are excluded. The remaining displacements are averaged.

A point error is a single line pair that matches at a wrong peak. A displacement that is far from
the median of n consecutive displacements counts as a point error and is rejected. The remaining
displacements are averaged, because their mean is more accurate than the median. The error of a line
affects two consecutive displacements with opposite signs, so in a mean over m displacements the
errors of all lines cancel except those of the first and the last line. The error of the mean is
therefore proportional to 1 / m, whereas the mean of independent errors would be proportional to 1 /
sqrt(m).
"""

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.matching.search import PairDisplacements, PairMatcher, make_search
from linescan_odometry.matching.subpixel import SubpixelRefiner
from linescan_odometry.measurements import Displacement, Unmeasured
from linescan_odometry.plausibility import Plausibility
from omni_core.kernels import kernel
from omni_core.quantities import BoolArray, FloatArray
from omni_core.sensors import LineSensor
from omni_core.signals import Lines


class PairsMethod:
    """Measures displacements from pairs of lines.

    Attributes:
        still: always False: this method does not know whether only noise changed the lines.
    """

    still = False

    def __init__(self, sensor: LineSensor, configuration: OdometryConfiguration) -> None:
        """Create the search, the refinement and the median filter for one camera.

        Args:
            sensor: configuration of the camera.
            configuration: configuration of the odometry.
        """
        self._settings = configuration
        search = make_search(
            configuration.metric,
            configuration.shift_limit(sensor),
            configuration.search_window,
            configuration.prior_weight,
        )
        refiner = SubpixelRefiner(sensor.pixels)
        self._matcher = PairMatcher(search, refiner, configuration.minimum_correlation)

    def reset(self) -> None:
        """Discard all lines; the next line starts a new sequence."""
        self._matcher.reset()

    def measure(self, lines: Lines, plausibility: Plausibility, stamp_ns: int) -> Displacement:
        """Return the mean displacement per line in a batch, like `JointEstimator.measure`."""
        settings = self._settings
        pairs = self._matcher.match(lines)
        implausible = plausibility.mark(stamp_ns, pairs)
        inlier, share = find_inliers(
            pairs.displacement, pairs.usable, settings.median_lines, settings.median_tolerance
        )
        if share == 0.0 or share < settings.minimum_inlier_share:
            raise Unmeasured(self._describe(pairs, implausible), share)
        weight = np.empty(len(inlier))
        value = average(pairs.displacement, inlier, weight)
        variance = float(np.sum((weight[inlier] @ pairs.errors[inlier]) ** 2))
        correlation = float(pairs.similarity @ inlier) / np.count_nonzero(inlier)
        return Displacement(value, variance, correlation, lines, share)

    def _describe(self, pairs: PairDisplacements, implausible: int) -> str:
        """Return the reason why the pairs of a batch gave no displacement."""
        matched = int(np.count_nonzero(pairs.usable)) + implausible
        if 2 * implausible > matched:
            return (
                f"not plausible: {implausible} of {matched} displacements need more than "
                f"{self._settings.maximum_acceleration:g} m/s^2 since the last measurement"
            )
        if 2 * matched < len(pairs.usable):
            return (
                f"no match: {matched} of {len(pairs.usable)} line pairs have a correlation "
                f"of at least {self._settings.minimum_correlation:g} within the shift limit; "
                f"the median is {float(np.median(pairs.similarity)):.2f}"
            )
        return f"the displacements of {len(pairs.usable)} line pairs disagree with their median"


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
