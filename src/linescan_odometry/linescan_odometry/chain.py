"""Joins the batches of one sensor into an unbroken chain of lines."""

from __future__ import annotations

import numpy as np

from linescan_odometry.measurements import LineBatch, Lines
from omni_platform.sensors import LineSensor


class LineChain:
    """Keeps the last line of a batch, so that the first of the next has one to compare with."""

    def __init__(self, sensor: LineSensor) -> None:
        """Start with no line."""
        self._pixels = sensor.pixels
        self._period_ns = 1e9 / sensor.line_rate
        self._buffer: Lines = np.empty((0, sensor.pixels), np.uint8)
        self._last_row = -1
        self._last_ns = 0

    def reset(self) -> None:
        """Forget the last line."""
        self._last_row = -1

    def join(self, batch: LineBatch) -> Lines:
        """Return the lines of a batch behind the last line of the batch before.

        That line is left out where the batches do not join: at the start, and where the oldest
        line is not one line period younger than the last one, to within half a period.

        Args:
            batch: at least one line of the configured number of pixels.

        Returns:
            m or m + 1 lines, oldest first; memory that the next call overwrites.
        """
        lines = batch.lines
        count = len(lines)
        if self._buffer.dtype != lines.dtype or len(self._buffer) < count + 1:
            grown: Lines = np.empty((count + 1, self._pixels), lines.dtype)
            if self._last_row >= 0 and self._buffer.dtype == lines.dtype:
                grown[0] = self._buffer[self._last_row]
            else:
                self._last_row = -1
            self._buffer = grown
        elif self._last_row > 0:
            self._buffer[0] = self._buffer[self._last_row]
        late_ns = batch.stamp_ns - self._last_ns - count * self._period_ns
        joined = self._last_row >= 0 and abs(late_ns) < 0.5 * self._period_ns
        self._buffer[1 : count + 1] = lines
        self._last_row = count
        self._last_ns = batch.stamp_ns
        return self._buffer[0 if joined else 1 : count + 1]
