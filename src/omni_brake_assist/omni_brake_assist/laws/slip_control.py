"""Slip control: brake torques for the demanded forces, and the choice of on-off valves.

A wheel whose demand equals its capacity is held at the target slip by control of its speed; any
other wheel gets the torque of its demand. Both torques are computed for the moment when a new
command starts to act: the effect of commands still in the dead time is predicted, and the brake's
lag is inverted.
"""

import math

import numpy as np

from omni_brake_assist.laws.allocation_state import Constants, Memory, Wheels
from omni_brake_assist.laws.braking_qp import Task, cost
from omni_brake_assist.laws.law import Motion
from omni_brake_assist.laws.wheel_model import QUEUE, BrakedWheel, asked_at, lagged, turn_on
from omni_platform.kernels import kernel, lean
from omni_platform.quantities import FloatArray

LEAST_ENABLE = 0.01
"""Enable of the last brake that is on: the assistant lets none roll unbraked [1]."""

_DEEP = 0.02  # cost of wheels slower than at the target slip, which decides between equal forces


@kernel
def control_slip(
    law: Constants,
    memory: Memory,
    motion: Motion,
    wheels: Wheels,
    task: Task,
    dt: float,
    enable: FloatArray,
) -> None:
    """Write the enables of all wheels that are not locked."""
    body, brake, n = memory.body[0], law.brake, enable.size
    most = brake.max_torque * motion.pedal
    delay = body.dead_time / dt
    newest = int(body.steps % QUEUE) - 1
    speed = math.hypot(motion.v_x, motion.v_y)
    slowing = body.deceleration / (speed + 1e-3)  # relative rate of all speeds [1/s]
    horizon = math.ceil((law.slip_time + brake.time_constant) / dt - 1e-9)
    valves = brake.pressure_step >= 1.0
    forces, deep = np.zeros((2, n)), np.zeros((2, n))
    for i in range(n):
        if wheels.locked[i]:
            continue
        wheel, rim = memory.wheel[i], law.rim[i]
        model = BrakedWheel(wheel.capacity, law.target_slip, rim, law.radius[i], law.inertia)
        hub = wheels.hub[i] / (1.0 + slowing * (body.dead_time + dt))
        spin, torque = wheels.speed[i], wheel.torque
        for k in range(min(math.ceil(delay - 1e-9), QUEUE)):
            asked = asked_at(memory.sent, newest, max(delay - 1.0 - k, 0.0), i)
            torque, mean = lagged(brake, torque, asked, dt)
            spin, _ = turn_on(model, spin, mean, hub, dt)
        goal = hub / (rim + law.radius[i] * law.target_slip) + 1e-9
        if valves:  # a pulse of one period and its whole effect
            for state in range(2):
                speed_k, torque_k = spin, torque
                for k in range(horizon):
                    asked = most * state if k == 0 else 0.0
                    torque_k, mean = lagged(brake, torque_k, asked, dt)
                    speed_k, force = turn_on(model, speed_k, mean, hub, dt)
                    forces[state, i] += force / horizon
                missing = max(1.0 - speed_k / goal, 0.0)
                deep[state, i] = _DEEP / n * missing * missing
            continue
        # A tire must deflect before it transmits its force; it deflects sooner if it slides faster.
        push = law.relaxation_speed * (1.0 - min(wheel.force / wheel.capacity, 1.0))
        goal = max(hub - push, 0.0) / (rim + law.radius[i] * law.target_slip)
        need = most
        if goal > 0.0:
            need = rim * wheel.capacity + law.inertia * (spin - goal) / (
                law.slip_time + body.dead_time
            )
        if wheel.demand < wheel.capacity or not wheels.known[i]:
            need = min(need, rim * wheel.demand + law.inertia * spin * slowing)
        if brake.time_constant > 0.0:
            need = torque - (need - torque) / math.expm1(-dt / brake.time_constant)
        enable[i] = min(max(need / most, 0.0), 1.0)
        if brake.pressure_step > 0.0:
            enable[i] = min(
                math.floor(enable[i] / brake.pressure_step + 0.5) * brake.pressure_step, 1.0
            )
    if valves:
        _choose_valves(task, forces, deep, enable)


@kernel
def _choose_valves(task: Task, forces: FloatArray, deep: FloatArray, enable: FloatArray) -> None:
    """Open the valves whose predicted forces cost least in terms of the QP.

    From all valves open, the best single change is made until none lowers the cost.
    """
    n = enable.size
    enable[:] = 1.0
    # Not `rows @ forces`: its first call would import SciPy's BLAS, 0.3 s in mid-stop.
    sums, other = np.sum(task.rows * forces[1], axis=1), np.sum(deep[1])
    best = cost(task, sums) + other
    for _ in range(2 * n):
        changed = -1
        for i in range(n):
            on = int(enable[i])
            trial = sums + task.rows[:, i] * (forces[1 - on, i] - forces[on, i])
            value = cost(task, trial) + other + deep[1 - on, i] - deep[on, i]
            if value < best:
                best, changed = value, i
        if changed < 0:
            return
        on = int(enable[changed])
        sums += task.rows[:, changed] * (forces[1 - on, changed] - forces[on, changed])
        other += deep[1 - on, changed] - deep[on, changed]
        enable[changed] = 1.0 - on


@lean
def remember_torque(
    law: Constants, memory: Memory, motion: Motion, dt: float, enable: FloatArray
) -> None:
    """Store the commands, and predict the torques of the next period."""
    body = memory.body[0]
    newest = int(body.steps % QUEUE)
    for i in range(enable.size):
        wheel = memory.wheel[i]
        memory.sent[newest, i] = enable[i] * law.brake.max_torque * motion.pedal
        asked = asked_at(memory.sent, newest, body.dead_time / dt, i)
        wheel.torque, wheel.mean_torque = lagged(law.brake, wheel.torque, asked, dt)
