"""Joins the batches of one sensor to a chain of consecutive lines, and checks their time.

The line period follows from the stamps of the newest lines and the number of lines in between. If
it differs from the configured one, lines were lost or repeated, or the line rate is wrong; in each
case the velocity has the same relative error. A missing batch is no such fault: the lines of the
next one are still consecutive.
"""

from collections.abc import Callable

import numpy as np

from linescan_odometry.measurements import LineBatch, Lines, Unmeasured
from omni_platform.sensors import LineSensor

_ANEW = 10.0  # batches; stamps this much older mean that a recording is played again
_WHOLE = 0.75  # share of a batch; a longer gap is a missing batch


class LineChain:
    """Stores the last line of a batch for comparison with the first line of the next one.

    Attributes:
        stretch: relative deviation of the last batch's time from its number of lines, and so the
            possible relative error of its velocity [1]; 0 if it is within the tolerance.
        remark: description of this deviation; empty if it is within the tolerance.
        joined: whether the last batch followed the one before.
    """

    def __init__(self, sensor: LineSensor) -> None:
        """Start with no line."""
        self._pixels = sensor.pixels
        self._rate = sensor.line_rate
        self._period_ns = 1e9 / sensor.line_rate
        self._buffer: Lines = np.empty((0, sensor.pixels), np.uint8)
        self._last_row = -1
        self._last_ns: int | None = None
        self.stretch = 0.0
        self.remark = ""
        self.joined = False
        self._late = 0.0  # decaying sum of the delays of earlier batches [lines]

    def reset(self) -> None:
        """Forget the last line."""
        self._last_row = -1
        self._last_ns = None
        self._late = 0.0

    def take(self, batch: LineBatch, restart: Callable[[], None]) -> Lines:
        """Return two or more consecutive lines, oldest first; see `join`.

        Args:
            batch: a batch of the camera, in the order of delivery.
            restart: called if the lines do not follow those of the batch before.

        Raises:
            Unmeasured: the batch is faulty, or there are fewer than two lines.
        """
        count, pixels = batch.lines.shape
        fault = batch.fault
        if count > 0 and pixels != self._pixels:
            fault = f"lines of {pixels} px, the configuration says {self._pixels} px"
        if fault:
            self.reset()
            restart()
            raise Unmeasured(fault)
        if count == 0:
            raise Unmeasured("the batch holds no line")
        lines = self.join(batch)
        if len(lines) == count:
            restart()
        if len(lines) < 2:
            raise Unmeasured("a single line with none before it to compare with")
        return lines

    def join(self, batch: LineBatch) -> Lines:
        """Return the last line of the batch before, followed by the lines of a batch.

        That last line is omitted if the batches are not consecutive: at the start and after a
        missing batch.

        Args:
            batch: at least one line of the configured number of pixels.

        Returns:
            m or m + 1 lines, oldest first; the next call overwrites the array.

        Raises:
            Unmeasured: the stamp is older than that of the batch before, or the lines repeat that
                batch.
        """
        lines = batch.lines
        count = len(lines)
        elapsed = None
        if self._last_ns is not None:
            elapsed = (batch.stamp_ns - self._last_ns) / self._period_ns
            if elapsed < -_ANEW * count:
                self.reset()
                elapsed = None
            elif elapsed < 0.0:
                raise Unmeasured(
                    f"time: the stamp is {-elapsed:.3g} lines older than the one before, batches "
                    "are swapped"
                )
        last = self._buffer[self._last_row] if self._last_row >= 0 else None
        if last is not None and count > 1 and elapsed:
            repeated = np.array_equal(last, lines[-1]) and not np.array_equal(lines[-2], lines[-1])
            if repeated:
                self._last_ns = batch.stamp_ns
                raise Unmeasured("time: the lines of the batch before came again")
        late = 0.0 if elapsed is None else elapsed - count
        alike = last is not None and last.dtype == lines.dtype
        joined = alike and abs(late) < 0.5
        self.joined = joined
        self._keep(lines, joined=joined)
        self._last_ns = batch.stamp_ns
        self.stretch, self.remark = 0.0, ""
        if elapsed is not None and self._contradicts(late, elapsed, count, joined=joined):
            self.stretch = abs(late) / count
            self.remark = (
                f"time: {count} lines in {elapsed:.4g} periods of {self._rate:g} lines/s: lines "
                "are lost or repeated, or the line rate is wrong"
            )
        return self._buffer[0 if joined else 1 : count + 1]

    def _contradicts(self, late: float, elapsed: float, count: int, *, joined: bool) -> bool:
        """Return whether the time does not fit the number of lines; a missing batch is no fault."""
        if joined:
            self._late += late
            drifted = abs(self._late) >= 1.0
            # Jitter of the stamps averages out, a wrong rate accumulates.
            self._late *= 0.9
            return drifted
        self._late = 0.0
        again = elapsed == 0.0  # the batch came twice, which is no fault
        return not again and count > 1 and late < _WHOLE * count

    def _keep(self, lines: Lines, *, joined: bool) -> None:
        """Store a batch from row 1 on; if `joined`, row 0 keeps the last line before it."""
        count = len(lines)
        last = self._buffer[self._last_row].copy() if joined else None
        if self._buffer.dtype != lines.dtype or len(self._buffer) < count + 1:
            grown: Lines = np.empty((count + 1, self._pixels), lines.dtype)
            self._buffer = grown
        if last is not None:
            self._buffer[0] = last
        self._buffer[1 : count + 1] = lines
        self._last_row = count
