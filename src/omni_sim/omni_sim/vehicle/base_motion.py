"""Pose and twist of `base_link` from the motion of the centre of gravity, Eq. (23)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_sim.vehicle.dynamics import TILT_X, TILT_Y, V_X, V_Y, YAW, YAW_RATE, X, Y
from omni_sim.vehicle.uneven_ground import level

FloatArray = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def base_motion(body: FloatArray, centre_x: float, centre_y: float, motion: FloatArray) -> None:
    """Write pose and twist of base_link.

    Args:
        body: state of the body, see `dynamics`, shape (10,).
        centre_x: centre of gravity in the body frame [m].
        centre_y: likewise in y [m].
        motion: receives x, y [m], yaw [rad, not wrapped] in the world frame, then the velocity in
            the body frame [m/s, m/s, rad/s], shape (6,).
    """
    cos, sin = math.cos(body[YAW]), math.sin(body[YAW])
    v_x, v_y, rate = body[V_X], body[V_Y], body[YAW_RATE]
    d_x, d_y = cos * centre_x - sin * centre_y, sin * centre_x + cos * centre_y
    if body[TILT_X] != 0.0 or body[TILT_Y] != 0.0:
        d_x, d_y = level(body[TILT_X], body[TILT_Y], d_x, d_y)
    motion[0] = body[X] - d_x
    motion[1] = body[Y] - d_y
    motion[2] = body[YAW]
    motion[3] = cos * v_x + sin * v_y + rate * centre_y
    motion[4] = cos * v_y - sin * v_x - rate * centre_x
    motion[5] = rate
