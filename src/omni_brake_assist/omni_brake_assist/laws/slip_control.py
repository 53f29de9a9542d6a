"""Slip control: brake forces for the demanded friction forces, and the choice of on-off valves.

If the demand of a wheel equals its capacity, a speed controller keeps the wheel at the target slip.
Every other wheel receives the brake force of its demand. On-off valves take the pattern whose
forces have the lowest cost in the QP. In both cases, the state in which a new command begins to act
is predicted from the commands that are still in the dead time.
"""

import math

from omni_brake_assist.laws import wheel_model
from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.braking_qp import cost
from omni_brake_assist.laws.law import Motion
from omni_brake_assist.laws.observers import CASCADE
from omni_brake_assist.laws.wheel_model import BrakedWheel, Rim, advance, command_at, lagged
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_LEAST_ENABLE = 0.01  # enable of one brake if all others are released [1]


@lean
def control_slip(law: Constants, memory: Memory, motion: Motion, enable: FloatArray) -> None:
    """Write the brake enables of all wheels to `enable`."""
    body, share, valves = memory.body[0], memory.qp.solution, law.brake.pressure_step >= 1.0
    times, strongest, total = (body.dt, law.observer_time), 0, 0.0
    body.slowing = body.deceleration / (math.hypot(motion.v_x, motion.v_y) + 1e-3)
    for i in range(enable.size):
        enable[i], memory.forces[:, i] = 1.0, share[i]
        if not memory.wheel[i].fixed:
            model, rim = _at_effect(law, memory, i)
            most = law.most[i] * motion.pedal
            if valves:
                memory.forces[0, i] = wheel_model.predict_share(law.brake, model, rim, 0.0, *times)
                memory.forces[1, i] = wheel_model.predict_share(law.brake, model, rim, most, *times)
            else:
                need = _brake_force(law, memory, i, model, rim)
                enable[i] = min(max(need / most, 0.0), 1.0)
    if valves:
        _choose_valves(memory, enable)
    for i in range(enable.size):
        total += enable[i]
        if share[i] > share[strongest]:
            strongest = i
    if total <= 0.0:
        enable[strongest] = max(law.brake.pressure_step, _LEAST_ENABLE)


@lean
def _at_effect(law: Constants, memory: Memory, i: int) -> tuple[BrakedWheel, Rim]:
    """Return the model of wheel `i`, and its state when a new command begins to act."""
    body, wheel = memory.body[0], memory.wheel[i]
    newest, delay = body.steps - 1, body.dead_time / body.dt
    hub = wheel.hub / (1.0 + body.slowing * body.dead_time)
    model = BrakedWheel(wheel.capacity, law.peak_slip[i], law.wheel_mass[i], hub)
    rim = Rim(wheel.speed, wheel.brake, wheel.force)
    for k in range(min(math.ceil(delay - 1e-9), wheel_model.QUEUE)):
        command = command_at(memory.sent, newest, max(delay - 1.0 - k, 0.0), i)
        rim = advance(law.brake, model, rim, command, body.dt, law.observer_time)
    return model, rim


@lean
def _brake_force(law: Constants, memory: Memory, i: int, model: BrakedWheel, rim: Rim) -> float:
    """Return the command with which brake `i` meets its demand at the end of a period [N].

    Args:
        law: constants.
        memory: state of the law, with the solution of the QP.
        i: index of the wheel.
        model: assumed properties of the wheel.
        rim: state of the wheel when the command begins to act.
    """
    body, wheel, share = memory.body[0], memory.wheel[i], memory.qp.solution[i]
    # A tire transmits its force only after it has deflected. Faster sliding shortens this time.
    push = law.relaxation_speed * (1.0 - min(wheel.force / model.capacity, 1.0))
    need, goal = math.inf, max(model.hub - push, 0.0) / (1.0 + model.peak_slip)
    if goal > 0.0:
        # Without dead time, this loop is CASCADE times as fast as the friction observer.
        time = law.observer_time / CASCADE + body.dead_time
        need = model.capacity + model.mass * (rim.speed - goal) / time
    if share < 1.0 or not wheel.known:
        need = min(need, share * model.capacity + model.mass * rim.speed * body.slowing)
    return float(wheel_model.command_for(law.brake, rim.brake, need, body.dt))


@lean
def _choose_valves(memory: Memory, enable: FloatArray) -> None:
    """Choose the pattern of valves whose predicted forces have the lowest cost in the QP.

    A wheel whose brake force far exceeds its capacity slides beyond the predicted time, whether its
    valve is open or shut. It must be shut to let the brake force decrease: of several patterns with
    the same cost, the first one is chosen.
    """
    best, chosen = math.inf, 0
    for pattern in range(1 << enable.size):
        value = cost(memory, pattern)
        if value < best:
            best, chosen = value, pattern
    for i in range(enable.size):
        if not memory.wheel[i].fixed:
            enable[i] = (chosen >> i) & 1


@lean
def remember(law: Constants, memory: Memory, motion: Motion, enable: FloatArray) -> None:
    """Store motion and commands, and predict the brake forces of the next period."""
    body = memory.body[0]
    body.v_x, body.v_y, body.yaw_rate = motion.v_x, motion.v_y, motion.yaw_rate
    for i in range(enable.size):
        wheel = memory.wheel[i]
        acts = i != motion.failed_brake
        memory.sent[body.steps % wheel_model.QUEUE, i] = (
            enable[i] * law.most[i] * motion.pedal * acts
        )
        command = command_at(memory.sent, body.steps, body.dead_time / body.dt, i)
        wheel.brake, wheel.mean_brake = lagged(law.brake, wheel.brake, command, body.dt)
        wheel.last_speed = wheel.speed
    body.steps += 1
