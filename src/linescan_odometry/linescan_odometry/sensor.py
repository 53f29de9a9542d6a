"""One line camera measured by one method: `pairs` of section 4.4, or `joint`.

`SensorOdometry.update` joins a batch to the one before, passes the lines to the configured method
and returns velocity and variance. A stage that cannot measure raises `Unmeasured` with the reason.
"""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from linescan_odometry.chain import LineChain
from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.joint.fixed_pattern import FixedPattern
from linescan_odometry.joint.sensor import JointMethod
from linescan_odometry.matching.pairs import count_identical
from linescan_odometry.matching.smoothed_peak import correlation
from linescan_odometry.measurements import Displacement, LineBatch, Lines, SensorReading, Unmeasured
from linescan_odometry.pair_method import PairsMethod
from linescan_odometry.plausibility import Plausibility
from linescan_odometry.references import References
from linescan_odometry.view.oblique_texture import Keyframe
from omni_platform.background import in_background
from omni_platform.sensors import LineSensor

_FROZEN_PAIRS = 3  # identical neighbors that the noise of a live camera rules out
_LONGEST_STRETCH = 0.25  # largest `LineChain.stretch` of a batch that is measured
_STATIC_PAIRS = 4  # fewest line pairs that show that a view is static
_STATIC_DISPLACEMENT = 0.5  # px, from the oldest line to the newest one
_STATIC_TOLERANCE = 0.002  # loss of correlation allowed beyond twice that between neighbors
_BACKGROUND = 16384  # pixels of a batch, from which a background thread is worth its hand-over


class Method(Protocol):
    """Measures the displacement of the lines of one camera."""

    def measure(self, lines: Lines, plausibility: Plausibility, stamp_ns: int) -> Displacement:
        """Measure a batch.

        Args:
            lines: consecutive lines, oldest first, shape (m + 1, n).
            plausibility: range of the displacements that the platform can have made.
            stamp_ns: exposure of the newest line [ns].

        Raises:
            Unmeasured: the lines show no displacement.
        """

    def reset(self) -> None:
        """Discard all lines; the next line starts a new sequence."""


class _Joined(NamedTuple):
    """Consecutive lines, and the stamp of the newest one [ns]."""

    stamp_ns: int
    lines: Lines


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
            configuration: configuration of the odometry.
            tables: file of its references; None without.

        Raises:
            LineBatchError: the file holds no tables of this camera.
        """
        self._sensor = sensor
        self._configuration = configuration
        self._chain = LineChain(sensor)
        self._references = References(sensor.pixels)
        if tables is not None:
            self._references.load(tables)
        self._method: Method = (
            PairsMethod(sensor, configuration)
            if configuration.method == "pairs"
            else JointMethod(sensor, configuration, self._references.pattern)
        )
        self._finish_last: Callable[[], SensorReading | None] = lambda: None
        self._keyframe = Keyframe(sensor.pixels)
        self._plausibility = Plausibility(
            sensor, configuration.maximum_acceleration, configuration.median_tolerance
        )

    @property
    def pattern(self) -> FixedPattern | None:
        """Fixed pattern of the camera as estimated so far; None with the method `pairs`."""
        method = self._method
        return method.estimator.pattern if isinstance(method, JointMethod) else None

    def update(self, batch: LineBatch) -> SensorReading:
        """Measure the mean velocity over a batch; raises no exception for any lines."""
        return self.begin(batch)()

    def begin(self, batch: LineBatch) -> Callable[[], SensorReading]:
        """Begin to measure a batch in the background; return a function that awaits the result."""
        self._finish_last()
        try:
            joined = _Joined(
                batch.stamp_ns,
                self._references.correct(self._chain.take(batch, self._method.reset)),
            )
        except Unmeasured as nothing:
            self._keyframe.reset()
            reading = nothing.reading
            return lambda: reading
        work = in_background(partial(self._measure, joined), worth=joined.lines.size >= _BACKGROUND)
        self._finish_last = cache(work)
        return self._finish_last

    def _measure(self, joined: _Joined) -> SensorReading:
        stamp_ns, lines = joined
        try:
            _check(lines)
            displacement = self._method.measure(lines, self._plausibility, stamp_ns)
            self._plausibility.accept(stamp_ns, len(lines) - 1, displacement.value)
            return self._reading(stamp_ns, lines, displacement)
        except Unmeasured as nothing:
            self._keyframe.reset()
            return nothing.reading

    def _reading(self, stamp_ns: int, lines: Lines, displacement: Displacement) -> SensorReading:
        """Return the velocity of a displacement."""
        scale = self._sensor.pixel_pitch * self._sensor.line_rate
        velocity = displacement.value * scale
        if self._chain.stretch > _LONGEST_STRETCH:
            raise Unmeasured(self._chain.remark)
        if not self._chain.joined:
            self._keyframe.reset()
        period_ns = 1e9 / self._sensor.line_rate
        age, persistence = self._keyframe.compare(
            stamp_ns,
            period_ns,
            lines if displacement.rest is None else displacement.rest,
            displacement.value,
        )
        return SensorReading(
            velocity=velocity,
            variance=displacement.variance * scale**2 + (velocity * self._chain.stretch) ** 2,
            correlation=displacement.correlation,
            inlier_share=displacement.share,
            measured=True,
            remark=self._chain.remark,
            static_time=self._static_time(lines, displacement),
            reference_age=age,
            persistence=persistence,
            details=displacement.details,
        )

    def _static_time(self, lines: Lines, displacement: Displacement) -> float:
        """Return how long the lines have not changed [s]; 0 if they changed within this batch.

        The newest line is compared with older ones of the whole batch without its first line, which
        belongs to the batch before: on a periodic ground the ends alone may match.
        """
        span = len(lines) - 1
        if span < _STATIC_PAIRS or abs(displacement.value) * span > _STATIC_DISPLACEMENT:
            return 0.0
        near = correlation(lines[-2], lines[-1], 0)
        # Less than half of the correlation of neighbors may be chance.
        least = max(0.5 * near, 2.0 * near - 1.0 - _STATIC_TOLERANCE)
        older = (lines[1], lines[span // 3], lines[span // 2])
        if any(correlation(line, lines[-1], 0) <= least for line in older):
            return 0.0
        return (span - 1) / self._sensor.line_rate


def _check(lines: Lines) -> None:
    """Refuse lines without contrast, and lines that a camera repeats.

    Raises:
        Unmeasured: the lines have no contrast, or are repeated.
    """
    low = int(lines.min())
    if low == int(lines.max()):
        raise Unmeasured(f"no contrast: every pixel is at gray level {low}")
    frozen: int = count_identical(lines, np.empty(len(lines) - 1, np.bool_))
    if frozen >= _FROZEN_PAIRS:
        raise Unmeasured(f"frozen: {frozen} of {len(lines) - 1} line pairs are identical")
