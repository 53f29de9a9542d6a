"""Positions, axes and fields of view of ground sensors.

A sensor measures the velocity of the point at which it is mounted. A line camera measures the
component along its axis, and a flow sensor also measures the component to the left of its axis. The
footprint of a line camera is a rectangle. Its `length` along the axis is divided into `pixels`.
Each pixel integrates over the `width` of the footprint across the axis (dissertation, section
4.3.2).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from omni_core.configuration import Configuration, parameter
from omni_core.geometry import turned
from omni_core.quantities import LARGEST_OFFSET, FloatArray

OVERLAP = 0.6
"""Minimum share of the field of view that two consecutive lines must have in common [1]
(dissertation, section 4.4)."""

COUNT_DEVIATION = 1.0 / math.sqrt(6.0)
"""Standard deviation of the difference between two counts, each of them rounded down [1]: a rounded
value has the variance 1/12."""


_COMMON_HEADINGS = [math.radians(angle) for angle in (30, 45, 60, 90, 120, 135, 150, 180)]  # rad


class Mount(Configuration):
    """Mounting of a ground sensor in the body frame, with the uncertainty of the calibration."""

    x: float = parameter(unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Center of the footprint, forward of base_link"""
    y: float = parameter(unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Center of the footprint, left of base_link"""
    heading_deg: float = parameter(unit="deg", minimum=-360.0, maximum=360.0)
    """Sensor axis (measuring direction), counter-clockwise from the forward direction"""
    scale_error: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Relative standard error of the scale after calibration (`omni calibrate-sensors`); 0 for an
    exact scale. The scale of a camera is pixel pitch times line rate"""
    heading_error_deg: float = parameter(0.0, unit="deg", minimum=0.0, maximum=90.0)
    """Standard error of the axis direction"""
    lever_error: float = parameter(0.0, unit="m", minimum=0.0, maximum=10.0)
    """Standard error of the distance between base_link and the straight line along the axis"""
    carrier: str = parameter("")
    """Steered wheel with which the sensor turns; empty if the sensor is fixed to the body. Position
    and heading are those at a steering angle of 0"""
    carrier_x: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the steering axis of `carrier`, forward of base_link"""
    carrier_y: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the steering axis of `carrier`, left of base_link"""

    @property
    def heading(self) -> float:
        """Direction of the sensor axis in the body frame [rad]."""
        return math.radians(self.heading_deg)

    @property
    def directions(self) -> tuple[float, ...]:
        """Directions of the measured velocities in the body frame [rad]."""
        return (self.heading,)


M = TypeVar("M", bound=Mount)


class LineSensor(Mount):
    """A line camera, which measures the velocity of its position along its axis."""

    pixels: int = parameter(1024, unit="px", minimum=16, maximum=16384)
    """Number of pixels per line"""
    length: float = parameter(0.05, unit="m", minimum=1e-6, maximum=1.0)
    """Field of view along the axis"""
    width: float = parameter(0.02, unit="m", minimum=1e-6, maximum=1.0)
    """Field of view across the axis"""
    line_rate: float = parameter(2500.0, unit="1/s", above=0.0, maximum=1e6)
    """Line rate"""
    non_uniformity: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Standard deviation of the pixel gains relative to their mean (photo-response non-uniformity,
    PRNU, of EMVA 1288); without a white reference, and until the camera has moved, standstill is
    measured only on ground with a larger relative contrast"""

    @property
    def pixel_pitch(self) -> float:
        """Length of a pixel's footprint along the axis [m]."""
        return self.length / self.pixels

    @property
    def sideways_speed(self) -> float:
        """Speed across the axis at which consecutive lines have the overlap `OVERLAP` [m/s]."""
        return (1.0 - OVERLAP) * self.width * self.line_rate


class FlowSensor(Mount):
    """An optical-flow sensor, which measures the velocity along and to the left of its axis."""

    rate: float = parameter(100.0, unit="1/s", minimum=0.1, maximum=1e5)
    """Measurement rate"""
    deviation: float = parameter(0.02, unit="m/s", above=0.0, maximum=100.0)
    """Standard deviation of each velocity component, used if a measurement has no covariance"""
    maximum_speed: float = parameter(0.0, unit="m/s", minimum=0.0, maximum=1000.0)
    """Largest speed that the sensor can measure; a higher measured speed is rejected. For a sensor
    of angular rates, it is the largest rate times the height above the ground; 0 for no limit"""

    @property
    def directions(self) -> tuple[float, ...]:
        """Directions along the axis and to the left of it in the body frame [rad]."""
        return (self.heading, self.heading + math.pi / 2.0)


def heading_remarks(key: str, mounts: Mapping[str, Mount]) -> tuple[str, ...]:
    """Return a sentence about mounting headings that look like radians; empty if none do.

    Common headings in radians, such as 1.57, are unusual in degrees. Calibrated headings in degrees
    may be as small, but then other headings of the same sensors are larger or not as round.

    Args:
        key: configuration key of the sensors.
        mounts: sensors, keyed by name.
    """
    headings = {name: abs(mount.heading_deg) for name, mount in mounts.items() if mount.heading_deg}
    if not headings or not all(map(_rounded_radians, headings.values())):
        return ()
    name = next(iter(headings))
    heading = mounts[name].heading_deg
    return (
        f"{key}.{name}.heading_deg: {heading:g} deg looks like radians; "
        f"enter {math.degrees(heading):.0f} if this is the direction of the sensor axis",
    )


def _rounded_radians(angle: float) -> bool:
    """Return whether an angle is a multiple of 30 or 45 deg in radians with two decimals."""
    return any(abs(angle - common) <= 0.5e-2 for common in _COMMON_HEADINGS)


def rotation_matrix(angles_deg: Sequence[float]) -> FloatArray:
    """Return the matrix from the axes of a mounted sensor to those of base_link, shape (3, 3).

    Args:
        angles_deg: roll, pitch and yaw, rotations about the fixed axes x, y and z in this order, as
            `rpy` of a joint in a URDF, but in [deg]; empty for equal axes.
    """
    roll, pitch, yaw = np.radians(angles_deg if len(angles_deg) else np.zeros(3))
    (a, b, c), (d, e, f) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, a, -d], [0.0, d, a]])
    about_y = np.array([[b, 0.0, e], [0.0, 1.0, 0.0], [-e, 0.0, b]])
    about_z = np.array([[c, -f, 0.0], [f, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(about_z @ about_y @ about_x)


def turned_mount(sensor: M, angle: float) -> M:
    """Return the mounting of a sensor whose carrier has turned by a steering angle [rad]."""
    axis = np.array([sensor.carrier_x, sensor.carrier_y])
    x, y = axis + turned(np.array([sensor.x, sensor.y]) - axis, angle)
    heading = math.degrees(math.remainder(sensor.heading + angle, math.tau))
    return dataclasses.replace(sensor, x=float(x), y=float(y), heading_deg=heading)


def carried_velocity(sensor: Mount, rate: float) -> list[float]:
    """Return the velocities that a steering rate causes along the directions of a sensor [m/s].

    Args:
        sensor: sensor at the present steering angle.
        rate: rate of the steering angle [rad/s].
    """
    x, y = sensor.x - sensor.carrier_x, sensor.y - sensor.carrier_y
    return [rate * velocity_row(x, y, direction)[2] for direction in sensor.directions]


def sensor_matrix(sensors: Mapping[str, Mount]) -> FloatArray:
    """Return the linear map from body twist to the velocities that sensors measure.

    Each row is the `velocity_row` of a sensor for one of its `directions`.

    Args:
        sensors: sensors, keyed by name.

    Returns:
        Matrix with columns in [1], [1] and [m], shape (R, 3). The rows are in the order of the
        sensors: one for a line camera, two for a flow sensor.
    """
    rows = [
        velocity_row(sensor.x, sensor.y, direction)
        for sensor in sensors.values()
        for direction in sensor.directions
    ]
    return np.array(rows, dtype=np.float64).reshape(len(rows), 3)


def velocity_row(x: float, y: float, direction: float) -> tuple[float, float, float]:
    """Return the row that maps the body twist to a point's velocity along a direction, Eq. (23).

    Args:
        x: coordinate x of the point, forward of base_link [m].
        y: coordinate y of the point, left of base_link [m].
        direction: direction ``d``, counter-clockwise from forward [rad].

    Returns:
        ``(cos d, sin d, cross(r, a))`` [1, 1, m] with the point ``r = (x, y)`` and the unit vector
        ``a = (cos d, sin d)``.
    """
    a_x, a_y = math.cos(direction), math.sin(direction)
    return a_x, a_y, x * a_y - y * a_x
