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

_LEAST_ENABLE = 0.01  # enable of the last acting brake, as at least one must act [1]


@lean
def control_slip(
    law: Constants, memory: Memory, motion: Motion, dt: float, enable: FloatArray
) -> None:
    """Write the brake enables of all wheels to `enable`."""
    # Relative rate of change of all speeds [1/s].
    slowing = memory.body[0].deceleration / (math.hypot(motion.v_x, motion.v_y) + 1e-3)
    valves, strongest, total = law.brake.pressure_step >= 1.0, 0, 0.0
    for i in range(enable.size):
        most = law.most[i] * motion.pedal
        enable[i] = 1.0
        memory.forces[0, i] = memory.forces[1, i] = memory.qp.solution[i]
        if not memory.wheel[i].fixed:
            model, rim = _at_effect(law, memory, i, slowing, dt)
            if valves:
                _predict_pulses(law, memory, i, model, rim, most, dt)
            else:
                need = _brake_force(law, memory, i, model, rim, slowing)
                need = wheel_model.command_for(law.brake, rim.brake, need, dt)
                enable[i] = min(max(need / most, 0.0), 1.0)
    if valves:
        _choose_valves(memory, enable)
    for i in range(enable.size):
        total += enable[i]
        if memory.qp.solution[i] > memory.qp.solution[strongest]:
            strongest = i
    if total <= 0.0:
        enable[strongest] = max(law.brake.pressure_step, _LEAST_ENABLE)


@lean
def _at_effect(
    law: Constants, memory: Memory, i: int, slowing: float, dt: float
) -> tuple[BrakedWheel, Rim]:
    """Return the model of wheel `i`, and its state when a new command begins to act.

    `slowing` is the deceleration of the vehicle divided by its speed [1/s].
    """
    body, wheel = memory.body[0], memory.wheel[i]
    newest, delay = body.steps - 1, body.dead_time / dt
    hub = wheel.hub / (1.0 + slowing * body.dead_time)
    model = BrakedWheel(wheel.capacity, law.peak_slip[i], law.wheel_mass[i], hub)
    rim = Rim(wheel.speed, wheel.brake, wheel.force)
    for k in range(min(math.ceil(delay - 1e-9), wheel_model.QUEUE)):
        command = command_at(memory.sent, newest, max(delay - 1.0 - k, 0.0), i)
        rim = advance(law.brake, model, rim, command, dt, law.observer_time)
    return model, rim


@lean
def _brake_force(
    law: Constants, memory: Memory, i: int, model: BrakedWheel, rim: Rim, slowing: float
) -> float:
    """Return the brake force of wheel `i` for its demand [N].

    Args:
        law: constants.
        memory: state of the law, with the solution of the QP.
        i: index of the wheel.
        model: assumed properties of the wheel.
        rim: state of the wheel when the command begins to act.
        slowing: deceleration of the vehicle divided by its speed [1/s].
    """
    wheel, share = memory.wheel[i], memory.qp.solution[i]
    # A tire transmits its force only after it has deflected. Faster sliding shortens this time.
    push = law.relaxation_speed * (1.0 - min(wheel.force / model.capacity, 1.0))
    need, goal = math.inf, max(model.hub - push, 0.0) / (1.0 + model.peak_slip)
    if goal > 0.0:
        # This loop is inside the friction observer.
        time = law.observer_time / CASCADE + memory.body[0].dead_time
        need = model.capacity + model.mass * (rim.speed - goal) / time
    if share < 1.0 or not wheel.known:
        need = min(need, share * model.capacity + model.mass * rim.speed * slowing)
    return need


@lean
def _predict_pulses(
    law: Constants, memory: Memory, i: int, model: BrakedWheel, start: Rim, most: float, dt: float
) -> None:
    """Predict the observed force of wheel `i` after a period with its valve shut or open.

    With a brake lag, the prediction ends one time constant later. The observed force is low-passed
    like the measured one. A force that alternates between periods therefore counts as its mean.

    Args:
        law: constants.
        memory: state of the law; `forces` is written.
        i: index of the wheel.
        model: assumed properties of the wheel.
        start: state of the wheel when the command begins to act.
        most: brake force with the valve open [N].
        dt: control period [s].
    """
    horizon = 1 + math.ceil(law.brake.time_constant / dt - 1e-9)
    for state in range(2):
        rim, command = start, most * state
        for _ in range(horizon):
            rim, command = advance(law.brake, model, rim, command, dt, law.observer_time), 0.0
        memory.forces[state, i] = rim.force / model.capacity


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
def remember(law: Constants, memory: Memory, motion: Motion, dt: float, enable: FloatArray) -> None:
    """Store motion and commands, and predict the brake forces of the next period."""
    body = memory.body[0]
    body.v_x, body.v_y, body.yaw_rate = motion.v_x, motion.v_y, motion.yaw_rate
    for i in range(enable.size):
        wheel = memory.wheel[i]
        acts = i != motion.failed_brake
        memory.sent[body.steps % wheel_model.QUEUE, i] = (
            enable[i] * law.most[i] * motion.pedal * acts
        )
        command = command_at(memory.sent, body.steps, body.dead_time / dt, i)
        wheel.brake, wheel.mean_brake = lagged(law.brake, wheel.brake, command, dt)
        wheel.last_speed = wheel.speed
    body.steps += 1
