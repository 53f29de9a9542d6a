"""Slip control: brake forces for the demanded friction forces, and the choice of on-off valves.

If the friction force demanded of a wheel equals its capacity, a speed controller keeps the wheel at
the target slip. Every other wheel receives the brake force that causes the demanded friction force.
On-off valves are switched to the pattern whose forces have the lowest cost in the QP. For both
kinds of brakes, the law predicts the state of the wheel at the time when a new command begins to
act. This prediction uses the commands that were sent but have not acted yet because of the dead
time.
"""

import math

from omni_brake_assist.laws import wheel_model
from omni_brake_assist.laws.allocation_state import CASCADE, Constants, Memory
from omni_brake_assist.laws.braking_qp import best_pattern
from omni_brake_assist.laws.law import Motion
from omni_brake_assist.laws.wheel_model import BrakedWheel, Rim
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_LEAST_ENABLE = 0.01  # enable of one brake if all others are released [1]


@lean
def control_slip(law: Constants, memory: Memory, motion: Motion, enable: FloatArray) -> None:
    """Write the brake enables of all wheels [1], shape (N,), to `enable`."""
    body, share, valves = memory.body[0], memory.qp.solution, law.brake.pressure_step >= 1.0
    times = body.dt, law.observer_time
    slowing = body.deceleration / (math.hypot(motion.v_x, motion.v_y) + 1e-3)  # [1/s]
    for i in range(enable.size):
        wheel = memory.wheel[i]
        enable[i], memory.forces[:, i] = 1.0, share[i]
        if wheel.fixed:
            continue
        model, rim = _at_effect(law, memory, slowing, i)
        most = law.most[i] * motion.pedal
        if valves:
            memory.forces[0, i] = wheel_model.predict_share(law.brake, model, rim, 0.0, *times)
            memory.forces[1, i] = wheel_model.predict_share(law.brake, model, rim, most, *times)
            continue
        # A tire transmits its force only after it has deflected. Faster sliding shortens this time.
        push = law.relaxation_speed * (1.0 - min(wheel.force / model.capacity, 1.0))
        need, goal = math.inf, max(model.hub - push, 0.0) / (1.0 + model.peak_slip)
        if goal > 0.0:
            # Without dead time, this loop is CASCADE times as fast as the observer.
            time = law.observer_time / CASCADE + body.dead_time
            need = model.capacity + model.mass * (rim.speed - goal) / time
        if share[i] < 1.0 or not wheel.known:
            slowed = model.mass * rim.speed * slowing
            need = min(need, share[i] * model.capacity + slowed)
        command = wheel_model.command_for(law.brake, rim.brake, need, body.dt)
        enable[i] = min(max(command / most, 0.0), 1.0)
    if valves:
        pattern = best_pattern(memory)
        for i in range(enable.size):
            enable[i] = 1.0 if memory.wheel[i].fixed else (pattern >> i) & 1
    if enable.sum() <= 0.0:
        strongest = share[: enable.size].argmax()
        enable[strongest] = max(law.brake.pressure_step, _LEAST_ENABLE)


@lean
def _at_effect(law: Constants, memory: Memory, slowing: float, i: int) -> tuple[BrakedWheel, Rim]:
    """Return the model of a wheel, and the wheel's state when a new command begins to act.

    Args:
        law: constants of the law.
        memory: memory of the law.
        slowing: deceleration of the vehicle divided by its speed [1/s].
        i: index of the wheel.
    """
    body, wheel = memory.body[0], memory.wheel[i]
    newest, delay = body.steps - 1, body.dead_time / body.dt
    hub = wheel.hub / (1.0 + slowing * body.dead_time)
    model = BrakedWheel(wheel.capacity, law.peak_slip[i], law.wheel_mass[i], hub)
    rim = Rim(wheel.speed, wheel.brake, wheel.force)
    for k in range(min(math.ceil(delay - 1e-9), wheel_model.QUEUE)):
        command = wheel_model.command_at(memory.sent, newest, max(delay - 1.0 - k, 0.0), i)
        rim = wheel_model.advance(law.brake, model, rim, command, body.dt, law.observer_time)
    return model, rim
