"""Sideslip angles of wheels, from a camera and either the wheel's speed or the platform's twist."""

import math
from collections.abc import Mapping

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import TwistEstimate
from linescan_odometry.sensor import SensorOdometry
from linescan_odometry.sideslip.angle import SideslipEstimate, WheelSideslip
from omni_platform.configuration import ConfigurationError, check_choice
from omni_platform.quantities import FloatArray
from omni_platform.signals import LineBatch


class SideslipConfiguration(OdometryConfiguration):
    """Odometry parameters for cameras that measure only sideslip; a single camera suffices."""

    def check_placement(self) -> None:
        """Check that the configuration contains a wheel.

        Raises:
            ConfigurationError: the configuration has no wheel.
        """
        if not self.sideslip:
            raise ConfigurationError("sideslip", "must name a wheel")


class SideslipMeter:
    """Measures the sideslip of one wheel with one camera and the wheel's forward velocity.

    A camera on the carrier of a steered wheel turns with the wheel. In this case, enter the
    positions of camera and wheel for any fixed steering angle. As the yaw rate, pass the rotation
    rate of the carrier, which is the sum of yaw rate and steering rate.
    """

    def __init__(self, configuration: OdometryConfiguration, wheel: str) -> None:
        """Create the meter for one wheel of `configuration.sideslip`.

        Raises:
            ConfigurationError: the wheel is not in `configuration.sideslip`.
        """
        check_choice("sideslip", wheel, configuration.sideslip)
        settings = configuration.sideslip[wheel]
        sensor = configuration.sensors[settings.sensor]
        self._camera = SensorOdometry(sensor, configuration)
        self._geometry = WheelSideslip(settings, sensor)

    def update(
        self,
        batch: LineBatch,
        forward_velocity: float,
        yaw_rate: float = 0.0,
        *,
        forward_deviation: float = 0.0,
        yaw_rate_deviation: float = 0.0,
    ) -> SideslipEstimate:
        """Process a batch of lines, and return the sideslip of the wheel.

        Args:
            batch: lines of the camera since the last update.
            forward_velocity: mean velocity of the wheel's center along its rolling direction during
                the batch [m/s]; wheel speed times radius if there is no longitudinal slip.
            yaw_rate: yaw rate [rad/s]; required if the camera is not at the wheel's center.
            forward_deviation: standard deviation of the forward velocity [m/s].
            yaw_rate_deviation: standard deviation of the yaw rate [rad/s].
        """
        reading = self._camera.update(batch)
        covariance = np.diag((reading.variance, forward_deviation**2, yaw_rate_deviation**2))
        return self._geometry.measure(reading, forward_velocity, yaw_rate, covariance)


class SideslipMonitor:
    """Measures the sideslip of all configured wheels with the cameras and twist of the odometry."""

    def __init__(self, configuration: OdometryConfiguration) -> None:
        """Compute the geometry of the wheels of `configuration.sideslip`."""
        self._wheels = {
            name: WheelSideslip(wheel, configuration.sensors[wheel.sensor])
            for name, wheel in configuration.sideslip.items()
        }

    def measure(self, estimate: TwistEstimate) -> dict[str, SideslipEstimate]:
        """Return the sideslip of each wheel for a twist estimate, keyed by wheel name."""
        return {name: wheel.measure_with(estimate) for name, wheel in self._wheels.items()}


def angles(wheels: Mapping[str, SideslipEstimate]) -> FloatArray:
    """Return the sideslip angles of N wheels [rad], NaN where not measured, shape (N,)."""
    return np.array([w.angle if w.measured else math.nan for w in wheels.values()], dtype=float)
