"""Control allocation: friction forces for the shortest stop that keeps heading and line of motion.

In each step, the law estimates the friction force ``f_i`` and the friction capacity ``c_i`` of each
wheel. It then estimates the mass of the vehicle, and the accelerations that these forces do not
explain (`observers`). It solves the optimization problem (`braking_qp`)

``min (1 - b_0 x)^2 + W (|b_1 x - g_1| + |b_2 x - g_2|)``
subject to ``0 <= x <= 1``

for the forces ``f = c x``, with the weight ``W`` of heading and line of motion; ``c`` is at most
the brake force with the present pedal. The solution has the largest deceleration ``b_0 x`` for
which the yaw moment ``b_1 x`` and the side force ``b_2 x`` equal the demands ``g_1`` and ``g_2``
that keep heading and line of motion. Finally the law converts the forces to brake forces or to a
pattern of on-off valves (`slip_control`). Mass, loads and tire properties need not be known.
docs/allocation.md derives the equations.
"""

import math

import numpy as np

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws.allocation_state import BODY, WHEEL, Constants, Memory
from omni_brake_assist.laws.brake_observer import MASS, observe_brakes
from omni_brake_assist.laws.braking_qp import allocate, new_qp
from omni_brake_assist.laws.law import ASSIST, NO_HELP, Motion
from omni_brake_assist.laws.observers import LONGEST_DEAD_TIME, observe
from omni_brake_assist.laws.slip_control import control_slip
from omni_brake_assist.laws.wheel_model import NominalBrake
from omni_core.geometry import PlatformGeometry
from omni_core.kernels import lean
from omni_core.quantities import GRAVITY, FloatArray


def make_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> Constants:
    """Return the constants of the law for a configuration and wheel geometry."""
    brake, rim = configuration.brake, geometry.rim
    longest = max(brake.dead_time, LONGEST_DEAD_TIME)
    return Constants(
        active=np.column_stack((geometry.active, geometry.lever)),
        rim=rim,
        wheel_mass=configuration.wheel_inertia / rim**2,
        most=brake.max_torque / np.abs(rim),
        gyration=math.sqrt(np.mean(geometry.position**2)),
        mass=configuration.nominal_mass,
        max_rotation=math.radians(configuration.max_rotation),
        period=configuration.control_period,
        commands=math.ceil(longest / configuration.control_period) + 3,
        brake=NominalBrake(brake.dead_time, brake.time_constant, brake.pressure_step),
        follows=brake.is_ramped,
        imu_x=configuration.imu_x,
        imu_y=configuration.imu_y,
        **vars(configuration.allocation)
        | {"target_slip": configuration.allocation.target_slip * geometry.radius / np.abs(rim)},
    )


def new_memory(law: Constants) -> Memory:
    """Return the initial state of the law."""
    wheels = law.rim.size
    sent, forces = np.zeros((law.commands, wheels)), np.zeros((2, wheels))
    return Memory(np.zeros(1, BODY), np.zeros(wheels, WHEEL), sent, new_qp(wheels), forces)


@lean
def step(
    law: Constants, memory: Memory, motion: Motion, error: FloatArray, enable: FloatArray
) -> int:
    """Compute the enables of one step; arguments and result are those of `Law.step`.

    The error of a wheel is the speed of its hub minus the hub speed at which the wheel, with its
    present rim speed, would have the target slip [m/s].
    """
    body, wheel = memory.body[0], memory.wheel
    body.dt = motion.dt if motion.dt > 0.0 else law.period
    if motion.first:  # assume the nominal mass, equal wheel loads and a friction coefficient of 1
        body.steps, body.responded, body.dead_time = 0, False, law.brake.dead_time
        body.heading = body.yaw_disturbance = body.lateral_disturbance = 0.0
        body.mass = law.mass
        body.inverse_mass, body.inverse_variance = 1.0 / law.mass, (MASS / law.mass) ** 2
        memory.sent[:] = memory.qp.solution[:] = wheel["brake"][:] = wheel["force"][:] = 0.0
        wheel["idle"][:] = wheel["lost"][:] = wheel["late_brake"][:] = body.contradiction[:] = 0.0
        body.pushed = body.span = 0.0
        wheel["capacity"][:] = law.mass * GRAVITY / wheel.size
    enough = observe(law, memory, motion, error) and motion.pedal > 0.0
    if not enough or (body.steps > 0 and observe_brakes(law, memory, motion)):
        return NO_HELP
    allocate(law, memory, motion)
    control_slip(law, memory, motion, enable)
    for i in range(enable.size):  # the upper bound of a share is 0 for a failed brake, otherwise 1
        memory.sent[body.steps % law.commands, i] = enable[i] * motion.pedal * memory.qp.upper[i]
    body.twist[0], body.twist[1], body.twist[2] = motion.v_x, motion.v_y, motion.yaw_rate
    body.steps += 1
    return ASSIST
