"""Joining of a camera's batches into a chain of consecutive lines, with a check of the stamps.

The line period is computed from the stamps of the newest lines and the number of lines between
them. If this period differs from the configured period, lines were lost or repeated, or the line
rate is wrong. In each case the velocity has the same relative error as the period. A missing batch
does not cause this error, because the lines of the next batch are still consecutive.
"""

from collections.abc import Callable

import numpy as np

from linescan_odometry.measurements import Unmeasured
from omni_platform.sensors import LineSensor
from omni_platform.signals import LineBatch, Lines

_ANEW = 10.0  # batches; if stamps go back by more than this, a recording is played again
_WHOLE = 0.75  # share of a batch; a longer gap counts as a missing batch


class LineChain:
    """Stores the last line of a batch, for comparison with the first line of the next batch.

    Attributes:
        stretch: relative difference between the measured duration of the last batch and its
            duration at the configured line rate [1]; 0 within the tolerance. The velocity may have
            an equal relative error.
        remark: description of this difference; empty within the tolerance.
        joined: whether the last batch followed the previous one without a gap.
    """

    def __init__(self, sensor: LineSensor) -> None:
        """Create a chain without a stored line."""
        self._pixels = sensor.pixels
        self._rate = sensor.line_rate
        self._period_ns = 1e9 / sensor.line_rate
        self._buffer: Lines = np.empty((0, sensor.pixels), np.uint8)
        self._last_row = -1
        self._last_ns: int | None = None
        self.stretch = 0.0
        self.remark = ""
        self.joined = False
        self._late = 0.0  # decaying sum of the delays of earlier batches [line periods]

    def reset(self) -> None:
        """Discard the stored line; the next batch starts a new chain."""
        self._last_row = -1
        self._last_ns = None
        self._late = 0.0

    def take(self, batch: LineBatch, restart: Callable[[], None]) -> Lines:
        """Return at least two consecutive lines, the result of `join` for a valid batch.

        Args:
            batch: batch of the camera; batches must be given in the order of delivery.
            restart: function that is called if the batch is faulty or does not continue the lines
                of the previous batch.

        Raises:
            Unmeasured: the batch is faulty, or there are fewer than two lines.
        """
        count, pixels = batch.lines.shape
        fault = batch.fault
        if count > 0 and pixels != self._pixels:
            fault = f"lines have {pixels} px, but {self._pixels} px are configured"
        if fault:
            self.reset()
            restart()
            raise Unmeasured(fault)
        if count == 0:
            raise Unmeasured("the batch contains no line")
        lines = self.join(batch)
        if len(lines) == count:
            restart()
        if len(lines) < 2:
            raise Unmeasured("only one line, and no previous line to compare it with")
        return lines

    def join(self, batch: LineBatch) -> Lines:
        """Return the last line of the previous batch, followed by the lines of this batch.

        At the start and after a missing batch, only the lines of this batch are returned.

        Args:
            batch: at least one line, with the configured number of pixels.

        Returns:
            Lines, oldest first; the next call overwrites the array.

        Raises:
            Unmeasured: the stamp is older than the stamp of the previous batch, or the batch
                repeats the lines of the previous batch.
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
                    f"time: the stamp is {-elapsed:.3g} line periods older than that of the "
                    "previous batch; batches are swapped"
                )
        last = self._buffer[self._last_row] if self._last_row >= 0 else None
        if last is not None and count > 1 and elapsed:
            repeated = np.array_equal(last, lines[-1]) and not np.array_equal(lines[-2], lines[-1])
            if repeated:
                self._last_ns = batch.stamp_ns
                raise Unmeasured("time: the lines of the previous batch were repeated")
        late = 0.0 if elapsed is None else elapsed - count
        same_type = last is not None and last.dtype == lines.dtype
        joined = same_type and abs(late) < 0.5
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
        """Return whether the time since the last batch contradicts the number of lines.

        A batch that is missing as a whole, or that was delivered twice, is no contradiction.

        Args:
            late: `elapsed` minus `count` [line periods].
            elapsed: time since the last batch [line periods].
            count: number of lines in the batch.
            joined: whether the batch follows the previous one without a gap.
        """
        if joined:
            self._late += late
            drifted = abs(self._late) >= 1.0
            # Errors due to stamp jitter cancel over time; those due to a wrong rate accumulate.
            self._late *= 0.9
            return drifted
        self._late = 0.0
        again = elapsed == 0.0  # the batch was delivered twice, which is no fault
        return not again and count > 1 and late < _WHOLE * count

    def _keep(self, lines: Lines, *, joined: bool) -> None:
        """Store the lines of a batch in the buffer, starting at row 1.

        Args:
            lines: lines of the batch.
            joined: whether the lines follow the previous batch without a gap. If so, the last line
                of the previous batch is stored in row 0.
        """
        count = len(lines)
        last = self._buffer[self._last_row].copy() if joined else None
        if self._buffer.dtype != lines.dtype or len(self._buffer) < count + 1:
            grown: Lines = np.empty((count + 1, self._pixels), lines.dtype)
            self._buffer = grown
        if last is not None:
            self._buffer[0] = last
        self._buffer[1 : count + 1] = lines
        self._last_row = count
