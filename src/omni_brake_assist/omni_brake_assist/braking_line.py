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

from omni_brake_assist.fail_safe import since
from omni_core.kernels import lean
from omni_core.quantities import Triple

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
        ("stamp_ns", "i8"),  # stamp of the last twist, also while there is no line [ns]
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
def follow_line(
    line: Record,
    stamp_ns: int,
    twist: Triple,
    starts: bool,
    minimum_speed: float,
    longest: float,
) -> tuple[float, bool]:
    """Integrate the heading up to the time of a new twist, or store the line along its velocity.

    If the speed is below the minimum, the record states that there is no line to keep.

    Args:
        line: memory of the line, changed in place.
        stamp_ns: stamp of the twist [ns].
        twist: velocity [m/s, m/s] and yaw rate [rad/s] in the body frame.
        starts: whether a line is stored if there is none.
        minimum_speed: speed below which a velocity has no usable direction [m/s].
        longest: limit on the time between twists; the heading is unknown after a longer gap [s].

    Returns:
        Time since the last twist [s], or 0 after a gap; whether the line was stored now.
    """
    v_x, v_y, yaw_rate = twist
    dt = since(stamp_ns, line.stamp_ns) * 1e-9
    line.stamp_ns = stamp_ns
    if not 0.0 <= dt <= longest:
        forget_line(line)
        dt = 0.0
    stores = starts and not line.stored
    if line.stored:
        line.heading += (line.yaw_rate + yaw_rate) / 2 * dt
        line.yaw_rate = yaw_rate
    elif stores:
        line.stored = True
        line.yaw_rate = yaw_rate
        speed = math.hypot(v_x, v_y)
        if speed >= minimum_speed:
            line.across_x = -v_y / speed  # Eq. (51)
            line.across_y = v_x / speed
    return dt, stores


@lean
def perpendicular(line: Record) -> tuple[float, float]:
    """Return the unit vector ``p`` across the line of motion in the present body frame [1].

    Both components are zero if there is no line to keep.
    """
    c, s = math.cos(line.heading), math.sin(line.heading)
    p_x, p_y = line.across_x, line.across_y
    return c * p_x + s * p_y, c * p_y - s * p_x
