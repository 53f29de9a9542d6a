"""Slip control: brake torques for the demanded forces, and the choice of on-off valves.

A wheel whose demand equals its capacity is held at the target slip by control of its speed; any
other wheel gets the torque of its demand. Both torques are computed for the moment when a new
command starts to act: the effect of commands still in the dead time is predicted, and the brake's
lag is inverted.
"""

import math

from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.braking_qp import DECELERATION, SIDE, YAW, cost
from omni_brake_assist.laws.law import Motion
from omni_brake_assist.laws.wheel_model import QUEUE, BrakedWheel, asked_at, lagged, turn_on
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

LEAST_ENABLE = 0.01
"""Enable of the last brake that is on: the assistant lets none roll unbraked [1]."""

_DEEP = 0.02  # cost of wheels slower than at the target slip, which decides between equal forces


@lean
def control_slip(
    law: Constants, memory: Memory, motion: Motion, dt: float, enable: FloatArray
) -> None:
    """Write the enables; locked wheels are braked."""
    body, brake, n = memory.body[0], law.brake, enable.size
    most = brake.max_torque * motion.pedal
    delay = body.dead_time / dt
    newest = int(body.steps % QUEUE) - 1
    speed = math.hypot(motion.v_x, motion.v_y)
    slowing = body.deceleration / (speed + 1e-3)  # relative rate of all speeds [1/s]
    horizon = math.ceil((law.slip_time + brake.time_constant) / dt - 1e-9)
    valves = brake.pressure_step >= 1.0
    enable[:] = 1.0
    memory.forces[:] = memory.deep[:] = 0.0
    for i in range(n):
        wheel, rim = memory.wheel[i], law.rim[i]
        if wheel.locked:
            continue
        model = BrakedWheel(wheel.capacity, law.target_slip, rim, law.radius[i], law.inertia)
        hub = wheel.hub / (1.0 + slowing * (body.dead_time + dt))
        spin, torque = wheel.speed, wheel.torque
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
                    memory.forces[state, i] += force / (horizon * wheel.capacity)
                missing = max(1.0 - speed_k / goal, 0.0)
                memory.deep[state, i] = _DEEP / n * missing * missing
            continue
        # A tire must deflect before it transmits its force; it deflects sooner if it slides faster.
        push = law.relaxation_speed * (1.0 - min(wheel.force / wheel.capacity, 1.0))
        goal = max(hub - push, 0.0) / (rim + law.radius[i] * law.target_slip)
        need = most
        if goal > 0.0:
            need = rim * wheel.capacity + law.inertia * (spin - goal) / (
                law.slip_time + body.dead_time
            )
        if wheel.demand < 1.0 or not wheel.known:
            need = min(need, rim * wheel.demand * wheel.capacity + law.inertia * spin * slowing)
        if brake.time_constant > 0.0:
            need = torque - (need - torque) / math.expm1(-dt / brake.time_constant)
        enable[i] = min(max(need / most, 0.0), 1.0)
        if brake.pressure_step > 0.0:
            enable[i] = min(
                math.floor(enable[i] / brake.pressure_step + 0.5) * brake.pressure_step, 1.0
            )
    if valves:
        _choose_valves(memory, enable)


@lean
def _choose_valves(memory: Memory, enable: FloatArray) -> None:
    """Open the valves whose predicted forces cost least in terms of the QP.

    From all valves open, the best single change is made until none lowers the cost.
    """
    qp, forces, deep, n = memory.qp, memory.forces, memory.deep, enable.size
    braking = yaw = side = other = 0.0
    for i in range(n):
        braking += qp.rows[DECELERATION, i] * forces[1, i]
        yaw += qp.rows[YAW, i] * forces[1, i]
        side += qp.rows[SIDE, i] * forces[1, i]
        other += deep[1, i]
    best = cost(qp, braking, yaw, side) + other
    for _ in range(2 * n):
        changed = -1
        for i in range(n):
            on = int(enable[i])
            force = forces[1 - on, i] - forces[on, i]
            value = (
                other
                + deep[1 - on, i]
                - deep[on, i]
                + cost(
                    qp,
                    braking + qp.rows[DECELERATION, i] * force,
                    yaw + qp.rows[YAW, i] * force,
                    side + qp.rows[SIDE, i] * force,
                )
            )
            if value < best:
                best, changed = value, i
        if changed < 0:
            return
        on = int(enable[changed])
        force = forces[1 - on, changed] - forces[on, changed]
        braking += qp.rows[DECELERATION, changed] * force
        yaw += qp.rows[YAW, changed] * force
        side += qp.rows[SIDE, changed] * force
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
