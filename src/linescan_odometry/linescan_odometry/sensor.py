"""One line camera: batches of lines in, velocity along the axis out."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.chain import LineChain
from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.flat_field import FlatField
from linescan_odometry.matching.median import average, mark_inliers
from linescan_odometry.matching.search import METRICS, ShiftSearch, make_search
from linescan_odometry.matching.subpixel import SubpixelRefiner
from linescan_odometry.measurements import FloatArray, LineBatch, Lines, SensorReading
from linescan_odometry.plausibility import Plausibility
from omni_platform.sensors import LineSensor

_FROZEN_PAIRS = 3
_STILL_DISPLACEMENT = 0.5  # px, from the oldest line to the newest one
_STILL_PAIRS = 4
_STILL_TOLERANCE = 0.002  # of correlations, beside twice the difference of neighbouring lines


@dataclasses.dataclass(frozen=True)
class PairDisplacements:
    """Displacements of consecutive lines; pair i is line i + 1 against line i.

    Attributes:
        displacement: motion of the sensor along its +axis [px], shape (m,).
        variance: of each, from its match [px^2], shape (m,).
        similarity: at the peak, shape (m,).
        usable: whether the pair has a peak of its own that is high enough, shape (m,).
    """

    displacement: FloatArray
    variance: FloatArray
    similarity: FloatArray
    usable: NDArray[np.bool_]


class SensorOdometry:
    """Measures the velocity of one line camera along its axis."""

    def __init__(self, sensor: LineSensor, configuration: OdometryConfiguration) -> None:
        """Prepare the search for the sensor's number of pixels."""
        self._sensor = sensor
        self._configuration = configuration
        self._chain = LineChain(sensor)
        limit = configuration.shift_limit(sensor)
        self._search = make_search(
            configuration.metric,
            sensor.pixels,
            limit,
            configuration.search_window,
            configuration.prior_weight,
        )
        self._ends_search = METRICS[configuration.metric](sensor.pixels, limit)
        self._flat_field = (
            FlatField(sensor.pixels, configuration.flat_field_places)
            if configuration.flat_field_places > 0
            else None
        )
        self._plausibility = (
            Plausibility(sensor, configuration.maximum_acceleration, configuration.median_tolerance)
            if configuration.maximum_acceleration > 0.0
            else None
        )
        self._refiner = SubpixelRefiner(sensor.pixels, configuration.peak_recovery)

    def update(self, batch: LineBatch) -> SensorReading:
        """Measure the mean velocity over a batch; never raises on what a camera can deliver."""
        count, pixels = batch.lines.shape
        fault = batch.fault
        if count > 0 and pixels != self._sensor.pixels:
            fault = f"lines of {pixels} px, the configuration says {self._sensor.pixels} px"
        if fault:
            self._chain.reset()
            self._search.reset()
            return SensorReading.unmeasured(fault)
        if count == 0:
            return SensorReading.unmeasured("the batch holds no line")
        lines = self._chain.join(batch)
        if len(lines) == count:
            self._search.reset()
        if len(lines) < 2:
            return SensorReading.unmeasured("a single line with none before it to compare with")
        if self._flat_field is None:
            return self._reading(batch.stamp_ns, lines)
        reading = self._reading(batch.stamp_ns, self._flat_field.correct(lines))
        self._flat_field.learn(batch.lines[-1])
        return reading

    def measure(self, lines: Lines) -> PairDisplacements:
        """Return the displacement of every line against the one before it.

        Args:
            lines: m + 1 lines, oldest first, C-contiguous, shape (m + 1, pixels).
        """
        return self._measure(lines, self._search)

    def _measure(self, lines: Lines, search: ShiftSearch) -> PairDisplacements:
        pairs = len(lines) - 1
        shift = np.empty(pairs, np.int64)
        similarity, displacement, variance = np.empty((3, pairs))
        search.match(lines, shift, similarity)
        self._refiner.refine(lines, shift, displacement, variance)
        usable = (similarity >= self._configuration.minimum_correlation) & np.isfinite(variance)
        return PairDisplacements(displacement, variance, similarity, usable)

    def _reading(self, stamp_ns: int, lines: Lines) -> SensorReading:
        settings = self._configuration
        pairs = self.measure(lines)
        same = np.all(lines[1:] == lines[:-1], axis=1)
        frozen = int(np.count_nonzero(same))
        if frozen >= _FROZEN_PAIRS:  # which the noise of a live camera rules out
            pairs.usable[same] = False
        matched = int(np.count_nonzero(pairs.usable))
        if self._plausibility is not None:
            pairs.usable[:] &= self._plausibility.judge(stamp_ns, pairs.displacement)
        inlier = np.empty(len(lines) - 1, np.bool_)
        mark_inliers(
            pairs.displacement,
            pairs.usable,
            settings.median_lines,
            settings.median_tolerance,
            inlier,
        )
        count = int(np.count_nonzero(inlier))
        share = count / len(inlier)
        if count == 0 or share < settings.minimum_inlier_share:
            reason = self._describe(lines, pairs, matched, frozen)
            return SensorReading.unmeasured(reason, inlier_share=share)
        weight = np.empty(len(inlier))
        displacement = average(pairs.displacement, inlier, weight)
        variance = self._refiner.mean_variance(pairs.displacement, weight)
        correlation = float(np.mean(pairs.similarity, where=inlier))
        if abs(displacement) < settings.slow_displacement and len(inlier) > 1:
            displacement, variance = self._span(lines, displacement, variance)
        if self._plausibility is not None:
            self._plausibility.accept(stamp_ns, len(inlier), displacement)
        scale = self._sensor.pixel_pitch * self._sensor.line_rate
        return SensorReading(
            velocity=displacement * scale,
            variance=variance * scale**2,
            correlation=correlation,
            inlier_share=share,
            measured=True,
            still_time=self._still_time(lines, displacement, correlation),
        )

    def _still_time(self, lines: Lines, displacement: float, correlation: float) -> float:
        """Return how long the view has not changed, pixel by pixel, if for the whole batch, else 0.

        The newest line is compared with older ones from all over the batch, less its first line,
        which was taken before: on a ground that repeats itself the ends alone may be alike.

        Args:
            lines: of the batch, shape (m + 1, pixels).
            displacement: mean over the pairs [px].
            correlation: mean over the pairs [1].

        Returns:
            Time between the lines that were compared [s].
        """
        span = len(lines) - 1
        if span < _STILL_PAIRS or abs(displacement) * span > _STILL_DISPLACEMENT:
            return 0.0
        # What stands still differs by its noise, however long it is looked at.
        least = max(0.0, 1.0 - 2.0 * (1.0 - correlation) - _STILL_TOLERANCE)
        newest = lines[-1] - lines[-1].mean()
        for older in (lines[1], lines[span // 3], lines[span // 2]):
            part = older - older.mean()
            likeness = math.sqrt(float(part @ part) * float(newest @ newest))
            if float(part @ newest) <= least * likeness:
                return 0.0
        return (span - 1) / self._sensor.line_rate

    def _span(self, lines: Lines, displacement: float, variance: float) -> tuple[float, float]:
        """Compare the newest line with the oldest, if that tells the mean displacement better.

        Every estimator of a shift is drawn a little towards whole pixels. At a fraction of a
        pixel per line that is a share of the speed (some per cent where noise is strong), over
        the whole batch it is not. When the sensor moves sideways at the same time the ends of the
        batch differ too much: there is no match, or one of larger variance.
        """
        span = len(lines) - 1
        ends = self._measure(lines[::span].copy(), self._ends_search)
        whole = float(ends.displacement[0])
        drift = abs(whole - span * displacement)
        if not ends.usable[0] or drift > self._configuration.median_tolerance:
            return displacement, variance
        whole_variance = self._refiner.mean_variance(ends.displacement, np.ones(1)) / span**2
        if whole_variance > variance:
            return displacement, variance
        return whole / span, whole_variance

    def _describe(self, lines: Lines, pairs: PairDisplacements, matched: int, frozen: int) -> str:
        """Say why the pairs of a batch gave no velocity."""
        low, high = int(lines.min()), int(lines.max())
        if low == high:
            return f"no contrast: every pixel is at grey level {low}"
        if 2 * frozen > len(pairs.usable):
            return f"frozen: {frozen} of {len(pairs.usable)} line pairs are identical"
        usable = int(np.count_nonzero(pairs.usable))
        if 2 * usable < matched:
            return (
                f"not plausible: {matched - usable} of {matched} displacements need more than "
                f"{self._configuration.maximum_acceleration:g} m/s^2 since the last measurement"
            )
        if 2 * matched < len(pairs.usable):
            return (
                f"no match: {matched} of {len(pairs.usable)} line pairs have a peak of "
                f"{self._configuration.minimum_correlation:g} or more within the shift limit, "
                f"the median is {float(np.median(pairs.similarity)):.2f}"
            )
        return f"the displacements of {len(pairs.usable)} line pairs disagree with their median"
