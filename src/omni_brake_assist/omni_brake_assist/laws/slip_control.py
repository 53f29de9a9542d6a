"""Slip control: brake forces for the demanded friction forces, and the choice of on-off valves.

If the demand of a wheel equals its capacity, a speed controller keeps the wheel at the target slip.
Every other wheel receives the brake force of its demand. Both are computed for the moment at which
a new command begins to act: the effect of the commands still in the dead time is predicted, and the
brake lag is inverted.
"""

import math

import numpy as np

from omni_brake_assist.laws import wheel_model
from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.braking_qp import cost
from omni_brake_assist.laws.disturbance_observer import CASCADE
from omni_brake_assist.laws.law import Motion
from omni_brake_assist.laws.wheel_model import BrakedWheel, advance_rim, command_at, lagged
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_SLIDE = 0.02  # cost of wheels below the target speed, to decide between equal forces
_LEAST_ENABLE = 0.01  # enable of the last acting brake, as at least one must act [1]


@lean
def control_slip(
    law: Constants, memory: Memory, motion: Motion, dt: float, enable: FloatArray
) -> None:
    """Write the enables; the enable of a locked wheel and of a failed brake is 1."""
    body, valves = memory.body[0], law.brake.pressure_step >= 1.0
    newest, delay = int(body.steps % wheel_model.QUEUE) - 1, body.dead_time / dt
    # Relative rate of change of all speeds [1/s].
    slowing = body.deceleration / (math.hypot(motion.v_x, motion.v_y) + 1e-3)
    time = law.observer_time / CASCADE  # time constant of this loop, inside the friction observer
    horizon = math.ceil((time + law.brake.time_constant) / dt - 1e-9)
    strongest = 0
    for i in range(enable.size):
        wheel = memory.wheel[i]
        if memory.qp.solution[i] > memory.qp.solution[strongest]:
            strongest = i
        enable[i] = 1.0
        memory.forces[:, i] = memory.slides[:, i] = 0.0
        if wheel.locked or i == motion.failed_brake:
            continue
        model = BrakedWheel(wheel.capacity, law.peak_slip[i], law.wheel_mass[i])
        hub = wheel.hub / (1.0 + slowing * (body.dead_time + dt))
        speed, brake = wheel.speed, wheel.brake
        for k in range(min(math.ceil(delay - 1e-9), wheel_model.QUEUE)):
            command = command_at(memory.sent, newest, max(delay - 1.0 - k, 0.0), i)
            brake, mean = lagged(law.brake, brake, command, dt)
            speed, _ = advance_rim(model, speed, mean, hub, dt)
        most = law.most[i] * motion.pedal
        if valves:  # a pulse of one period and its effect
            for state in range(2):
                speed_k, brake_k = speed, brake
                for k in range(horizon):
                    brake_k, mean = lagged(law.brake, brake_k, most * state if k == 0 else 0.0, dt)
                    speed_k, force = advance_rim(model, speed_k, mean, hub, dt)
                    memory.forces[state, i] += force / (horizon * wheel.capacity)
                missing = max(1.0 - (1.0 + law.peak_slip[i]) * speed_k / (hub + 1e-9), 0.0)
                memory.slides[state, i] = _SLIDE / enable.size * missing * missing
            continue
        # A tire transmits its force only after it has deflected. Faster sliding shortens this time.
        push = law.relaxation_speed * (1.0 - min(wheel.force / wheel.capacity, 1.0))
        need, goal = most, max(hub - push, 0.0) / (1.0 + law.peak_slip[i])
        if goal > 0.0:
            change = (speed - goal) / (time + body.dead_time)
            need = wheel.capacity + law.wheel_mass[i] * change
        demand = memory.qp.solution[i]
        if demand < 1.0 or not wheel.known:
            need = min(need, demand * wheel.capacity + law.wheel_mass[i] * speed * slowing)
        need = wheel_model.command_for(law.brake, brake, need, dt)
        enable[i] = min(max(need / most, 0.0), 1.0)
    if valves:
        _choose_valves(memory, enable)
    if np.sum(enable) <= 0.0:
        enable[strongest] = max(law.brake.pressure_step, _LEAST_ENABLE)


@lean
def _choose_valves(memory: Memory, enable: FloatArray) -> None:
    """Choose the pattern of valves whose predicted forces have the lowest cost in the QP.

    Starting with all valves open, the best single change is made until no change lowers the cost.
    """
    best = cost(memory, enable)
    for _ in range(2 * enable.size):
        changed = -1
        for i in range(enable.size):
            enable[i] = 1.0 - enable[i]
            value = cost(memory, enable)
            enable[i] = 1.0 - enable[i]
            if value < best:
                best, changed = value, i
        if changed < 0:
            return
        enable[changed] = 1.0 - enable[changed]


@lean
def remember(law: Constants, memory: Memory, motion: Motion, dt: float, enable: FloatArray) -> None:
    """Store motion and commands, and predict the brake forces of the next period."""
    body = memory.body[0]
    body.v_x, body.v_y, body.yaw_rate = motion.v_x, motion.v_y, motion.yaw_rate
    newest = int(body.steps % wheel_model.QUEUE)
    for i in range(enable.size):
        wheel = memory.wheel[i]
        memory.sent[newest, i] = enable[i] * law.most[i] * motion.pedal
        if i == motion.failed_brake:
            memory.sent[newest, i] = 0.0
        command = command_at(memory.sent, newest, body.dead_time / dt, i)
        wheel.brake, wheel.mean_brake = lagged(law.brake, wheel.brake, command, dt)
        wheel.last_speed = wheel.speed
    body.steps += 1
