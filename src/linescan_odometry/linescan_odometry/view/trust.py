"""Tells how far a match across the axis is believed, by how often a camera has seen its ground.

Over joints or grain that run askew most batches match nowhere. Some match by chance, and those err
by more than their own scatter says, whichever lines are compared. So the deviation of a match that
motion across the axis may pull at (all lines of a batch together; consecutive lines over few
structures) grows by ``1 / s^2``, with s the share of the camera's batches of late that showed their
ground. One that is matched by consecutive lines, and not by those farther apart, did not. A ground
that always matches keeps its variances.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

from linescan_odometry.measurements import SensorReading

_REMEMBERED = 4.0  # batches
_LEAST = 0.25  # share


class Trust:
    """Remembers which share of the batches of each camera showed their ground."""

    def __init__(self, names: Iterable[str]) -> None:
        """Start with grounds that show.

        Args:
            names: of the cameras.
        """
        self._share = dict.fromkeys(names, 1.0)

    def growth(self, name: str, reading: SensorReading) -> float:
        """Return the factor of the deviation of a camera's reading [1]."""
        own = 1.0 - float(reading.unlike) / _REMEMBERED
        return max(own * self._share[name], _LEAST) ** -2

    def weighed(self, readings: Mapping[str, SensorReading]) -> dict[str, SensorReading]:
        """Return the readings of lines that were matched all together, as far as they are believed.

        Args:
            readings: of all cameras by name.
        """
        weighed = {}
        for name, reading in readings.items():
            if reading.measured and reading.batch_time > 0.0:
                variance = reading.variance * self.growth(name, reading) ** 2
                weighed[name] = dataclasses.replace(reading, variance=variance)
        return weighed

    def remember(self, readings: Mapping[str, SensorReading]) -> None:
        """Take what could be believed in the end; no lines, or no contrast, tell nothing of it."""
        for name, reading in readings.items():
            if reading.measured or reading.unlike:
                self._share[name] += (float(not reading.unlike) - self._share[name]) / _REMEMBERED
