"""Disturbance observer: the vehicle's mass, and the accelerations that friction does not explain.

Three loops form a cascade. From the inside out, these are the friction observer, the disturbance
observer, and the mass estimate together with the return of the heading (`braking_qp`). Each loop is
half as fast as the next inner one.
"""

import math

from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.law import Motion
from omni_platform.kernels import lean

CASCADE = 2.0
"""Ratio of the time constant of a loop to that of the next inner loop [1]."""


@lean
def observe_body(law: Constants, memory: Memory, motion: Motion, dt: float) -> None:
    """Update heading, mass and disturbances with the motion over the last period."""
    body = memory.body[0]
    f_x = f_y = moment = 0.0
    for i in range(law.rim.size):
        force = -memory.wheel[i].sign * memory.wheel[i].measured
        f_x += force * law.n_x[i]
        f_y += force * law.n_y[i]
        moment += force * law.lever[i]
    body.heading += 0.5 * (body.yaw_rate + motion.yaw_rate) * dt
    a_x = (motion.v_x - body.v_x) / dt - motion.yaw_rate * motion.v_y
    a_y = (motion.v_y - body.v_y) / dt + motion.yaw_rate * motion.v_x
    share = 1.0 - math.exp(-dt / (CASCADE**2 * law.observer_time))
    body.deceleration += share * (math.hypot(a_x, a_y) - body.deceleration)
    body.force += share * (math.hypot(f_x, f_y) - body.force)
    body.mass = mass = body.force / body.deceleration
    share = 1.0 - math.exp(-dt / (CASCADE * law.observer_time))
    turned = (motion.yaw_rate - body.yaw_rate) / dt - moment / (mass * law.gyration)
    body.yaw_disturbance += share * (turned - body.yaw_disturbance)
    pushed = (a_x - f_x / mass) * motion.across_x + (a_y - f_y / mass) * motion.across_y
    body.lateral_disturbance += share * (pushed - body.lateral_disturbance)
