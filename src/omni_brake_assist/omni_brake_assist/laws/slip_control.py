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
from typing import NamedTuple

from omni_brake_assist.laws import wheel_model as model
from omni_brake_assist.laws.allocation_state import CASCADE, Constants, Memory
from omni_brake_assist.laws.braking_qp import best_pattern
from omni_brake_assist.laws.law import Motion
from omni_brake_assist.laws.wheel_model import BrakedWheel, NominalBrake
from omni_core.kernels import lean
from omni_core.quantities import FloatArray

# Lower limit of the enable of the proportional brake with the largest demanded share [1], unless a
# step of the brake is larger. Without it, the assistant would put all brakes on if the law released
# all of them.
_LEAST_ENABLE = 1e-3


class Rim(NamedTuple):
    """State of the rim of a braked wheel.

    Attributes:
        speed: speed of the rim in the direction in which it rolls [m/s], at least 0.
        brake: brake force [N].
        force: low-passed friction force [N].
    """

    speed: float
    brake: float
    force: float


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
        braked = BrakedWheel(wheel.capacity, law.target_slip[i], law.wheel_mass[i], hub)
        rim = Rim(wheel.speed, wheel.brake, wheel.force)
        for k in range(min(math.ceil(delay - 1e-9), law.commands)):
            command = model.command_at(memory.sent, body.steps - 1, max(delay - 1.0 - k, 0.0), i)
            rim = advance(law.brake, braked, rim, law.most[i] * command, *times)
        most = law.most[i] * motion.pedal
        if valves:
            shut = _predict_force(law.brake, braked, rim, 0.0, *times)
            whole = _predict_force(law.brake, braked, rim, most, *times)
            memory.forces[0, i], memory.forces[1, i] = shut / wheel.usable, whole / wheel.usable
            continue
        # A tire transmits its force only after it has deflected. Faster sliding shortens this time.
        push = law.relaxation_speed * max(1.0 - wheel.force / wheel.capacity, 0.0)
        goal = max(hub - push, 0.0) / (1.0 + braked.peak_slip)
        # Without dead time, this loop is CASCADE times as fast as the observer, but a wheel cannot
        # reach its speed in less than a period.
        time = max(law.observer_time / CASCADE, law.period) + body.dead_time
        aim = wheel.capacity + braked.mass * (rim.speed - goal) / time if goal > 0.0 else math.inf
        if share[i] < 1.0 or not wheel.known:
            aim = min(aim, 2.0 * share[i] * wheel.usable - rim.force)
        enable[i] = min(max(command_for(law.brake, rim.brake, aim, body.dt) / most, 0.0), 1.0)
    if valves:
        pattern = best_pattern(memory) | fixed or 1 << largest
        for i in range(enable.size):
            enable[i] = (pattern >> i) & 1
    else:
        enable[largest] = max(enable[largest], law.brake.pressure_step, _LEAST_ENABLE)


@lean
def advance(
    brake: NominalBrake, wheel: BrakedWheel, rim: Rim, command: float, dt: float, time: float
) -> Rim:
    """Return brake force, rim speed and low-passed friction force after one step.

    Args:
        brake: nominal lag of the brake; only its time constant is used.
        wheel: assumed properties of the wheel.
        rim: state before the step.
        command: commanded brake force [N].
        dt: length of the step [s].
        time: time constant of the low-pass [s].
    """
    after = mean = model.lagged(brake, rim.brake, command, dt)
    if brake.time_constant > 0.0:
        mean = command + (rim.brake - after) / (dt / brake.time_constant)
    speed, force = model.advance_rim(wheel, rim.speed, mean, dt)
    return Rim(speed, after, force + (rim.force - force) * math.exp(-dt / time))


@lean
def _predict_force(
    brake: NominalBrake, wheel: BrakedWheel, rim: Rim, command: float, dt: float, time: float
) -> float:
    """Return the friction force after `command` has acted for one period [N].

    For a brake with a lag, the prediction continues for one time constant with a command of 0. The
    predicted force is low-passed like the measured force. If the force alternates from one period
    to the next, its mean is therefore returned. The arguments are those of `advance`.
    """
    for _ in range(1 + math.ceil(brake.time_constant / dt - 1e-9)):
        rim, command = advance(brake, wheel, rim, command, dt, time), 0.0
    return rim.force


@lean
def command_for(brake: NominalBrake, force: float, wanted: float, dt: float) -> float:
    """Return the command with which a brake reaches a wanted force after one step [N].

    Args:
        brake: nominal lag of the brake; only its time constant is used.
        force: brake force before the step [N].
        wanted: brake force after the step [N].
        dt: length of the step [s].
    """
    if brake.time_constant <= 0.0:
        return wanted
    return force - (wanted - force) / math.expm1(-dt / brake.time_constant)
