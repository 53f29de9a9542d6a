"""Assembly of frames into batches of consecutive lines without gaps.

A camera takes frames at a constant rate, but the frames arrive with varying delays. The odometry
needs constant periods. It must also detect lost frames, because they change the time in which a
displacement occurs. Frame numbers from the camera driver reveal lost frames. Without frame numbers,
if a frame arrives more than half a period late, a frame before it is assumed to be lost. If the
next frame shows that the frame was only late, the clock is reset, and the lines before and after
the reset are not joined.
"""

import numpy as np
from numpy.typing import NDArray

from omni_core.signals import LineBatch, Lines
from omni_vehicle.camera.configuration import CameraConfiguration
from omni_vehicle.camera.cut import FrameError

_FOLLOWED = 0.05  # share of a frame's timing error by which its stamp is corrected
_DRIFT = 0.002  # share of a frame's timing error by which the period is corrected
_FURTHEST = 50.0  # timing error of a numbered frame above which the clock is reset [periods]
_WIDEST = 0.1  # limit on the relative deviation of the rate from the configured one [1]


class FrameClock:
    """Computes the stamps of frames from their times of arrival, and counts lost frames.

    Attributes:
        lost: number of lost frames so far.
        resets: number of resets of the clock so far.
        is_off_rate: whether the rate of the frames is farther from the configured rate than that of
            a free-running camera can be; the stamps are then wrong.
    """

    def __init__(self, rate: float) -> None:
        """Create a clock that has received no frame.

        Args:
            rate: configured frame rate [1/s].
        """
        self._nominal_ns = 1e9 / rate
        self._period_ns = 1e9 / rate
        self._last_ns: float | None = None
        self._number: int | None = None
        self.lost = 0
        self.resets = 0
        self.is_off_rate = False

    @property
    def rate(self) -> float:
        """Frame rate measured from the times of arrival [1/s]."""
        return 1e9 / self._period_ns

    def take(self, arrival_ns: int, number: int | None = None) -> tuple[int, int]:
        """Return the stamp of a frame [ns] and the number of frames lost before it.

        If the clock is reset, this number is at least 1, so that the lines are not joined.

        Args:
            arrival_ns: stamp of the camera driver or, without such a stamp, time of arrival [ns].
            number: frame number from the camera driver; None if frames are not numbered.
        """
        before, self._number = self._number, number
        if self._last_ns is None:
            self._last_ns = float(arrival_ns)
            return arrival_ns, 0
        since = arrival_ns - self._last_ns
        if number is not None and before is not None and number > before:
            steps, furthest = number - before, _FURTHEST
        else:
            steps, furthest = max(1, round(since / self._period_ns)), 0.5
        error = since - steps * self._period_ns
        lost = steps - 1
        self.lost += lost
        if abs(error) > furthest * self._period_ns:
            # Arrivals and stamps disagree, for example because a late frame was taken for a lost
            # one. Reset the clock to the time of arrival. Stamps must not decrease.
            self.resets += 1
            self._last_ns = max(float(arrival_ns), self._last_ns + 1.0)
            return round(self._last_ns), max(lost, 1)
        self._last_ns += steps * self._period_ns + _FOLLOWED * error
        moved = self._period_ns + _DRIFT * error / steps
        slowest, fastest = (self._nominal_ns * (1.0 + w) for w in (_WIDEST, -_WIDEST))
        self._period_ns = min(max(moved, fastest), slowest)
        self.is_off_rate = self._period_ns != moved
        return round(self._last_ns), lost


class LineAssembler:
    """Extracts lines from frames and assembles them into stamped batches.

    A batch never extends across lost frames, so consecutive lines are always one line period apart.
    The odometry detects a gap between two batches from the stamps. While the frames have another
    rate than configured, their lines are dropped.

    Attributes:
        clock: clock that stamps the frames and counts lost ones.
        line_rate: line rate of the last frame [1/s]; 0 before the first frame.
    """

    def __init__(self, configuration: CameraConfiguration) -> None:
        """Create an assembler that has received no frame."""
        self._configuration = configuration
        self._cut = configuration.cut
        self.clock = FrameClock(configuration.frame_rate)
        self._waiting: list[Lines] = []
        self._newest_ns = 0
        self._shape: tuple[int, str] | None = None
        self.line_rate = 0.0

    @property
    def pixels(self) -> int:
        """Number of pixels per line; 0 before the first frame."""
        return self._shape[0] if self._shape else 0

    def take(
        self, picture: NDArray[np.uint8] | NDArray[np.uint16], arrival_ns: int, number: int | None
    ) -> list[LineBatch]:
        """Add a frame and return the complete batches, oldest first.

        Args:
            picture: gray levels, shape (height, width).
            arrival_ns: stamp of the camera driver or, without such a stamp, time of arrival [ns].
            number: frame number from the camera driver; None if frames are not numbered.

        Raises:
            FrameError: the picture does not contain the configured rows, or its lines have another
                length or type than the lines of earlier frames.
        """
        lines = self._cut.lines(picture)
        shape = (lines.shape[1], str(lines.dtype))
        if self._shape not in (None, shape):
            raise FrameError(f"has lines of {shape[0]} px ({shape[1]}), unlike earlier frames")
        self._shape = shape
        stamp_ns, lost = self.clock.take(arrival_ns, number)
        stamp_ns -= round(1e9 * self._configuration.latency)
        rate = self.line_rate = self._configuration.line_rate(len(lines))
        period_ns = 1e9 / rate
        stamps_ns = stamp_ns + np.rint(period_ns * np.arange(1 - len(lines), 1)).astype(np.int64)
        ready = self.finish() if lost else []
        if self.clock.is_off_rate:
            self._waiting = []
            return ready
        # Batches end at multiples of their duration, so that the batches of several cameras end at
        # the same time.
        batch_ns = 1e9 * self._configuration.batch
        last = stamps_ns // batch_ns != (stamps_ns + round(period_ns)) // batch_ns
        if self._configuration.row_time > 0.0:  # each frame is followed by a gap
            last[:] = False
            last[-1] = True
        begin = 0
        for end in map(int, np.flatnonzero(last) + 1):
            self._waiting.append(lines[begin:end])
            self._newest_ns = int(stamps_ns[end - 1])
            ready += self.finish()
            begin = end
        if begin < len(lines):
            self._waiting.append(lines[begin:])
            self._newest_ns = stamp_ns
        return ready

    def finish(self) -> list[LineBatch]:
        """Return a batch with the lines that are waiting, if there are any."""
        if not self._waiting:
            return []
        lines: Lines = np.ascontiguousarray(np.concatenate(self._waiting))
        self._waiting = []
        return [LineBatch(self._newest_ns, lines)]
