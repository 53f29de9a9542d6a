"""Measurement of the velocity of one line camera, by one of two methods, `joint` or `pairs`.

`SensorOdometry.update` connects a batch to the previous batch, passes the lines to the configured
method, and returns a reading with velocity and variance. If one of these operations raises
`Unmeasured`, the reading contains the reason instead.
"""

import dataclasses
import math
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.joint.estimator import JointEstimator
from linescan_odometry.joint.maximum import SLOPE
from linescan_odometry.joint.spectra import SIGNIFICANT, FixedPattern
from linescan_odometry.keyframe import Keyframe, kept
from linescan_odometry.measurements import SensorReading, Unmeasured
from linescan_odometry.pair_method import PairsMethod
from linescan_odometry.paths_across import HARDEST_STOP
from linescan_odometry.plausibility import Plausibility
from linescan_odometry.references import References
from omni_core.background import in_background
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch, Lines

_FROZEN_PAIRS = 3  # number of identical line pairs that never occurs with the noise of a camera
_LONGEST_STRETCH = 0.25  # limit on `LineChain.stretch`, above which a batch yields no measurement
_STATIC_PAIRS = 4  # smallest number of line pairs that prove a static view
_STATIC_DISPLACEMENT = 0.5  # px, oldest to newest line; if it is larger, the view is not static
# Lines of a static view may lose twice as much correlation as neighboring lines, plus this share.
_STATIC_TOLERANCE = 0.002
_STATIC_SHARE = 0.75  # smallest correlation of a static view, relative to neighboring lines
_ANEW_NS = 100_000_000  # ns; if stamps go back by more than this, a recording is played again
_WHOLE = 0.75  # share of a batch; a longer gap counts as a missing batch
_BACKGROUND = 16384  # pixels of a batch above which a background thread saves time


class LineChain:
    """Joins a camera's batches into a chain of consecutive lines, and checks their stamps.

    The line period is computed from the stamps of the newest lines and the number of lines between
    them. If this period differs from the configured period, lines were lost or repeated, or the
    line rate is wrong. In each case the velocity has the same relative error as the period. A
    missing batch does not cause this error, because the lines of the next batch are still
    consecutive.

    Attributes:
        period_ns: line period at the configured line rate [ns].
        stretch: relative difference between the measured duration of the last batch and its
            duration at the configured line rate [1]; 0 within the tolerance. The velocity may have
            an equal relative error.
        remark: description of this difference; empty within the tolerance.
        joined: whether the last batch followed the previous one without a gap.
    """

    def __init__(self, sensor: LineSensor) -> None:
        """Create a chain without a stored line."""
        self._sensor = sensor
        self.period_ns = 1e9 / sensor.line_rate
        self._last: Lines | None = None
        self._last_ns = 0
        self.stretch = 0.0
        self.remark = ""
        self.joined = False
        self._late = 0.0  # decaying sum of the delays of earlier batches [line periods]

    def reset(self) -> None:
        """Discard the stored line; the next batch starts a new chain."""
        self._last = None
        self._late = 0.0

    def take(self, batch: LineBatch, restart: Callable[[], None]) -> Lines:
        """Return the last line of the previous batch, followed by the lines of this batch.

        At the start and after a missing batch, only the lines of this batch are returned.

        Args:
            batch: batch of the camera; batches must be given in the order of delivery.
            restart: function that is called if the batch is faulty or does not continue the lines
                of the previous batch.

        Returns:
            Copy of the lines, oldest first, shape (m, n); m is at least 2.

        Raises:
            Unmeasured: the batch is faulty, or there are fewer than two lines.
        """
        count, pixels = batch.lines.shape
        fault = batch.fault
        if count > 0 and pixels != self._sensor.pixels:
            fault = f"lines have {pixels} px, but {self._sensor.pixels} px are configured"
        if fault:
            self.reset()
            restart()
            raise Unmeasured(fault)
        if count == 0:
            raise Unmeasured("the batch contains no line")
        elapsed = (batch.stamp_ns - self._last_ns) / self.period_ns
        if batch.stamp_ns - self._last_ns < -_ANEW_NS:
            self.reset()
        last = self._last
        if last is not None:
            self._check_order(batch, last, elapsed)
        late = elapsed - count
        self.joined = last is not None and last.dtype == batch.lines.dtype and abs(late) < 0.5
        if last is not None and self.joined:
            chain: Lines = np.concatenate((last[None], batch.lines))  # type: ignore[assignment]
        else:
            chain = batch.lines.copy()
            restart()
        self._last = chain[-1]
        self._last_ns = batch.stamp_ns
        self.stretch, self.remark = 0.0, ""
        if last is not None and self._contradicts(late, elapsed, count):
            self.stretch = abs(late) / count
            self.remark = (
                f"time: {count} lines in {elapsed:.4g} periods of {self._sensor.line_rate:g} "
                "lines/s: lines are lost or repeated, the line rate is wrong, or an encoder "
                "triggers the camera"
            )
        if len(chain) < 2:
            raise Unmeasured("only one line, and no previous line to compare it with")
        return chain

    def _check_order(self, batch: LineBatch, last: Lines, elapsed: float) -> None:
        """Check that a batch is newer than the previous batch.

        Args:
            batch: at least one line, with the configured number of pixels.
            last: last line of the previous batch, shape (n,).
            elapsed: time since the last batch [line periods].

        Raises:
            Unmeasured: the stamp is older than the stamp of the previous batch, or the batch
                repeats the lines of the previous batch.
        """
        if elapsed < 0.0:
            raise Unmeasured(
                f"time: the stamp is {-elapsed:.3g} line periods older than that of the "
                "previous batch; batches are swapped"
            )
        lines = batch.lines
        if elapsed and len(lines) > 1 and np.array_equal(last, lines[-1]):
            if np.array_equal(lines[-2], lines[-1]):
                return  # a constant view
            self._last_ns = batch.stamp_ns
            raise Unmeasured("time: the lines of the previous batch were repeated")

    def _contradicts(self, late: float, elapsed: float, count: int) -> bool:
        """Return whether the time since the last batch contradicts the number of lines.

        A batch that is missing as a whole, or that was delivered twice, is no contradiction. If the
        batch follows the previous one without a gap, `late` is added to a decaying sum, which is
        checked; otherwise only this batch is checked.

        Args:
            late: `elapsed` minus `count` [line periods].
            elapsed: time since the last batch [line periods].
            count: number of lines in the batch.
        """
        if self.joined:
            self._late += late
            drifted = abs(self._late) >= 1.0
            # Errors due to stamp jitter cancel over time; those due to a wrong rate accumulate.
            self._late *= 0.9
            return drifted
        self._late = 0.0
        again = elapsed == 0.0  # the batch was delivered twice, which is no fault
        return not again and count > 1 and late < _WHOLE * count


class SensorOdometry:
    """Measures the velocity of one line camera along its axis."""

    def __init__(
        self, sensor: LineSensor, configuration: OdometryConfiguration, tables: Path | None = None
    ) -> None:
        """Create the processing steps for one camera.

        Args:
            sensor: configuration of the camera.
            configuration: configuration of the odometry.
            tables: file with the camera's reference tables, or None.

        Raises:
            LineBatchError: the file contains no tables of this camera.
        """
        self._sensor = sensor
        self._scale = sensor.pixel_pitch * sensor.line_rate  # [m/s per px]
        self._chain = LineChain(sensor)
        self._references = References(sensor.pixels)
        if tables is not None:
            self._references.load(tables)
        self._method: JointEstimator | PairsMethod = (
            PairsMethod(sensor, configuration)
            if configuration.method == "pairs"
            else JointEstimator(
                sensor,
                configuration.shift_limit(sensor),
                0.0 if self._references.white else sensor.non_uniformity,
                self._references.pattern,
            )
        )
        self._finish_last: Callable[[], SensorReading | None] = lambda: None
        self._keyframe = Keyframe(sensor.pixels)
        self._static: tuple[int, Lines] | None = None  # stamp [ns] and oldest line of a static view
        self._views: list[tuple[int, Lines]] = []  # stamps [ns] and newest lines of the last views
        self._plausibility = Plausibility(
            sensor, configuration.maximum_acceleration, configuration.median_tolerance
        )

    @property
    def pattern(self) -> FixedPattern | None:
        """Present estimate of the camera's fixed pattern; None with the method `pairs`."""
        method = self._method
        return method.pattern if isinstance(method, JointEstimator) else None

    def discard(self) -> None:
        """Discard the last measurement, because the view was covered."""
        self._plausibility.reset()

    def update(self, batch: LineBatch) -> SensorReading:
        """Return the mean velocity over a batch; this method never raises an exception."""
        return self.begin(batch)()

    def begin(self, batch: LineBatch) -> Callable[[], SensorReading]:
        """Start to measure a batch in the background; return a function that awaits the result."""
        self._finish_last()
        try:
            lines = self._references.correct(self._chain.take(batch, self._method.reset))
        except Unmeasured as nothing:
            self._keyframe.reset()
            reading = nothing.reading
            return lambda: reading
        work = partial(self._measure, batch.stamp_ns, lines)
        self._finish_last = cache(in_background(work, worth=lines.size >= _BACKGROUND))
        return self._finish_last

    def _measure(self, stamp_ns: int, lines: Lines) -> SensorReading:
        """Return the reading for a batch, including `static_time` and `decays`.

        Args:
            stamp_ns: time of exposure of the newest line [ns].
            lines: consecutive lines, oldest first, shape (m + 1, n).
        """
        try:
            _check(lines)
            displacement = self._method.measure(lines, self._plausibility, stamp_ns)
            self._plausibility.accept(stamp_ns, len(lines) - 1, displacement.value)
            if self._chain.stretch > _LONGEST_STRETCH:
                raise Unmeasured(self._chain.remark)
        except Unmeasured as nothing:
            self._keyframe.reset()
            return dataclasses.replace(nothing.reading, **self._constant(stamp_ns, lines, 0.0))
        velocity = displacement.value * self._scale
        if not self._chain.joined:
            self._keyframe.reset()
        decays = self._keyframe.compare(
            stamp_ns, self._chain.period_ns, displacement.rest, displacement.value
        )
        constant = self._constant(stamp_ns, lines, displacement.value)
        # The texture of a constant view was not seen to move, so its slope is unknown.
        slope = max(displacement.slope, SLOPE if constant["static_time"] > 0.0 else 0.0)
        return SensorReading(
            velocity=velocity,
            variance=displacement.variance * self._scale**2 + (velocity * self._chain.stretch) ** 2,
            correlation=displacement.correlation,
            inlier_share=displacement.share,
            measured=True,
            remark="; ".join(filter(None, (self._chain.remark, displacement.remark))),
            slope=slope,
            decays=decays,
            **constant,
        )

    def _constant(self, stamp_ns: int, lines: Lines, displacement: float) -> dict[str, Any]:
        """Return the attributes `static_time` and `replaced` of a reading.

        Args:
            stamp_ns: time of exposure of the newest line [ns].
            lines: consecutive lines, oldest first, shape (m + 1, n).
            displacement: mean displacement per line [px]; 0 if unknown.
        """
        static_time, replaced = self._static_time(stamp_ns, lines, displacement), False
        # A vehicle that can stop takes this time for the last half of the width of the view. Views
        # of twice this time show whether the one before was another one only for a while.
        longest = math.sqrt(self._sensor.width / HARDEST_STOP)
        views = [view for view in self._views if 0 < stamp_ns - view[0] < 2e9 * longest]
        self._views = [*views, (stamp_ns, lines[-1])]
        if views and 0.0 < static_time < longest:
            share, error = kept(lines[-2:], views[0][1], 1)
            if share + SIGNIFICANT * error < 0.5:
                replaced = self._replaced(stamp_ns, lines, views)
        return {"static_time": static_time, "replaced": replaced}

    def _replaced(self, stamp_ns: int, lines: Lines, views: list[tuple[int, Lines]]) -> bool:
        """Return whether a view that is constant now was another one shortly before.

        It was if it lost more of its texture between two of the views than a constant view and a
        vehicle that stops may lose.

        Args:
            stamp_ns: stamp of the newest line [ns].
            lines: lines of the constant view, oldest first, shape (m + 1, n).
            views: stamps [ns] and lines before them, oldest first.
        """
        sensor, held, since = self._sensor, 1.0, stamp_ns
        lost = (1.0 - _STATIC_SHARE) / (1e-9 * (len(lines) - 1) * self._chain.period_ns)  # per s
        for seen, line in reversed(views):
            elapsed, gap = 1e-9 * (stamp_ns - seen), 1e-9 * (since - seen)
            reach = 1 + int(0.5 * HARDEST_STOP * elapsed**2 / sensor.pixel_pitch)
            share, error = kept(lines[-2:], line, reach)
            allowed = lost * gap + 0.5 * HARDEST_STOP * gap**2 / sensor.width
            if held - share > allowed + SIGNIFICANT * math.sqrt(2.0) * error:
                return True
            held, since = min(share, 1.0), seen
        return False

    def _static_time(self, stamp_ns: int, lines: Lines, displacement: float) -> float:
        """Return for how long the lines have not changed [s]; 0 if they changed within this batch.

        The newest line is compared with several older lines, because on periodic ground the first
        and last lines alone may match. Line 0 is excluded, because it belongs to the previous
        batch. The oldest line of the static view is kept, so that slow motion is noticed too.
        """
        span, before, self._static = len(lines) - 1, self._static, None
        if span < _STATIC_PAIRS or abs(displacement) * span > _STATIC_DISPLACEMENT:
            return 0.0
        near = _correlation(lines[-2], lines[-1])
        # If neighboring lines correlate weakly, the second limit is too low to exclude lines of
        # different ground.
        least = max(_STATIC_SHARE * near, 2.0 * near - 1.0 - _STATIC_TOLERANCE)
        older = (lines[1], lines[span // 3], lines[span // 2])
        if not self._method.still and any(_correlation(line, lines[-1]) <= least for line in older):
            return 0.0
        oldest = stamp_ns - round((span - 1) * self._chain.period_ns), lines[1]
        if before and before[0] < stamp_ns and _correlation(before[1], lines[-1]) > least:
            oldest = before
        self._static = oldest
        return 1e-9 * (stamp_ns - oldest[0])


def _correlation(one: Lines, other: Lines) -> float:
    """Return Pearson's correlation of two lines; -1 if a line is constant."""
    x, y = one - one.mean(), other - other.mean()
    norm = math.sqrt(float(x @ x) * float(y @ y))
    return float(x @ y) / norm if norm > 0.0 else -1.0


def _check(lines: Lines) -> None:
    """Check that lines have contrast and are not repeated by the camera.

    Raises:
        Unmeasured: the lines have no contrast, or the camera repeats them.
    """
    low = int(lines.min())
    if low == int(lines.max()):
        raise Unmeasured(f"no contrast: every pixel is at gray level {low}")
    frozen = np.count_nonzero((lines[1:] == lines[:-1]).all(axis=1))
    if frozen >= _FROZEN_PAIRS:
        raise Unmeasured(f"frozen: {frozen} of {len(lines) - 1} line pairs are identical")
