"""Line of motion that the vehicle should keep while it brakes; the line is fixed in the world.

Eq. (51) of the dissertation describes the line by the unit vector ``p`` across it. The velocity at
the start of braking is stored as a direction in the world frame. Only the rotation since the start
of braking matters, so the body axes at that time serve as world axes. The rotation is the integral
of the measured yaw rate, computed by the trapezoidal rule between stamps.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_core.kernels import lean

Record = Any
"""Reference to the record in the array that `new_line` returns."""

_LINE = np.dtype(
    [
        ("stored", "?"),  # whether the velocity at the start of braking has been stored
        # Unit vector across the line in the body axes at that time; 0 if there is no line [1].
        ("across_x", "f8"),
        ("across_y", "f8"),
        ("heading", "f8"),  # yaw angle turned since the line was stored [rad]
        ("yaw_rate", "f8"),  # yaw rate of the last twist [rad/s]
    ]
)


def new_line() -> NDArray[np.void]:
    """Return a record in which no line of motion is stored, shape (1,)."""
    return np.zeros(1, _LINE)


@lean
def forget_line(line: Record) -> None:
    """Delete the line, for example when the pedal is released.

    Args:
        line: memory of the line, changed in place.
    """
    line.stored = False
    line.across_x = line.across_y = line.heading = line.yaw_rate = 0.0


@lean
def store_line(line: Record, minimum_speed: float, v_x: float, v_y: float, yaw_rate: float) -> None:
    """Store the line of motion along the given velocity.

    If the speed is below the minimum, the record states that there is no line to keep.

    Args:
        line: memory of the line, changed in place.
        minimum_speed: speed below which a velocity has no usable direction [m/s].
        v_x: body velocity, x [m/s].
        v_y: body velocity, y [m/s].
        yaw_rate: yaw rate [rad/s].
    """
    forget_line(line)
    line.stored = True
    line.yaw_rate = yaw_rate
    speed = math.hypot(v_x, v_y)
    if speed >= minimum_speed:
        line.across_x = -v_y / speed  # Eq. (51)
        line.across_y = v_x / speed


@lean
def advance_line(line: Record, dt: float, yaw_rate: float) -> None:
    """Integrate the heading up to the time of a new twist.

    Args:
        line: memory of the line, changed in place.
        dt: time since the last twist [s].
        yaw_rate: yaw rate of the new twist [rad/s].
    """
    line.heading += (line.yaw_rate + yaw_rate) / 2 * dt
    line.yaw_rate = yaw_rate


@lean
def perpendicular(line: Record) -> tuple[float, float]:
    """Return the unit vector ``p`` across the line of motion in the present body frame [1].

    Both components are zero if there is no line to keep.
    """
    c, s = math.cos(line.heading), math.sin(line.heading)
    p_x, p_y = line.across_x, line.across_y
    return c * p_x + s * p_y, c * p_y - s * p_x
