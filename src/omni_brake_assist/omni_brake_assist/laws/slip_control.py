"""Slip control: brake forces, or a pattern of on-off valves, for the demanded friction forces.

If the friction force demanded of a wheel equals its capacity, a speed controller keeps the wheel at
the target slip. Every other wheel receives the brake force that causes the demanded friction force,
with a feedback of the friction force. A locked wheel exerts its whole capacity, regardless of its
brake force. If less than half of this capacity is demanded, the feedback therefore releases the
wheel until it turns. From the acceleration of the wheel, the friction observer then estimates the
true capacity.

On-off valves are switched to the pattern whose forces have the lowest cost in the QP. For both
kinds of brakes, the law predicts the state of the wheel at the time when a new command begins to
act. This prediction uses the commands that were sent but have not acted yet because of the dead
time.
"""

import math

from omni_brake_assist.laws import wheel_model as model
from omni_brake_assist.laws.allocation_state import CASCADE, Constants, Memory
from omni_brake_assist.laws.braking_qp import best_pattern
from omni_brake_assist.laws.law import Motion
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_LEAST_ENABLE = 0.01  # enable of one brake if all others are released [1]


@lean
def control_slip(law: Constants, memory: Memory, motion: Motion, enable: FloatArray) -> None:
    """Write the brake enables of all wheels [1], shape (N,), to `enable`.

    For on-off valves, the predicted friction forces are written to `memory.forces`. At least one
    brake remains on.
    """
    body, share, valves = memory.body[0], memory.qp.solution, law.brake.pressure_step >= 1.0
    times, delay = (body.dt, law.observer_time), body.dead_time / body.dt
    slowing = body.deceleration / (math.hypot(motion.v_x, motion.v_y) + 1e-3)  # [1/s]
    for i, wheel in enumerate(memory.wheel):
        enable[i], memory.forces[0, i], memory.forces[1, i] = 1.0, share[i], share[i]
        if wheel.fixed:
            continue
        # State of the wheel when a new command begins to act.
        hub = wheel.hub / (1.0 + slowing * body.dead_time)
        braked = model.BrakedWheel(wheel.capacity, law.peak_slip[i], law.wheel_mass[i], hub)
        rim = model.Rim(wheel.speed, wheel.brake, wheel.force)
        for k in range(min(math.ceil(delay - 1e-9), model.QUEUE)):
            command = model.command_at(memory.sent, body.steps - 1, max(delay - 1.0 - k, 0.0), i)
            rim = model.advance(law.brake, braked, rim, law.most[i] * command, *times)
        most = law.most[i] * motion.pedal
        if valves:
            memory.forces[0, i] = model.predict_share(law.brake, braked, rim, 0.0, *times)
            memory.forces[1, i] = model.predict_share(law.brake, braked, rim, most, *times)
            continue
        # A tire transmits its force only after it has deflected. Faster sliding shortens this time.
        push = law.relaxation_speed * max(1.0 - wheel.force / wheel.capacity, 0.0)
        goal = max(hub - push, 0.0) / (1.0 + braked.peak_slip)
        # Without dead time, this loop is CASCADE times as fast as the observer.
        time = law.observer_time / CASCADE + body.dead_time
        aim = wheel.capacity + braked.mass * (rim.speed - goal) / time if goal > 0.0 else math.inf
        if share[i] < 1.0 or not wheel.known:
            demanded, slowed = share[i] * wheel.capacity, braked.mass * rim.speed * slowing
            aim = min(aim, demanded + slowed + demanded - rim.force)
        enable[i] = min(max(model.command_for(law.brake, rim.brake, aim, body.dt) / most, 0.0), 1.0)
    pattern = best_pattern(memory) if valves else 0
    largest, total = 0, 0.0
    for i, wheel in enumerate(memory.wheel):
        if valves and not wheel.fixed:
            enable[i] = (pattern >> i) & 1
        if share[i] > share[largest]:
            largest = i
        total += enable[i]
    if total <= 0.0:
        enable[largest] = max(law.brake.pressure_step, _LEAST_ENABLE)
