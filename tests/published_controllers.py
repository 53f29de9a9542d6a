"""Kinematics and odometry of the drive controllers of ros2_controllers, from their documentation.

Written independently of `omni_core.kinematics`; all wheels have the same radius R, and positive
wheel speeds roll forward.

``mecanum_drive_controller`` (6.9): with the velocity (v_x, v_y) of the center of the wheels, the
yaw rate W, and half of wheelbase plus track s, ``R (w_fl, w_fr, w_rr, w_rl)`` is
``(v_x - v_y - s W, v_x + v_y + s W, v_x - v_y + s W, v_x + v_y - s W)``. The base frame is at
`base_frame_offset` (x, y) in the frame of the center, turned by theta.

``omni_wheel_drive_controller`` (6.9): wheel i of n is at ``t_i = offset + 2 pi i / n`` and the
distance L from the center, and ``R w_i = sin(t_i) v_x - cos(t_i) v_y - L W``.
"""

from __future__ import annotations

import math

import numpy as np

from omni_core.quantities import FloatArray

OFFSET = tuple[float, float, float]


def mecanum_speeds(twist: FloatArray, radius: float, lever: float, offset: OFFSET) -> FloatArray:
    """Return the speeds of front left, front right, rear right and rear left [rad/s]."""
    x, y, theta = offset
    v_x, v_y, rate = twist.tolist()
    ahead = math.cos(theta) * v_x - math.sin(theta) * v_y + y * rate
    left = math.sin(theta) * v_x + math.cos(theta) * v_y - x * rate
    speeds = (
        ahead - left - lever * rate,
        ahead + left + lever * rate,
        ahead - left + lever * rate,
        ahead + left - lever * rate,
    )
    return np.array(speeds) / radius


def mecanum_twist(speeds: FloatArray, radius: float, lever: float, offset: OFFSET) -> FloatArray:
    """Return the twist of the base frame from the speeds in the same order."""
    front_left, front_right, rear_right, rear_left = speeds.tolist()
    ahead = 0.25 * radius * (front_left + rear_left + rear_right + front_right)
    left = 0.25 * radius * (-front_left + rear_left - rear_right + front_right)
    rate = 0.25 * radius / lever * (-front_left - rear_left + rear_right + front_right)
    x, y, theta = offset
    ahead, left = ahead - y * rate, left + x * rate
    return np.array(
        (
            math.cos(theta) * ahead + math.sin(theta) * left,
            -math.sin(theta) * ahead + math.cos(theta) * left,
            rate,
        )
    )


def mecanum_pose(pose: FloatArray, twist: FloatArray, period: float) -> FloatArray:
    """Return the pose after a period: first the heading turns, then the position moves."""
    heading = pose[2] + twist[2] * period
    cos, sin = math.cos(heading), math.sin(heading)
    step = (cos * twist[0] - sin * twist[1], sin * twist[0] + cos * twist[1])
    return np.array((pose[0] + step[0] * period, pose[1] + step[1] * period, heading))


def omni_speeds(
    twist: FloatArray, count: int, radius: float, distance: float, offset: float
) -> FloatArray:
    """Return the speeds of the wheels in the order of their angles [rad/s]."""
    return omni_matrix(count, distance, offset) @ twist / radius


def omni_matrix(count: int, distance: float, offset: float) -> FloatArray:
    """Return the matrix from the twist to the rim speeds, shape (count, 3)."""
    angle = offset + 2.0 * math.pi * np.arange(count) / count
    return np.column_stack((np.sin(angle), -np.cos(angle), np.full(count, -distance)))


def omni_twist(speeds: FloatArray, radius: float, distance: float, offset: float) -> FloatArray:
    """Return the twist that fits the speeds best."""
    matrix = omni_matrix(len(speeds), distance, offset)
    return np.asarray(np.linalg.lstsq(matrix, speeds * radius, rcond=None)[0])
