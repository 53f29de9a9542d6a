"""Variance of matches by chance in motion across the axis, from the share of recent matches.

Over oblique joints or textures most batches do not match. Some match by chance, with errors larger
than their residuals. So the standard deviation of a match that motion across the axis may bias (a
whole-batch estimate; consecutive lines over few features) is multiplied by ``1 / s^2``, with s the
share of the camera's recent batches that matched. A batch that matches only with consecutive lines
does not count. A ground that always matches keeps its variances.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

from linescan_odometry.measurements import SensorReading

_REMEMBERED = 4.0  # batches
_LEAST = 0.25  # share


class Trust:
    """Stores the share of recent batches of each camera that matched."""

    def __init__(self, names: Iterable[str]) -> None:
        """Start with a share of 1.

        Args:
            names: of the cameras.
        """
        self._share = dict.fromkeys(names, 1.0)

    def growth(self, name: str, reading: SensorReading) -> float:
        """Return the factor on the standard deviation of a camera's reading [1]."""
        own = 1.0 - float(reading.unlike) / _REMEMBERED
        return max(own * self._share[name], _LEAST) ** -2

    def weighed(self, readings: Mapping[str, SensorReading]) -> dict[str, SensorReading]:
        """Return the readings of whole-batch estimates with their increased variances.

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
        """Update with the final readings; batches without lines or contrast are ignored."""
        for name, reading in readings.items():
            if reading.measured or reading.unlike:
                self._share[name] += (float(not reading.unlike) - self._share[name]) / _REMEMBERED
