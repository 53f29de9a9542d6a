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

# Lower limit of the enable of the proportional brake with the largest demanded share [1], unless a
# step of the brake is larger. Without it, the assistant would put all brakes on if the law released
# all of them.
_LEAST_ENABLE = 1e-3


@lean
def control_slip(law: Constants, memory: Memory, motion: Motion, enable: FloatArray) -> None:
    """Write the brake enables of all wheels [1], shape (N,), to `enable`.

    For on-off valves, the predicted friction forces are written to `memory.forces`. The law never
    releases all brakes. If the cost is lowest with all valves shut, and no wheel is fixed, only the
    valve of the wheel with the largest demanded share is open.
    """
    body, share, valves = memory.body[0], memory.qp.solution, law.brake.pressure_step >= 1.0
    times, delay = (body.dt, law.observer_time), body.dead_time / body.dt
    # Pattern of the fixed wheels, and the wheel with the largest demanded share.
    fixed, largest = 0, share[: enable.size].argmax()
    for i, wheel in enumerate(memory.wheel):
        enable[i], memory.forces[0, i], memory.forces[1, i] = 1.0, share[i], share[i]
        if wheel.fixed:
            fixed |= 1 << i
            continue
        # State of the wheel when a new command begins to act.
        hub = wheel.hub * body.left / (body.left + body.dead_time + 1e-9)
        braked = model.BrakedWheel(wheel.capacity, law.target_slip[i], law.wheel_mass[i], hub)
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
            aim = min(aim, 2.0 * share[i] * wheel.capacity - rim.force)
        enable[i] = min(max(model.command_for(law.brake, rim.brake, aim, body.dt) / most, 0.0), 1.0)
    if valves:
        pattern = best_pattern(memory) | fixed or 1 << largest
        for i in range(enable.size):
            enable[i] = (pattern >> i) & 1
    else:
        enable[largest] = max(enable[largest], law.brake.pressure_step, _LEAST_ENABLE)
