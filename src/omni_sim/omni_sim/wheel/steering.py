"""Steering: angles of conventional wheels that follow the commanded twist at a limited rate.

A steered wheel turns toward the velocity of its center in the commanded twist, Eq. (23), or toward
the opposite direction if this angle is within its limit or nearer, because a wheel rolls forward
and backward. The positions and limits of the wheels therefore determine the kind of steering:
Ackermann steering with fixed wheels on one axle, counter-steering if front and rear wheels are
steered, and a swerve drive if every wheel turns by 90 deg or more.

If a vehicle has steered and fixed conventional wheels, the lateral velocity of the command is
replaced by that with which the fixed wheels do not slip along their axes (least squares). A command
of speed and yaw rate therefore does not depend on the position of `base_link`.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from omni_core.geometry import PlatformGeometry, WheelMount, cross
from omni_core.kernels import lean
from omni_core.quantities import FloatArray, Triple

Structured = NDArray[np.void]

_FIELDS = ("angle", "rate", "target", "speed", "limit", "fastest", "heading", "x", "y", "radius")
STEERING = np.dtype([(name, np.float64) for name in _FIELDS])
"""Steering of a wheel.

    angle     steering angle, counter-clockwise from the wheel's heading [rad]
    rate      rate of the steering angle in the last step [rad/s]
    target    steering angle toward which the wheel turns [rad]
    speed     wheel speed with which the wheel follows the command at this angle [rad/s]
    limit     limit on the steering angle [rad]; 0 if the wheel is not steered
    fastest   limit on its rate [rad/s]
    heading   rolling direction at a steering angle of 0, in the body frame [rad]
    x, y      position of the wheel in the body frame [m]
    radius    rolling radius under the static load [m]
"""

_TURNS = 5  # half turns by which a target may differ from the direction of the velocity


def build_steering(
    wheels: Mapping[str, WheelMount], geometry: PlatformGeometry, radius: FloatArray
) -> tuple[Structured, Triple]:
    """Return the steering of the wheels, and the lateral velocity per unit of the commanded twist.

    Args:
        wheels: wheels of the vehicle.
        geometry: geometry of the wheels at a steering angle of 0.
        radius: rolling radii under the static loads [m], shape (N,).
    """
    steering = np.zeros(len(wheels), STEERING)
    steering["heading"] = np.arctan2(geometry.rolling[:, 1], geometry.rolling[:, 0])
    steering["x"], steering["y"] = geometry.position.T
    steering["radius"] = radius
    for row, mount in enumerate(wheels.values()):
        steering["limit"][row] = math.radians(mount.steering_limit_deg)
        steering["fastest"][row] = math.radians(mount.steering_rate_deg)
    fixed = geometry.conventional & (steering["limit"] == 0.0)
    # Fixed wheels that all point sideways do not determine the lateral velocity.
    if not steering["limit"].any() or not np.any(np.abs(geometry.rolling[fixed, 0]) > 1e-3):
        return steering, (0.0, 1.0, 0.0)
    across = geometry.axis[fixed]
    weight = across[:, 1] / np.sum(across[:, 1] ** 2)
    lever = cross(geometry.position[fixed], across)
    return steering, (-float(weight @ across[:, 0]), 0.0, -float(weight @ lever))


@lean
def steer(
    steering: Structured,
    lateral: Triple,
    contacts: Structured,
    drive: Triple,
    follows: bool,
    dt: float,
) -> Triple:
    """Turn the steered wheels by one step; return the twist that the drives follow.

    Args:
        steering: steering of the wheels, `STEERING`, changed in place, shape (N,).
        lateral: lateral velocity that the drives follow, per unit of the commanded twist
            [1, 1, m].
        contacts: `vehicle.state.CONTACT`, shape (N,); active direction and lever of the steered
            wheels are written.
        drive: commanded twist in the body frame [m/s, m/s, rad/s].
        follows: whether the wheels follow the command; otherwise they keep their targets.
        dt: length of the step [s]; infinite to reach the targets at once.
    """
    v_x, turn = drive[0], drive[2]
    v_y = lateral[0] * drive[0] + lateral[1] * drive[1] + lateral[2] * turn
    for i in range(steering.shape[0]):
        wheel, contact = steering[i], contacts[i]
        if wheel.limit <= 0.0:
            continue
        c_x, c_y = v_x - turn * wheel.y, v_y + turn * wheel.x
        if follows and (c_x != 0.0 or c_y != 0.0):
            wheel.target = nearest_target(
                math.atan2(c_y, c_x) - wheel.heading, wheel.angle, wheel.limit
            )
        before, farthest = wheel.angle, dt * wheel.fastest
        wheel.angle += min(max(wheel.target - wheel.angle, -farthest), farthest)
        wheel.rate = (wheel.angle - before) / dt
        u_x, u_y = math.cos(wheel.heading + wheel.angle), math.sin(wheel.heading + wheel.angle)
        contact.n_x, contact.n_y = -u_x, -u_y
        contact.moment = contact.r_y * u_x - contact.r_x * u_y
        wheel.speed = (c_x * u_x + c_y * u_y) / wheel.radius
    return v_x, v_y, turn


@lean
def driven_speed(steering: Structured, wheel: int, speed: float) -> float:
    """Return the speed that a wheel's drive follows [rad/s]; `speed` is that at an angle of 0."""
    followed: float = steering[wheel].speed if steering[wheel].limit > 0.0 else speed
    return followed


@lean
def nearest_target(direction: float, angle: float, limit: float) -> float:
    """Return the steering angle at which a wheel rolls in a direction or closest to it [rad].

    Of several angles within the limit, the nearest to the present angle is returned.

    Args:
        direction: direction of motion, from the wheel's heading [rad].
        angle: present steering angle [rad].
        limit: limit on the steering angle [rad].
    """
    best, least, nearest = 0.0, math.inf, math.inf
    for k in range(-_TURNS, _TURNS + 1):
        candidate = direction + k * math.pi
        excess, distance = max(abs(candidate) - limit, 0.0), abs(candidate - angle)
        if excess < least or (excess == least and distance < nearest):
            best, least, nearest = candidate, excess, distance
    return min(max(best, -limit), limit)
