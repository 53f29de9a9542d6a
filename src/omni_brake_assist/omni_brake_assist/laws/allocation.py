"""Control allocation: the friction forces that stop the vehicle shortest on its heading and line.

Each step estimates the friction force and capacity of each wheel (`friction_observer`), then the
mass and the accelerations that these forces do not explain (`disturbance_observer`). It solves the
braking QP for the forces (`braking_qp`) and converts them to brake torques or to a pattern of
on-off valves (`slip_control`). Neither mass, load nor tire is known. docs/allocation.md derives all
of this.
"""

import dataclasses
import math

import numpy as np

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws.allocation_state import BODY, WHEEL, Constants, Memory
from omni_brake_assist.laws.braking_qp import allocate, new_qp
from omni_brake_assist.laws.disturbance_observer import CASCADE, observe_body
from omni_brake_assist.laws.friction_observer import estimate_dead_time, observe_friction
from omni_brake_assist.laws.law import ASSIST, NO_HELP, Motion
from omni_brake_assist.laws.slip_control import LEAST_ENABLE, control_slip, remember_torque
from omni_brake_assist.laws.wheel_model import QUEUE, NominalBrake
from omni_platform.geometry import PlatformGeometry, cross
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_GRAVITY = 9.81  # [m/s^2]
_PERIOD = 0.01  # control period assumed at the first step [s]


def make_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> Constants:
    """Return a configuration in the layout of the kernel."""
    n_x, n_y = np.ascontiguousarray(geometry.active.T)
    brake = configuration.brake
    rolling = np.sum(geometry.active * geometry.rolling, axis=1)
    return Constants(
        n_x=n_x,
        n_y=n_y,
        lever=cross(geometry.position, geometry.active),
        rim=geometry.radius * np.abs(rolling),
        sense=np.sign(rolling),
        radius=geometry.radius.copy(),
        gyration=0.5 * float(np.mean(np.sum(geometry.position**2, axis=1))),
        inertia=configuration.wheel_inertia,
        mass=configuration.nominal_mass,
        max_rotation=math.radians(configuration.max_rotation),
        brake=NominalBrake(
            brake.max_torque, brake.dead_time, brake.time_constant, brake.pressure_step
        ),
        **dataclasses.asdict(configuration.allocation),
    )


def new_memory(wheels: int) -> Memory:
    """Return the initial memory of the law."""
    return Memory(
        body=np.zeros(1, BODY),
        wheel=np.zeros(wheels, WHEEL),
        sent=np.zeros((QUEUE, wheels)),
        qp=new_qp(wheels),
        forces=np.zeros((2, wheels)),
        deep=np.zeros((2, wheels)),
    )


@lean
def step(
    law: Constants, memory: Memory, motion: Motion, error: FloatArray, enable: FloatArray
) -> int:
    """Distribute the braking; arguments as `Law.step`.

    The error of a wheel is its sliding speed minus that at the target slip [m/s].
    """
    body, wheel = memory.body[0], memory.wheel
    dt = motion.dt if motion.dt > 0.0 else _PERIOD
    if motion.first:
        _start(law, memory)
    # One wheel may be assumed to roll once the observers have settled.
    settled = body.steps * dt > CASCADE**2 * law.observer_time
    unknown = _read_wheels(law, memory, motion)
    if motion.pedal <= 0.0 or unknown > settled:
        return NO_HELP
    if body.steps > 0:
        if not body.responded:
            estimate_dead_time(law, memory, dt)
        observe_friction(law, memory, dt)
        observe_body(law, memory, motion, dt)
    body.v_x, body.v_y, body.yaw_rate = motion.v_x, motion.v_y, motion.yaw_rate
    allocate(law, memory, motion)
    control_slip(law, memory, motion, dt, enable)
    strongest, demanding = 0.0, 0
    for i in range(error.size):
        rim_speed = law.rim[i] * wheel[i].speed
        error[i] = wheel[i].hub - rim_speed - law.target_slip * law.radius[i] * wheel[i].speed
        wheel[i].last_speed = wheel[i].speed
        strongest = max(strongest, enable[i])
        if wheel[i].demand > wheel[demanding].demand:
            demanding = i
    if strongest <= 0.0:
        enable[demanding] = max(law.brake.pressure_step, LEAST_ENABLE)
    remember_torque(law, memory, motion, dt, enable)
    body.steps += 1
    return ASSIST


@lean
def _start(law: Constants, memory: Memory) -> None:
    """Begin with the nominal mass, its weight shared by the wheels, on ground of friction 1."""
    body, wheel = memory.body[0], memory.wheel
    body.steps = 0
    body.heading = body.a_x = body.a_y = body.yaw_acceleration = 0.0
    body.yaw_disturbance = body.lateral_disturbance = 0.0
    body.mass, body.deceleration, body.force = law.mass, _GRAVITY, law.mass * _GRAVITY
    body.dead_time, body.responded = law.brake.dead_time, False
    memory.sent[:] = memory.qp.solution[:] = 0.0
    for i in range(wheel.size):
        wheel[i].torque = wheel[i].mean_torque = wheel[i].force = 0.0
        wheel[i].capacity, wheel[i].demand = law.mass * _GRAVITY / wheel.size, 1.0


@lean
def _read_wheels(law: Constants, memory: Memory, motion: Motion) -> int:
    """Write the state of the wheels; return how many speeds are unknown."""
    unknown, fastest = 0, 0.0
    for i in range(law.rim.size):
        wheel = memory.wheel[i]
        along = law.n_x[i] * motion.v_x + law.n_y[i] * motion.v_y + law.lever[i] * motion.yaw_rate
        wheel.hub, wheel.sign = abs(along), math.copysign(1.0, along)
        wheel.known = math.isfinite(motion.wheel_speed[i])
        wheel.speed = wheel.hub / law.rim[i]
        if wheel.known:
            wheel.speed = max(wheel.sign * law.sense[i] * motion.wheel_speed[i], 0.0)
        sliding = wheel.hub - law.rim[i] * wheel.speed
        wheel.slip = sliding / (law.radius[i] * wheel.speed + 1e-3)
        unknown += not wheel.known
        fastest = max(fastest, wheel.hub)
    for i in range(law.rim.size):
        memory.wheel[i].locked = memory.wheel[i].hub <= law.locked_share * fastest
    return unknown
