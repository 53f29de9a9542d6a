"""Disturbance observer of the body: mass, and accelerations that the friction does not explain.

Three loops form a cascade, from the inside: the friction observer, the observer of disturbances,
and the estimate of the mass with the return of the heading (`braking_qp`). Each is half as fast as
the loop inside it.
"""

import math

from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.law import Motion
from omni_platform.kernels import lean

CASCADE = 2.0
"""Ratio of the time constants of a loop and of the one inside it [1]."""

_MASS_RANGE = 5.0  # largest factor between estimated and nominal mass [1]


@lean
def observe_body(law: Constants, memory: Memory, motion: Motion, dt: float) -> None:
    """Update heading, mass and disturbances by the motion of the last period."""
    body = memory.body[0]
    f_x, f_y, moment = 0.0, 0.0, 0.0
    for i in range(law.rim.size):
        force = -memory.wheel[i].sign * memory.wheel[i].force
        f_x += force * law.n_x[i]
        f_y += force * law.n_y[i]
        moment += force * law.lever[i]
    body.heading += 0.5 * (body.yaw_rate + motion.yaw_rate) * dt
    share = 1.0 - math.exp(-dt / law.observer_time)
    a_x = (motion.v_x - body.v_x) / dt - motion.yaw_rate * motion.v_y
    a_y = (motion.v_y - body.v_y) / dt + motion.yaw_rate * motion.v_x
    body.a_x += share * (a_x - body.a_x)
    body.a_y += share * (a_y - body.a_y)
    yaw_acceleration = (motion.yaw_rate - body.yaw_rate) / dt
    body.yaw_acceleration += share * (yaw_acceleration - body.yaw_acceleration)
    share = 1.0 - math.exp(-dt / (CASCADE**2 * law.observer_time))
    body.deceleration += share * (math.hypot(body.a_x, body.a_y) - body.deceleration)
    body.force += share * (math.hypot(f_x, f_y) - body.force)
    mass = body.force / body.deceleration
    body.mass = mass = min(max(mass, law.mass / _MASS_RANGE), law.mass * _MASS_RANGE)
    share = 1.0 - math.exp(-dt / (CASCADE * law.observer_time))
    turned = body.yaw_acceleration - moment / (mass * law.gyration)
    body.yaw_disturbance += share * (turned - body.yaw_disturbance)
    pushed = (body.a_x - f_x / mass) * motion.across_x + (body.a_y - f_y / mass) * motion.across_y
    body.lateral_disturbance += share * (pushed - body.lateral_disturbance)
