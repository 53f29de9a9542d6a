"""One line camera: batches of lines in, velocity along the axis out.

`SensorOdometry.update` follows the stages of section 4.4. A stage that cannot measure raises
`Unmeasured` with the reason.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.chain import LineChain
from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.matching.median import average, find_inliers
from linescan_odometry.matching.pairs import PairDisplacements, PairMatcher, count_identical
from linescan_odometry.matching.search import METRICS, ShiftSearch, make_search
from linescan_odometry.matching.smoothed_peak import correlation
from linescan_odometry.matching.subpixel import FEWEST_PIXELS, SubpixelRefiner
from linescan_odometry.matching.whitened import FEWEST_LINES, LONG, Whitened, WhitenedMatcher
from linescan_odometry.measurements import LineBatch, Lines, SensorReading, Unmeasured
from linescan_odometry.plausibility import Plausibility
from linescan_odometry.view.flat_field import FlatField
from linescan_odometry.view.grain import Keyframe
from linescan_odometry.view.sharp import follows, sharp_pixels, sharpened, steps
from linescan_odometry.view.still import STRUCTURE, StillView, structure_of, without_defects
from linescan_odometry.view.structures import StructureCounter
from omni_platform.background import in_background
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor

_FROZEN_PAIRS = 3
_SHARP_PAIRS = 6  # of a batch whose detail is compared
_FEWEST_MOVES = 2
_FAINT = 0.15  # correlation of a moving texture behind a fixed pattern
_FAR_DIVISOR = 4  # of a line: the whole-batch estimate is used for smaller displacements
_FEWEST_PLACES = 3.0  # smallest effective number of independent features
_LONE_PLACES = 2.0  # number of features below which a single one dominates
_ALIKE = 0.3  # smallest correlation of the detail of lines over the same ground
_STILL_DISPLACEMENT = 0.5  # px, from the oldest line to the newest one
_STILL_PAIRS = 4
_QUICK = 6.0  # px per line, beyond which the peaks of pattern and motion are separate
_NOISE_SIGMAS = 3.5  # standard deviations of a correlation of noise
_STEPPING = 0.2  # correlation of the change from line to line over that from first to last
_SAME_CHANGE = 0.6  # correlation of the changes in the two halves of a batch
_LONGEST_STRETCH = 0.25  # largest relative deviation of the time of a batch from its lines [1]
_SLOW = 0.6  # px per line, below which the mean of the lines is mostly ground
_PULLED = 2.0  # standard deviations
_LEAST_PULL = 0.1  # px per line of bias by the mean of few lines
_MOVING_RANGE = 30000.0
_FAR_SHARE, _STAYS = (
    0.4,
    0.98,
)  # line spacing in lengths; relative correlation
_MOVES = 0.5  # px per line, above which a displacement is not that of a fixed pattern
_OFF = 4.0  # standard deviations
_LARGEST_DEVIATION = 2.0  # px per line, largest usable standard deviation
_OPPOSED = -0.4  # coherence below which a displacement is a different one
_CHANGING = 0.2  # loss of coherence of distant lines by new ground
_STILL_TOLERANCE = 0.002  # of correlations, in addition to twice the difference of neighbors


@dataclasses.dataclass(frozen=True)
class _Mean:
    """Mean displacement over a batch.

    Attributes:
        displacement: per line [px].
        variance: of the displacement [px^2].
        correlation: mean similarity of the used pairs [1].
        share: share of used pairs, 0..1.
        places: effective number of positions with the gradients of the match; infinite for the
            whole-batch estimate.
        ends: coherence at the largest line spacing [1], this spacing [s], and the variance for an
            oblique texture [px^2].
        alone: whether neither a larger line spacing nor the whole-batch estimate reproduces this
            displacement.
    """

    displacement: float
    variance: float
    correlation: float
    share: float
    places: float
    ends: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alone: bool = False


@dataclasses.dataclass(frozen=True)
class _Matched:
    """A batch with matched pairs.

    Attributes:
        stamp_ns: of the newest line [ns].
        lines: consecutive lines, oldest first, shape (m + 1, n).
        pairs: displacements of consecutive lines.
        whole: returns the whole-batch estimate; None if it was not started.
    """

    stamp_ns: int
    lines: Lines
    pairs: Callable[[], PairDisplacements]
    whole: Callable[[], Whitened | None] | None


def _mean_of(
    matcher: PairMatcher, pairs: PairDisplacements, inlier: NDArray[np.bool_], share: float
) -> _Mean:
    """Average the inlier pairs, a share of all pairs."""
    weight = np.empty(len(inlier))
    displacement = average(pairs.displacement, inlier, weight)
    variance = matcher.mean_variance(pairs.displacement, weight)
    correlation = float(pairs.similarity @ inlier) / np.count_nonzero(inlier)
    return _Mean(displacement, variance, correlation, share, matcher.places)


def _stays(lines: Lines, mean: _Mean) -> bool:
    """Return whether no new ground enters: distant lines are as correlated as neighbors."""
    span, pixels = len(lines) - 1, lines.shape[1]
    apart = min(span, int(_FAR_SHARE * pixels / max(abs(mean.displacement), 1e-3)))
    if apart < 2:
        return False
    alike: float = correlation(lines[-1 - apart], lines[-1], round(apart * mean.displacement))
    return alike > _STAYS * mean.correlation


class SensorOdometry:
    """Measures the velocity of one line camera along its axis."""

    def __init__(
        self,
        sensor: LineSensor,
        configuration: OdometryConfiguration,
        tables: Path | None = None,
    ) -> None:
        """Prepare the stages for the sensor's number of pixels.

        Args:
            sensor: the camera.
            configuration: of the odometry.
            tables: file of its references and fixed pattern; None without.

        Raises:
            LineBatchError: the file holds no tables of this camera.
        """
        self._sensor = sensor
        self._configuration = configuration
        self._chain = LineChain(sensor)
        limit = configuration.shift_limit(sensor)
        search = make_search(
            configuration.metric,
            sensor.pixels,
            limit,
            configuration.search_window,
            configuration.prior_weight,
        )
        self._matcher = self._make_matcher(search)
        self._ends_matcher = self._make_matcher(METRICS[configuration.metric](sensor.pixels, limit))
        self._moving_matcher = PairMatcher(
            METRICS[configuration.metric](sensor.pixels, limit),
            SubpixelRefiner(sensor.pixels, configuration.peak_recovery),
            min(_FAINT, configuration.minimum_correlation),
        )
        self._near = min(limit, sensor.pixels // _FAR_DIVISOR)
        self._sharp_matchers = {
            step: self._make_sharp_matcher(sharp_pixels(sensor.pixels, step), limit)
            for step in steps(sensor.pixels)
            if sharp_pixels(sensor.pixels, step) >= 2 * FEWEST_PIXELS
        }
        self._whitened = WhitenedMatcher(sensor.pixels, limit)
        self._flat_field = FlatField(sensor.pixels, configuration.flat_field_places)
        if tables is not None:
            self._flat_field.load(tables)
        self._still = StillView(sensor.pixels)
        self._seen: Lines = np.empty((0, sensor.pixels), np.uint8)  # as the camera delivered them
        self._still_refiner = SubpixelRefiner(sensor.pixels)
        self._measured_before = True  # whether the batch before gave a displacement
        self._moving = False  # whether new ground entered the view
        self._finish_last: Callable[[], SensorReading | None] = lambda: None
        self._keyframe = Keyframe(sensor.pixels)
        self._structures = StructureCounter(sensor.pixels)
        self._plausibility = Plausibility(
            sensor, configuration.maximum_acceleration, configuration.median_tolerance
        )

    def _make_matcher(self, search: ShiftSearch) -> PairMatcher:
        settings = self._configuration
        refiner = SubpixelRefiner(self._sensor.pixels, settings.peak_recovery)
        return PairMatcher(search, refiner, settings.minimum_correlation)

    def _make_sharp_matcher(self, pixels: int, limit: int) -> PairMatcher:
        search = METRICS["pearson"](pixels, min(limit, pixels - FEWEST_PIXELS))
        refiner = SubpixelRefiner(pixels, self._configuration.peak_recovery)
        return PairMatcher(search, refiner, _ALIKE)

    def update(self, batch: LineBatch) -> SensorReading:
        """Measure the mean velocity over a batch; never raises for data of a camera."""
        return self.begin(batch)()

    def begin(self, batch: LineBatch) -> Callable[[], SensorReading]:
        """Start measuring over a batch; return a function for the result of `update`.

        The whole-batch estimate is computed in the background.
        """
        self._finish_last()
        try:
            seen = without_defects(self._chain.take(batch, self._matcher.reset))
            lines = self._flat_field.apply(seen)
            self._still.learn(seen)
            self._seen = seen
            pairs = in_background(partial(self._matcher.match, lines), worth=lines.size >= LONG)
            whole = None
            if self._moving:
                whole = self._whitened.begin(lines, settled=not self._flat_field.learning)
            matched = _Matched(batch.stamp_ns, lines, pairs, whole)
        except Unmeasured as nothing:
            self._keyframe.reset()
            reading = nothing.reading
            return lambda: reading
        self._finish_last = cache(partial(self._finish, matched))
        return self._finish_last

    def _finish(self, matched: _Matched) -> SensorReading:
        try:
            pairs = matched.pairs()
            frozen = self._mark_frozen(matched.lines, pairs)
            implausible = self._plausibility.mark(matched.stamp_ns, pairs)
            mean = self._together(matched, pairs, frozen, implausible)
            self._plausibility.accept(matched.stamp_ns, len(matched.lines) - 1, mean.displacement)
            return self._reading(matched.stamp_ns, matched.lines, mean)
        except Unmeasured as nothing:
            self._keyframe.reset()
            return nothing.reading

    def _mark_frozen(self, lines: Lines, pairs: PairDisplacements) -> int:
        """Mark pairs of identical lines, which noise excludes for a working camera."""
        same = np.empty(len(lines) - 1, np.bool_)
        frozen: int = count_identical(lines, same)
        if frozen >= _FROZEN_PAIRS:
            pairs.usable[same] = False
        return frozen

    def _together(
        self, matched: _Matched, pairs: PairDisplacements, frozen: int, implausible: int
    ) -> _Mean:
        """Return the mean of the pairs, or the whole-batch estimate if it is more informative.

        Raises:
            Unmeasured: neither gives a displacement.
        """
        stamp_ns, lines = matched.stamp_ns, matched.lines
        again, self._measured_before = self._measured_before, True
        try:
            mean = self._of_pairs(lines, pairs, frozen, implausible)
        except Unmeasured as unmeasured:
            if not unmeasured.open:
                self._measured_before = False
                raise
            mean = None
            failure = unmeasured
        few = len(lines) < FEWEST_LINES
        stays = mean is not None and not few and _stays(lines, mean)
        self._moving = not stays
        if mean is not None and (few or frozen >= _FROZEN_PAIRS or stays):
            return mean
        learning = self._flat_field.learning
        whole = (matched.whole or self._whitened.begin(lines, settled=not learning))()
        if learning:
            whole = self._whole_less_still(whole)
        sure = (
            whole is not None
            and whole.lone
            and abs(whole.displacement) <= self._near
            and whole.places >= _FEWEST_PLACES
            and whole.lasting > _OPPOSED
            and bool(self._plausibility.judge(stamp_ns, np.array([whole.displacement]))[0])
        )
        corrects = self._flat_field.corrects
        # A poorly estimated fixed pattern biases the whole-batch estimate to a slow displacement.
        drawn = whole is not None and learning and corrects and abs(whole.displacement) < _QUICK
        if mean is None:
            # The fixed pattern that caused the rejection of the pairs may dominate all lines too.
            still = whole is not None and learning and abs(whole.displacement) < _MOVES
            hidden = whole is None or still or drawn or whole.oblique > _LARGEST_DEVIATION**2
            self._measured_before = sure and not hidden
            # Without pair matches, a single whole-batch match may be one by chance.
            if whole is None or not (self._measured_before and again):
                failure.reading = dataclasses.replace(failure.reading, unlike=True)
                raise failure
            whole = whole._replace(variance=max(whole.variance, whole.oblique))
            return self._of_all(whole, float(np.median(pairs.similarity)), 1.0)
        if not learning and (whole is None or not whole.lone):
            raise Unmeasured(
                f"pairs of lines move by {mean.displacement:.3g} px, lines farther apart otherwise",
                mean.share,
                unlike=True,
            )
        if whole is None or not sure or drawn:
            return dataclasses.replace(mean, alone=whole is None or not whole.lone)
        apart = (mean.displacement - whole.displacement) ** 2
        if 1.0 - whole.lasting < _CHANGING:
            if apart > _OFF**2 * (mean.variance + whole.variance):
                return dataclasses.replace(mean, variance=mean.variance + apart)
            return mean
        off = apart > _OFF**2 * mean.variance or mean.variance > _MOVES**2
        if corrects and off and abs(whole.displacement) < _MOVES:
            raise Unmeasured(
                "fixed pattern: the whole-batch estimate does not move, pairs of lines move by "
                f"{mean.displacement:.3g} px",
                mean.share,
            )
        return self._of_all(whole, mean.correlation, mean.share)

    def _whole_less_still(self, whole: Whitened | None) -> Whitened | None:
        """Return a whole-batch estimate without fixed pattern, None if the pattern dominates."""
        if whole is None or self._still.weight == 0.0:
            return whole
        moving = self._still.without(self._seen)
        other = self._whitened.match(moving, settled=True, with_lasting=False)
        if other is None or not other.lone or other.places < _FEWEST_PLACES:
            return None
        pull = whole.displacement - other.displacement
        largest = max(whole.variance, other.variance)
        if pull**2 <= _PULLED**2 * largest:
            return whole
        half = 0.5 * pull
        return whole._replace(displacement=whole.displacement - half, variance=largest + half**2)

    def _of_all(self, whole: Whitened, correlation: float, share: float) -> _Mean:
        """Return the mean of a whole-batch estimate."""
        ends = whole.lasting, whole.apart / self._sensor.line_rate, whole.oblique
        return _Mean(whole.displacement, whole.variance, correlation, share, math.inf, ends)

    def _of_pairs(
        self, lines: Lines, pairs: PairDisplacements, frozen: int, implausible: int
    ) -> _Mean:
        """Return the mean of the displacements of consecutive lines.

        Raises:
            Unmeasured: they disagree, or do not show the ground.
        """
        mean = self._average(lines, pairs, frozen, implausible)
        mean = self._finer(lines, mean) or self._span(lines, mean)
        if mean.places < _FEWEST_PLACES:
            raise Unmeasured(
                f"match dominated by {mean.places:.1f} image features: a light edge, a spot, or "
                "low texture",
                mean.share,
                unlike=True,  # the moving texture is not visible: it may be oblique
                open=mean.places > _LONE_PLACES,
            )
        return self._less_still(self._check_fixed_pattern(lines, mean))

    def _less_still(self, mean: _Mean) -> _Mean:
        """Return the mean without the bias of a fixed pattern, if there is one.

        The lines are matched again without the pattern, around the same displacement. The result is
        between both displacements, and their difference enters the variance: the estimated pattern
        may contain a share of the ground, and may not be additive.

        Raises:
            Unmeasured: without the pattern no such displacement is found.
        """
        estimated = self._still.weight > 0.0 and len(self._seen) > _STILL_PAIRS
        if not (self._flat_field.learning and estimated) or abs(mean.displacement) < _SLOW:
            return mean
        lines = self._still.without(self._seen)
        span = len(lines) - 1
        shift = np.full(span, round(mean.displacement), np.int64)
        displacement, variance = np.empty((2, span))
        self._still_refiner.refine(lines, shift, displacement, variance)
        off = np.abs(displacement - mean.displacement)
        inlier = np.isfinite(variance) & (off <= self._configuration.median_tolerance)
        share = float(np.mean(inlier))
        if share < self._configuration.minimum_inlier_share:
            if abs(mean.displacement) <= _QUICK:
                return mean  # the pattern contains its own ground
            raise Unmeasured(
                f"fixed pattern: without it only {100.0 * share:.0f} % of the line pairs match",
                share,
                open=True,
            )
        weight = inlier / np.count_nonzero(inlier)
        pull = mean.displacement - float(displacement @ weight)
        other = self._still_refiner.mean_variance(displacement, weight)
        largest = max(mean.variance, other)
        if pull**2 <= _PULLED**2 * largest:
            return mean
        if self._flat_field.corrects:
            return dataclasses.replace(mean, variance=mean.variance + pull**2)
        half = 0.5 * pull
        return dataclasses.replace(
            mean, displacement=mean.displacement - half, variance=largest + half**2
        )

    def _average(
        self, lines: Lines, pairs: PairDisplacements, frozen: int, implausible: int
    ) -> _Mean:
        """Average the pairs that agree with the median of their group (section 4.6)."""
        settings = self._configuration
        inlier, share = find_inliers(
            pairs.displacement, pairs.usable, settings.median_lines, settings.median_tolerance
        )
        if share == 0.0 or share < settings.minimum_inlier_share:
            seen = frozen < _FROZEN_PAIRS and int(lines.min()) < int(lines.max())
            unlike = seen and frozen == implausible == 0
            reason = self._describe(lines, pairs, frozen, implausible)
            raise Unmeasured(reason, share, unlike=unlike, open=seen)
        return _mean_of(self._matcher, pairs, inlier, share)

    def _finer(self, lines: Lines, mean: _Mean) -> _Mean | None:
        """Return the mean of the fine detail, if its displacement differs from that of the lines.

        Raises:
            Unmeasured: it differs, and its pairs disagree too.
        """
        tolerance = self._configuration.median_tolerance
        for step, matcher in self._sharp_matchers.items():
            sharp = sharpened(lines[-_SHARP_PAIRS - 1 :], step)
            if follows(sharp, mean.displacement):
                return None
            few = matcher.match(sharp)
            moves = few.displacement[few.usable]
            if 2 * len(moves) <= len(few.usable) or len(moves) < _FEWEST_MOVES:
                continue
            middle = float(np.median(moves))
            if 2 * np.count_nonzero(np.abs(moves - middle) <= tolerance) > len(few.usable):
                break
        else:
            return None
        if abs(middle - mean.displacement) <= tolerance or abs(middle) <= tolerance:
            return None  # fixed detail is that of the pixels, not of the ground
        whole = matcher.match(sharpened(lines, step))
        inlier = whole.usable & (np.abs(whole.displacement - middle) <= tolerance)
        share = float(np.mean(inlier))
        if share < self._configuration.minimum_inlier_share:
            raise Unmeasured(
                f"two displacements in the view: lines move by {mean.displacement:.3g} px, their "
                f"detail by {middle:.3g} px",
                share,
                open=True,
            )
        return _mean_of(matcher, whole, inlier, share)

    def _span(self, lines: Lines, mean: _Mean) -> _Mean:
        """Compare the newest line with the oldest, if that is more accurate.

        Every estimator of a shift has a small bias towards whole pixels. At a fraction of a pixel
        per line this is a share of the speed (some per cent with strong noise), but not over the
        whole batch. In sideways motion the ends of the batch differ too much: there is no match, or
        one with a larger variance.
        """
        span = len(lines) - 1
        if abs(mean.displacement) >= self._configuration.slow_displacement or span < 2:
            return mean
        ends = self._ends_matcher.match(lines[::span].copy())
        whole = float(ends.displacement[0])
        drift = abs(whole - span * mean.displacement)
        if not ends.usable[0] or drift > self._configuration.median_tolerance:
            return mean
        variance = self._ends_matcher.mean_variance(ends.displacement, np.ones(1)) / span**2
        if variance > mean.variance:
            return mean
        return dataclasses.replace(mean, displacement=whole / span, variance=variance)

    def _check_fixed_pattern(self, lines: Lines, mean: _Mean) -> _Mean:
        """Check a slow displacement, which a fixed pattern may bias.

        A fixed pattern is the same in every line: without their mean, the lines contain only what
        moves, and must show the same displacement. At rest nothing remains and nothing is checked;
        nor is it once the flat field is estimated.
        """
        if not self._flat_field.learning:
            return mean
        if abs(mean.displacement) > _QUICK or len(lines) <= _STILL_PAIRS:
            return mean
        moving = lines - lines.mean(axis=0)
        third = len(moving) // 3  # the mean of a third shows a ground of low contrast despite noise
        change = moving[-third:].mean(axis=0) - moving[:third].mean(axis=0)
        structure, square = structure_of(moving[-1] - moving[0])
        faint, faint_square = structure_of(change)
        # Noise alone correlates neighboring pixels by 1 / sqrt(n).
        least = max(STRUCTURE, _NOISE_SIGMAS / math.sqrt(lines.shape[1]))
        if square == 0.0 or (structure < least * square and faint < least * faint_square):
            return mean
        scale = _MOVING_RANGE / max(float(np.abs(moving).max()), 1.0)
        pairs = self._moving_matcher.match(np.rint(32768.0 + scale * moving).astype(np.uint16))
        usable = pairs.displacement[pairs.usable]
        median = float(np.median(usable)) if 2 * len(usable) > len(moving) - 1 else math.inf
        if math.isinf(median):
            steps = np.diff(moving, axis=0)
            if float(np.sum(steps[:, 1:] * steps[:, :-1])) < _STEPPING * structure * len(steps):
                # Consecutive lines are nearly equal: the change shows only over half of the batch.
                return self._check_changes(moving, mean)
        if abs(median - mean.displacement) > self._configuration.median_tolerance:
            raise Unmeasured(
                "fixed pattern: without the mean of all lines, the lines of the batch "
                + ("do not match" if math.isinf(median) else f"move by {median:.3g} px"),
                open=True,
            )
        near = usable[np.abs(usable - median) <= self._configuration.median_tolerance]
        if len(near) == 0:
            return mean
        pull = max(0.0, abs(float(near.mean()) - mean.displacement) - _LEAST_PULL)
        return dataclasses.replace(mean, variance=mean.variance + pull**2)

    def _check_changes(self, moving: FloatArray, mean: _Mean) -> _Mean:
        """Check whether a displacement explains the change of the view.

        The changes over the two halves of a batch contain no fixed pattern. If they are not
        correlated, the ground may move more than pairs of lines show.

        Args:
            moving: lines without their mean.
            mean: displacement of the lines.

        Raises:
            Unmeasured: both changes are correlated at another displacement than that of the lines.
        """
        half = (len(moving) - 1) // 2
        changes = moving[[half, 2 * half]] - moving[[0, half]]
        scale = _MOVING_RANGE / max(float(np.abs(changes).max()), 1.0)
        found = self._moving_matcher.match(np.rint(32768.0 + scale * changes).astype(np.uint16))
        way = float(found.displacement[0])
        off = abs(way - half * mean.displacement)
        if not found.usable[0] or float(found.similarity[0]) < _SAME_CHANGE:
            return dataclasses.replace(mean, variance=mean.variance + _MOVES**2)
        if off > self._configuration.median_tolerance:
            raise Unmeasured(
                f"fixed pattern: the changing part moves by {way:.3g} px in {half} lines",
                open=True,
            )
        return mean

    def _reading(self, stamp_ns: int, lines: Lines, mean: _Mean) -> SensorReading:
        """Return the velocity of a mean displacement."""
        scale = self._sensor.pixel_pitch * self._sensor.line_rate
        velocity = mean.displacement * scale
        if self._chain.stretch > _LONGEST_STRETCH:
            raise Unmeasured(self._chain.remark)
        if not self._chain.joined:
            self._keyframe.reset()
        period_ns = 1e9 / self._sensor.line_rate
        age, lasting = self._keyframe.compare(stamp_ns, period_ns, lines, mean.displacement)
        return SensorReading(
            velocity=velocity,
            variance=mean.variance * scale**2 + (velocity * self._chain.stretch) ** 2,
            correlation=mean.correlation,
            inlier_share=mean.share,
            measured=True,
            remark=self._chain.remark,
            still_time=self._still_time(lines, mean),
            lasting_time=age,
            lasting=lasting,
            batch_time=mean.ends[1],
            batch_lasting=mean.ends[0],
            batch_oblique_variance=mean.ends[2] * scale**2,
            structures=(
                self._structures.count(lines, mean.displacement)
                if math.isfinite(mean.places)
                else math.inf
            ),
            unlike=mean.alone,
        )

    def _still_time(self, lines: Lines, mean: _Mean) -> float:
        """Return how long the lines have not changed [s]; 0 if they changed within this batch.

        The newest line is compared with older ones throughout the batch: on a periodic ground the
        ends alone may be equal.
        """
        span = len(lines) - 1
        if span < _STILL_PAIRS or abs(mean.displacement) * span > _STILL_DISPLACEMENT:
            return 0.0
        # A fixed pattern differs by noise only, at any time.
        least = max(0.0, 1.0 - 2.0 * (1.0 - mean.correlation) - _STILL_TOLERANCE)
        older = (lines[1], lines[span // 3], lines[span // 2])
        if any(correlation(line, lines[-1], 0) <= least for line in older):
            return 0.0
        return (span - 1) / self._sensor.line_rate

    def _describe(
        self, lines: Lines, pairs: PairDisplacements, frozen: int, implausible: int
    ) -> str:
        """Return the reason why the pairs of a batch give no velocity."""
        low, high = int(lines.min()), int(lines.max())
        if low == high:
            return f"no contrast: every pixel is at gray level {low}"
        if 2 * frozen > len(pairs.usable):
            return f"frozen: {frozen} of {len(pairs.usable)} line pairs are identical"
        matched = int(np.count_nonzero(pairs.usable)) + implausible
        if 2 * implausible > matched:
            return (
                f"not plausible: {implausible} of {matched} displacements need more than "
                f"{self._configuration.maximum_acceleration:g} m/s^2 since the last measurement"
            )
        if 2 * matched < len(pairs.usable):
            return (
                f"no match: {matched} of {len(pairs.usable)} line pairs have a peak of "
                f"{self._configuration.minimum_correlation:g} or more within the shift limit, "
                f"the median is {float(np.median(pairs.similarity)):.2f}"
            )
        return f"the displacements of {len(pairs.usable)} line pairs disagree with their median"
