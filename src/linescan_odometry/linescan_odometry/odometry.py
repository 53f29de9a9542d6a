"""Line-scan odometry: batches of lines from three or more sensors to the twist of the platform.

Each sensor's displacements come from a full search refined to sub-pixel accuracy, pass a median
filter and become a velocity along the sensor's axis; weighted least squares turn these into the
twist. The twist is the mean over the batch: while the platform accelerates it lags by half the
duration of a batch, 5 ms at 100 batches per second (0.05 m/s at 10 m/s^2).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import (
    UNMEASURED_VARIANCE,
    FloatArray,
    LineBatch,
    LineBatchError,
    SensorReading,
    TwistEstimate,
)
from linescan_odometry.sensor import SensorOdometry
from linescan_odometry.twist import TwistSolver

__all__ = [
    "LineBatch",
    "LineBatchError",
    "LineScanOdometry",
    "OdometryConfiguration",
    "SensorReading",
    "TwistEstimate",
]

_UNKNOWNS = 3  # components of the twist
_MINIMUM_VARIANCE = 1e-12  # [m^2/s^2]; keeps the weights finite for noise-free lines


class LineScanOdometry:
    """Body twist from one-dimensional line cameras."""

    def __init__(self, configuration: OdometryConfiguration) -> None:
        """Prepare for the sensors of the configuration.

        Raises:
            ConfigurationError: the placement of the sensors is singular.
        """
        self._configuration = configuration
        self._sensors = {
            name: SensorOdometry(sensor, configuration)
            for name, sensor in configuration.sensors.items()
        }
        self._solver = TwistSolver(configuration.sensors, configuration.minimum_lever)
        self._stamp_ns = 0

    def update(self, batches: Mapping[str, LineBatch]) -> TwistEstimate:
        """Take the lines since the last update and estimate the twist.

        Args:
            batches: lines by sensor name; a sensor that is left out has not measured.

        Raises:
            LineBatchError: a name is not that of a configured sensor.
        """
        for name in batches:
            if name not in self._sensors:
                raise LineBatchError(
                    f"{name!r} is not one of the sensors {', '.join(self._sensors)}"
                )
        if batches:
            self._stamp_ns = max(batch.stamp_ns for batch in batches.values())
        readings = {name: self._read(name, batches.get(name)) for name in self._sensors}
        return self._estimate(readings)

    def warm_up(self) -> None:
        """Compile or load every kernel, so that the first update is as fast as the others.

        Leaves the odometry as it was: lines of the sensors' sizes go through another one.
        """
        trial = LineScanOdometry(self._configuration)
        generator = np.random.default_rng(0)
        for name, sensor in self._configuration.sensors.items():
            line = generator.integers(0, 200, sensor.pixels)
            at_rest = line + generator.integers(0, 5, (5, sensor.pixels))  # slow motion too
            for lines in (at_rest.astype(np.uint8), at_rest.astype(np.uint16)):
                trial.update({name: LineBatch(0, lines)})

    def _read(self, name: str, batch: LineBatch | None) -> SensorReading:
        if batch is None:
            return SensorReading.unmeasured("no lines arrived")
        reading = self._sensors[name].update(batch)
        age = 1e-9 * (self._stamp_ns - batch.stamp_ns)
        if age > self._configuration.maximum_skew:
            return SensorReading.unmeasured(f"stale: {1e3 * age:.3g} ms older than the newest line")
        return reading

    def _estimate(self, readings: dict[str, SensorReading]) -> TwistEstimate:
        measured = tuple(reading.measured for reading in readings.values())
        twist = np.zeros(3)
        covariance = UNMEASURED_VARIANCE * np.eye(3)
        sufficient = not self._solver.problem(measured)
        if sufficient:
            velocity = np.array([reading.velocity for reading in readings.values()])
            variance = np.array([max(r.variance, _MINIMUM_VARIANCE) for r in readings.values()])
            twist, covariance = self._solver.solve(velocity, variance, measured)
            limit = self._configuration.contradiction_limit
            if sum(measured) > _UNKNOWNS and limit > 0.0:
                scores = self._solver.contradictions(
                    velocity, variance, measured, twist, covariance
                )
                worst = int(np.argmax(scores))
                if scores[worst] > limit:
                    return self._resolve(readings, worst, float(scores[worst]), twist, covariance)
        return TwistEstimate(self._stamp_ns, twist, covariance, sufficient, readings)

    def _resolve(
        self,
        readings: dict[str, SensorReading],
        worst: int,
        score: float,
        twist: FloatArray,
        covariance: FloatArray,
    ) -> TwistEstimate:
        """Leave out the sensor that contradicts the others most, where they can tell it.

        Four sensors only see *that* one is wrong: then the variances grow until they explain it.
        """
        name = list(readings)[worst]
        others = tuple(r.measured and other != name for other, r in readings.items())
        if sum(others) > _UNKNOWNS and not self._solver.problem(others):
            left_out = SensorReading.unmeasured(
                f"contradicts the other sensors by {score:.3g} standard deviations",
                readings[name].correlation,
                readings[name].inlier_share,
            )
            return self._estimate(readings | {name: left_out})
        return TwistEstimate(self._stamp_ns, twist, covariance * score**2, True, readings)
