"""Line of motion that the vehicle should keep while it brakes; the line is fixed in the world.

Eq. (51) of the dissertation describes the line by the unit vector ``p`` across it. The velocity at
the start of braking is stored as a direction in the world frame. Only the rotation since the start
of braking matters, so the body axes at that time serve as world axes. The rotation is the integral
of the measured yaw rate, computed by the trapezoidal rule between stamps.
"""

import math
from typing import Any

import numpy as np

from omni_brake_assist.fail_safe import since
from omni_core.kernels import lean
from omni_core.quantities import Pair, Triple

Record = Any
"""Reference to a record of `LINE`."""

LINE = np.dtype(
    [
        ("stored", "?"),  # whether the velocity at the start of braking has been stored
        # Unit vector across the line in the body axes at that time; 0 if there is no line [1].
        ("across_x", "f8"),
        ("across_y", "f8"),
        ("heading", "f8"),  # yaw angle turned since the line was stored [rad]
        ("yaw_rate", "f8"),  # yaw rate of the last twist [rad/s]
        ("stamp_ns", "i8"),  # stamp of the last valid twist, also while there is no line [ns]
    ]
)
"""Data type of the memory; a record of zeros stores no line of motion."""


@lean
def keep_line(
    line: Record,
    stamp_ns: int,
    twist: Triple,
    limits: Pair,
    braking: bool,
    good: bool,
    starts: bool,
) -> tuple[float, bool, Pair]:
    """Store the line of motion, or integrate the heading since it was stored.

    Args:
        line: memory of the line, changed in place; deleted while the driver does not brake.
        stamp_ns: stamp of the twist [ns].
        twist: velocity [m/s, m/s] and yaw rate [rad/s] in the body frame.
        limits: speed below which a velocity has no usable direction [m/s]; limit on the time
            between twists, after which the heading is unknown [s].
        braking: whether the driver brakes.
        good: whether the twist is valid.
        starts: whether a line is stored if there is none.

    Returns:
        Time since the last valid twist [s], or 0 after a gap; whether the line was stored now; unit
        vector ``p`` across the line in the present body frame [1], of zeros if there is no line.
    """
    (v_x, v_y, yaw_rate), (minimum_speed, longest) = twist, limits
    dt = since(stamp_ns, line.stamp_ns) * 1e-9 if good else 0.0
    known = 0.0 <= dt <= longest
    dt = dt if known else 0.0
    if not (known and braking):
        line.stored = False
        line.across_x = line.across_y = 0.0
    stores = good and starts and not line.stored
    if good:
        line.heading += (line.yaw_rate + yaw_rate) / 2 * dt
        line.yaw_rate, line.stamp_ns = yaw_rate, stamp_ns
    if stores:
        line.stored, line.heading = True, 0.0
        speed = math.hypot(v_x, v_y)
        if speed >= minimum_speed:
            line.across_x = -v_y / speed  # Eq. (51)
            line.across_y = v_x / speed
    c, s = math.cos(line.heading), math.sin(line.heading)
    p_x, p_y = line.across_x, line.across_y
    return dt, stores, (c * p_x + s * p_y, c * p_y - s * p_x)
