"""Sideslip angle of a wheel from a line camera next to it (dissertation, section 4.6).

The camera is aligned with the wheel's axis of rotation and measures the wheel's sideways velocity
v_s, positive to the left. With the wheel's velocity v_f along its rolling direction, the angle is

    alpha = -arctan(v_s / |v_f|).

The angle is positive if the wheel slides to the right. The lateral force of the tire, which opposes
the sliding, then points to the left, so angle and force have the same sign. With the absolute value
this is also true for a wheel that rolls backward.

The dissertation writes ``-arctan(v_par / |v_b|)`` and calls v_par the forward and v_b the sideways
velocity. Taken literally, a wheel that rolls straight ahead would have an angle of 90 deg. The
dissertation evidently exchanges the two names: v_par is the velocity that a camera parallel to the
axis of rotation measures, which is the sideways velocity.

v_f must be the velocity of the wheel's center over the ground. The rim speed omega R (wheel speed
times radius) equals v_f only without longitudinal slip. On a braked wheel omega R is smaller, so
the angle would be too large.

If the camera is not at the wheel's center, or not exactly parallel to the wheel's axis of rotation,
the camera also measures a part of the yaw rate and of v_f. Both parts are removed:

    v_s sin d = u - Omega cross(r_s - r_w, a) - v_f cos d,

where u is the velocity along the camera's axis a, d the angle of this axis from the rolling
direction, Omega the yaw rate, and r_s and r_w are the positions of camera and wheel.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration, SideslipWheel
from linescan_odometry.measurements import SensorReading, TwistEstimate
from linescan_odometry.sensor import SensorOdometry
from omni_core.configuration import ConfigurationError, check_choice
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor, velocity_row
from omni_core.signals import LineBatch


@dataclasses.dataclass(frozen=True)
class SideslipEstimate:
    """Sideslip of a wheel, estimated from one batch of lines.

    Attributes:
        angle: sideslip angle [rad], positive if the wheel slides to the right; 0 if not measured.
        deviation: standard deviation of the angle [rad], infinite if not measured.
        sideways: velocity of the wheel to its left [m/s], 0 if not measured.
        measured: whether these values are valid.
        reason: reason why these values are invalid; empty for valid values.
    """

    angle: float
    deviation: float
    sideways: float
    measured: bool
    reason: str = ""

    @classmethod
    def unmeasured(cls, reason: str) -> SideslipEstimate:
        """Return an estimate that is marked as unmeasured, with the reason."""
        return cls(0.0, math.inf, 0.0, False, reason)


def sideslip_angle(sideways: float, forward: float) -> float:
    """Return the sideslip angle ``-arctan(v_s / |v_f|)`` [rad].

    Args:
        sideways: velocity of the wheel to its left [m/s].
        forward: velocity of the wheel along its rolling direction [m/s], not 0.
    """
    return -math.atan(sideways / abs(forward))


class WheelSideslip:
    """Measures the sideslip angle of one wheel with one camera next to this wheel."""

    def __init__(self, wheel: SideslipWheel, sensor: LineSensor) -> None:
        """Compute the constants of the measurement.

        These are the angle of the camera's axis from the rolling direction of the wheel, and the
        lever arm of this axis about the wheel's center. The camera measures the yaw rate times this
        lever arm.

        Raises:
            ConfigurationError: the camera's axis is more than 30 deg from the axis of rotation.
        """
        wheel.check_axis(sensor)
        self._wheel = wheel
        direction = math.radians(wheel.steering_deg)
        self._along = math.cos(sensor.heading - direction)
        self._across = math.sin(sensor.heading - direction)
        x, y, heading = sensor.x, sensor.y, sensor.heading
        self._lever = velocity_row(x - wheel.x, y - wheel.y, heading)[2]
        self._sensor_row = np.array(velocity_row(x, y, heading))
        self._forward_row = np.array(velocity_row(wheel.x, wheel.y, direction))

    def measure(
        self, reading: SensorReading, forward: float, yaw_rate: float, covariance: FloatArray
    ) -> SideslipEstimate:
        """Return the sideslip from the camera's reading and the motion of the wheel.

        Args:
            reading: reading of the camera.
            forward: velocity of the wheel's center along its rolling direction [m/s].
            yaw_rate: yaw rate of the body to which camera and wheel are fixed [rad/s].
            covariance: covariance of (velocity along the camera's axis, forward, yaw rate), in the
                squares of their units, shape (3, 3).
        """
        if not reading.measured:
            return SideslipEstimate.unmeasured(reading.reason)
        if not (math.isfinite(forward) and math.isfinite(yaw_rate)):
            return SideslipEstimate.unmeasured(
                f"forward velocity {forward:g} m/s and yaw rate {yaw_rate:g} rad/s must be finite"
            )
        speed = abs(forward)
        if speed < self._wheel.minimum_speed:
            return SideslipEstimate.unmeasured(
                f"the wheel rolls at {speed:.3g} m/s; below {self._wheel.minimum_speed:g} m/s the "
                "angle is undefined"
            )
        if reading.slope > 0.0:  # the slope of the texture would be an error of the angle
            return SideslipEstimate.unmeasured("uncertain: the texture may be oblique")
        seen = reading.velocity - yaw_rate * self._lever
        sideways = (seen - forward * self._along) / self._across
        # Gradient of v_s / |v_f| with respect to (u, v_f, Omega); derivative of the angle by v_s /
        # |v_f|.
        gradient = np.array(
            [
                1.0 / (self._across * speed),
                -self._along / (self._across * speed) - sideways / (forward * speed),
                -self._lever / (self._across * speed),
            ]
        )
        slope = 1.0 / (1.0 + (sideways / speed) ** 2)
        variance = slope**2 * max(float(gradient @ covariance @ gradient), 0.0)
        angle = sideslip_angle(sideways, forward)
        return SideslipEstimate(angle, math.sqrt(variance), sideways, True)

    def measure_with(self, estimate: TwistEstimate) -> SideslipEstimate:
        """Return the sideslip angle for a twist that was estimated with this camera.

        Args:
            estimate: twist of the platform, including the reading of this camera.
        """
        reading = estimate.readings[self._wheel.sensor]
        if not estimate.measured:
            return SideslipEstimate.unmeasured("the twist is not measured")
        # The twist contains the camera's error too. For least squares, the covariance of the twist
        # and this error is C a, with the twist's covariance C and the camera's row a. If sensors
        # contradict each other, C is inflated, and the camera's variance must be inflated equally.
        joint = np.empty((4, 4))
        joint[0, 0] = estimate.inflation * reading.variance
        joint[1:, 1:] = estimate.covariance
        joint[0, 1:] = joint[1:, 0] = estimate.covariance @ self._sensor_row
        rows = np.zeros((3, 4))
        rows[0, 0] = 1.0
        rows[1, 1:] = self._forward_row
        rows[2, 3] = 1.0
        forward = float(self._forward_row @ estimate.twist)
        return self.measure(reading, forward, float(estimate.twist[2]), rows @ joint @ rows.T)


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


def angles(wheels: Mapping[str, SideslipEstimate]) -> FloatArray:
    """Return the sideslip angles of N wheels [rad], NaN where not measured, shape (N,)."""
    return np.array([w.angle if w.measured else math.nan for w in wheels.values()], dtype=float)
