"""The method `pairs`: full search for the shift of each line pair, then a median filter.

Section 4.4 of the dissertation describes the method. Each line is compared with the previous one at
all shifts up to `shift_limit`, by one of six metrics, and the best shift is refined to a fraction
of a pixel. Displacements that are impossible for the platform, or far from the median of their
neighbors (section 4.6), are excluded. The remaining displacements are averaged.
"""

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.matching.median import average, find_inliers
from linescan_odometry.matching.search import PairDisplacements, PairMatcher, make_search
from linescan_odometry.matching.subpixel import SubpixelRefiner
from linescan_odometry.measurements import Displacement, Unmeasured
from linescan_odometry.plausibility import Plausibility
from omni_platform.sensors import LineSensor
from omni_platform.signals import Lines


class PairsMethod:
    """Measures displacements from pairs of lines."""

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
        """Return the mean displacement per line in a batch; implements `sensor.Method.measure`."""
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
        return Displacement(value, variance, correlation, share)

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
