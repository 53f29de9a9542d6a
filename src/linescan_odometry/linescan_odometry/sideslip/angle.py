"""Sideslip angle of a wheel from a line camera next to it (section 4.6).

The camera looks along the wheel's axis of rotation and measures the wheel's sideways velocity v_s,
to the left positive. With its velocity v_f along its rolling direction the angle is

    alpha = -arctan(v_s / |v_f|).

It is positive where the wheel slides to the right, and the lateral force of the tire, which opposes
the slide, then points to the left, so that angle and force have the same sign. The absolute value
makes this hold for a wheel that rolls backwards too.

The dissertation writes ``-arctan(v_par / |v_b|)`` and calls v_par the forward and v_b the sideways
velocity. Read literally, a wheel that rolls straight ahead would have an angle of 90 deg. The names
are exchanged: a camera parallel to the axis of rotation measures v_par, the sideways velocity.

v_f must be the velocity of the wheel's center over ground. It equals omega R only without
longitudinal slip: on a braked wheel omega R is smaller, and the angle would be too large.

A camera that is not at the wheel's center, or not exactly parallel to its axis, also measures parts
of the yaw rate and of v_f. Both are removed: ``v_s sin d = u - Omega cross(r_s - r_w, a) - v_f cos
d`` for the velocity u along the camera's axis a at the angle d from the rolling direction.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from linescan_odometry.measurements import SensorReading, TwistEstimate
from omni_platform.configuration import Configuration, ConfigurationError, parameter
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor, velocity_row

_SKEWEST = 30.0  # [deg] largest angle between camera and axis of rotation
_ROUNDING = 1e-6  # [deg] by which sine and arcsine may increase this angle


class SideslipWheel(Configuration):
    """A wheel whose sideslip angle is measured."""

    sensor: str = parameter()
    """Line camera next to the wheel, parallel to its axis of rotation within 30 deg"""
    x: float = parameter(unit="m")
    """Wheel contact, forward of base_link"""
    y: float = parameter(unit="m")
    """Wheel contact, left of base_link"""
    steering_deg: float = parameter(0.0, unit="deg", minimum=-180.0, maximum=180.0)
    """Rolling direction, counter-clockwise from forward"""
    minimum_speed: float = parameter(0.5, unit="m/s", above=0.0, maximum=100.0)
    """Forward velocity of the wheel below which the angle has no meaning"""


@dataclasses.dataclass(frozen=True)
class SideslipEstimate:
    """Estimate of a wheel's sideslip.

    Attributes:
        angle: sideslip, positive where the wheel slides to the right [rad], 0 if not measured.
        deviation: standard deviation of the angle [rad], infinite if not measured.
        sideways: velocity of the wheel to its left [m/s], 0 if not measured.
        measured: whether these values can be used.
        reason: why they cannot be used; empty if they can.
    """

    angle: float
    deviation: float
    sideways: float
    measured: bool
    reason: str = ""

    @classmethod
    def unmeasured(cls, reason: str) -> SideslipEstimate:
        """Make an unmeasured estimate with the reason."""
        return cls(0.0, math.inf, 0.0, False, reason)


def sideslip_angle(sideways: float, forward: float) -> float:
    """Return the sideslip angle ``-arctan(v_s / |v_f|)`` [rad].

    Args:
        sideways: velocity of the wheel to its left [m/s].
        forward: velocity of the wheel along its rolling direction [m/s], not 0.
    """
    return -math.atan(sideways / abs(forward))


class WheelSideslip:
    """The geometry of one camera at one wheel."""

    def __init__(self, wheel: SideslipWheel, sensor: LineSensor) -> None:
        """Compute the geometry of the camera and the wheel.

        Raises:
            ConfigurationError: the camera's axis is more than 30 deg from the axis of rotation.
        """
        check_axis(wheel, sensor)
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
        """Return the angle from the camera's velocity and the motion across its axis.

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
                f"the wheel rolls at {speed:.3g} m/s, below {self._wheel.minimum_speed:g} m/s its "
                "angle has no meaning"
            )
        seen = reading.velocity - yaw_rate * self._lever
        sideways = (seen - forward * self._along) / self._across
        # Gradient of v_s / |v_f| by (u, v_f, Omega), and slope of the angle by v_s / |v_f|.
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
        """Return the angle from a twist that was estimated with this camera.

        Args:
            estimate: twist of the platform, with the reading of this camera.
        """
        reading = estimate.readings[self._wheel.sensor]
        if not estimate.measured:
            return SideslipEstimate.unmeasured("the twist is not measured")
        # An error of the camera is in the twist as well: by least squares, both have the covariance
        # C a. If the sensors contradict each other, C is inflated, and so must be the variance of
        # the camera.
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


def check_axis(wheel: SideslipWheel, sensor: LineSensor) -> None:
    """Refuse a camera whose axis is not along the wheel's axis of rotation.

    Raises:
        ConfigurationError: the angle between the two is too large.
    """
    along = math.cos(sensor.heading - math.radians(wheel.steering_deg))
    skew = math.degrees(math.asin(min(1.0, abs(along))))
    if skew > _SKEWEST + _ROUNDING:
        raise ConfigurationError(
            "sensor",
            f"{wheel.sensor} looks {skew:.1f} deg away from the wheel's axis of rotation, must be "
            f"parallel to it within {_SKEWEST:g} deg",
        )
