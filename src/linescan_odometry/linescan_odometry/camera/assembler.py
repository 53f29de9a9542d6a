"""Assembly of frames into batches of consecutive lines without gaps."""

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.camera.configuration import CameraConfiguration
from linescan_odometry.camera.cut import FrameError
from linescan_odometry.camera.frame_clock import FrameClock
from omni_platform.signals import LineBatch, Lines


class LineAssembler:
    """Extracts lines from frames and assembles them into stamped batches.

    A batch never extends across lost frames, so consecutive lines are always one line period apart.
    The odometry detects a gap between two batches from the stamps.

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
