"""The line of motion that the vehicle should keep, fixed in the world: ``p`` of Eq. (51).

The velocity at the start of braking is stored as a direction in the world frame. Only rotation
since then matters, so the body axes of that moment serve as world axes; the heading since then is
the yaw rate of the feedback, integrated by the trapezoidal rule over its stamps.
"""

from __future__ import annotations

import math

from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

# Entries of the line: whether the start of braking has been seen; whether it had a direction, and
# the unit vector across it in the body axes of that moment [1]; the yaw angle turned since [rad];
# the yaw rate of the last sample [rad/s].
STORED, DIRECTED, ACROSS_X, ACROSS_Y, HEADING, YAW_RATE = range(6)
LINE_SIZE = 6


@lean
def forget_line(line: FloatArray) -> None:
    """Drop the line, as when the pedal is released.

    Args:
        line: shape (6,), changed in place.
    """
    line[:] = 0.0


@lean
def store_line(
    line: FloatArray, minimum_speed: float, v_x: float, v_y: float, yaw_rate: float
) -> None:
    """Take a velocity as ``v_c0``; too slow a one has no direction to keep.

    Args:
        line: shape (6,), changed in place.
        minimum_speed: speed below which a velocity has no usable direction [m/s].
        v_x: body velocity [m/s].
        v_y: likewise in y [m/s].
        yaw_rate: [rad/s].
    """
    line[:] = 0.0
    line[STORED] = 1.0
    line[YAW_RATE] = yaw_rate
    speed = math.hypot(v_x, v_y)
    if speed >= minimum_speed:
        line[DIRECTED] = 1.0
        line[ACROSS_X] = -v_y / speed  # Eq. (51)
        line[ACROSS_Y] = v_x / speed


@lean
def advance_line(line: FloatArray, dt: float, yaw_rate: float) -> None:
    """Carry the heading on to a new sample.

    Args:
        line: shape (6,), changed in place.
        dt: time since the last sample [s].
        yaw_rate: of the new one [rad/s].
    """
    line[HEADING] += (line[YAW_RATE] + yaw_rate) / 2 * dt
    line[YAW_RATE] = yaw_rate


@lean
def perpendicular(line: FloatArray) -> tuple[float, float]:
    """Return ``p`` in the body frame of the last sample [1]; zeros without a direction to keep.

    Args:
        line: shape (6,).
    """
    c, s = math.cos(line[HEADING]), math.sin(line[HEADING])
    p_x, p_y = line[ACROSS_X], line[ACROSS_Y]
    return c * p_x + s * p_y, c * p_y - s * p_x
