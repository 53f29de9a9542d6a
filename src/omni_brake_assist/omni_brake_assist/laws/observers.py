"""Observers of the law `allocation` for friction of the wheels, vehicle mass and disturbances.

The model ``I/g^2 du/dt = f - B`` (`wheel_model`) gives the friction force ``f`` of a wheel from the
speed ``u`` of the rim and the nominal brake force ``B``. ``I`` is the wheel's moment of inertia,
and ``g`` the lever of the friction force about the axle. The force of a sliding wheel is its
friction capacity. The estimated capacity is raised if a wheel uses all of it without sliding. These
forces and the motion of the body give the vehicle's mass and the accelerations that friction does
not explain.

Three loops form a cascade. From the inside out, these are the friction observer, the observer of
disturbances and mass, and the return of the heading (`braking_qp`). Each loop is half as fast as
the next inner loop.
"""

import math

from omni_brake_assist.filter_bank.state import UNKNOWN_LAG
from omni_brake_assist.laws.allocation_state import CASCADE, Constants, Memory
from omni_brake_assist.laws.law import NO_WHEEL, Motion
from omni_brake_assist.laws.wheel_model import BrakedWheel, advance_rim, command_at, lagged
from omni_core.kernels import lean
from omni_core.quantities import GRAVITY, FloatArray

_RESPONSE = 0.3  # share of the expected loss of wheel speed that counts as a response [1]
LONGEST_DEAD_TIME = 0.15  # a dead time above this limit is not increased [s]
_LEAST_CAPACITY = 1.0  # lower limit, so that shares of the capacity are defined [N]


@lean
def observe(law: Constants, memory: Memory, motion: Motion, error: FloatArray) -> bool:
    """Update all estimates; return whether at least half of the wheels have a speed reading.

    Args:
        law: constants of the law.
        memory: memory of the law.
        motion: motion of the vehicle and its wheels.
        error: output, error of each wheel [m/s] as defined in `allocation.step`, shape (N,).
    """
    enough = 2 * _observe_wheels(law, memory, motion, error) >= memory.wheel.size
    if enough and memory.body[0].steps > 0:
        observe_friction(law, memory)
        observe_body(law, memory, motion)
    return enough


@lean
def _observe_wheels(law: Constants, memory: Memory, motion: Motion, error: FloatArray) -> float:
    """Update motion and nominal brake force of each wheel; estimate the brakes' dead time.

    The estimated dead time increases while the wheels lose much less speed than the nominal torque
    predicts. During the dead time, the brakes are assumed to exert no force.

    Returns:
        Number of wheels with a speed reading.
    """
    body, limit = memory.body[0], law.locked_share * math.hypot(motion.v_x, motion.v_y)
    expected = lost = readings = 0.0
    # At most one encoder is assumed to be faulty, and none after a brake has failed.
    longest = memory.wheel["idle"].argmax() if motion.failed_brake == NO_WHEEL else NO_WHEEL
    for i, wheel in enumerate(memory.wheel):
        carried = law.active[i, 0] * motion.v_x + law.active[i, 1] * motion.v_y
        along = carried + law.active[i, 2] * motion.yaw_rate
        wheel.hub = abs(along)
        # A locked wheel can hold its hub while the vehicle rotates about it.
        rolled = law.rim[i] * motion.wheel_speed[i]
        holds = wheel.hub <= limit and abs(rolled) <= law.locked_share * abs(carried)
        wheel.sign = math.copysign(1.0, carried if holds else along)
        wheel.fixed = i == motion.failed_brake or max(abs(carried), wheel.hub) <= limit
        idle = _measure_idle(law, memory, i, rolled, limit) and i == longest
        wheel.known = math.isfinite(rolled) and not idle
        readings += math.isfinite(rolled)
        wheel.last_speed = wheel.speed
        wheel.speed = max(wheel.sign * rolled, 0.0) if wheel.known else wheel.hub
        error[i] = wheel.hub - (1.0 + law.target_slip[i]) * wheel.speed
        command = law.most[i] * command_at(memory.sent, body.steps - 1, body.dead_time / body.dt, i)
        wheel.brake = lagged(law.brake, wheel.brake, command, body.dt)
        if wheel.known and not body.responded:
            model = BrakedWheel(wheel.capacity, law.target_slip[i], law.wheel_mass[i], wheel.hub)
            after, _ = advance_rim(model, wheel.last_speed, wheel.brake, body.dt)
            expected += wheel.last_speed - after
            lost += wheel.last_speed - wheel.speed
    if expected > 0.0:
        body.responded = lost > _RESPONSE * expected or body.dead_time > LONGEST_DEAD_TIME
        if not body.responded:
            body.dead_time += body.dt
            memory.wheel["brake"][:] = 0.0
    return readings


@lean
def _measure_idle(law: Constants, memory: Memory, i: int, rolled: float, limit: float) -> bool:
    """Return whether a wheel has read 0 for longer than a locked wheel could remain locked.

    If the brake force falls below the friction capacity, a locked wheel turns as soon as the brake
    has followed, within `UNKNOWN_LAG`. If it does not turn, its encoder is faulty, or the friction
    has decreased. Rolling is then the better assumption: slip control would otherwise keep the
    brake force low to let the wheel turn, although the law expects the whole capacity. The
    assumption holds until the wheel turns.

    The idle time is weighted with the share of the capacity that accelerates the wheel.

    Args:
        law: constants of the law.
        memory: memory of the law.
        i: index of the wheel.
        rolled: measured speed of the rim along the active direction [m/s].
        limit: speed of the hub up to which the motion does not turn the wheel [m/s].
    """
    wheel = memory.wheel[i]
    if not abs(rolled) <= law.locked_share * wheel.hub:
        wheel.idle = 0.0
    elif wheel.known and wheel.hub > limit:
        excess = 1.0 - wheel.brake / wheel.capacity
        wheel.idle = wheel.idle + memory.body[0].dt * excess if excess > 0.0 else 0.0
    return bool(wheel.idle >= UNKNOWN_LAG)


@lean
def observe_friction(law: Constants, memory: Memory) -> None:
    """Update friction forces and capacities of all wheels.

    The force of a sliding wheel is its capacity; that of a locked wheel is at most its brake force.
    If the force rises faster than the capacity may grow, however, the tire is still deflecting, and
    the force is only a lower bound of the capacity. The capacity then rises to the force with the
    time constant of the brakes' nominal lag, because an error of this lag appears as friction.

    A wheel without a speed reading gets the largest capacity of the wheels with a reading, because
    its encoder may have been faulty before it was isolated. This capacity limits its force.
    """
    dt = memory.body[0].dt
    gain, largest = 1.0 - math.exp(-dt / law.observer_time), 0.0
    for wheel in memory.wheel:
        largest = max(largest, wheel.capacity * wheel.known)
    for i, wheel in enumerate(memory.wheel):
        change = wheel.speed - wheel.last_speed
        wheel.measured = max(wheel.brake + law.wheel_mass[i] * change / dt, 0.0)
        if not wheel.known:
            wheel.capacity = largest
            wheel.measured = min(wheel.measured, wheel.capacity)
        elif max(wheel.speed, wheel.last_speed) <= law.locked_share * wheel.hub:
            wheel.measured = wheel.usable  # it does not turn while its hub moves, so it slides
        rise = gain * (wheel.measured - wheel.force)
        wheel.force += rise
        growth = dt / (CASCADE**4 * law.observer_time) * wheel.capacity
        if rise > growth:
            share = dt / (dt + law.brake.time_constant)
            wheel.capacity += share * max(wheel.measured - wheel.capacity, 0.0)
        elif wheel.hub > (1.0 + law.target_slip[i]) * wheel.speed:
            wheel.capacity += gain * (wheel.force - wheel.capacity)
        elif memory.qp.solution[i] >= 1.0 and wheel.usable >= wheel.capacity:
            wheel.capacity += growth
        wheel.capacity = min(max(wheel.capacity, wheel.force, _LEAST_CAPACITY), law.most[i])


@lean
def observe_body(law: Constants, memory: Memory, motion: Motion) -> None:
    """Update heading, mass estimate and disturbances from motion and forces of the last period."""
    body, dt = memory.body[0], memory.body[0].dt
    f_x = f_y = moment = 0.0
    for i, wheel in enumerate(memory.wheel):
        force = -wheel.sign * wheel.measured
        f_x += force * law.active[i, 0]
        f_y += force * law.active[i, 1]
        moment += force * law.active[i, 2]
    body.heading += 0.5 * (body.twist[2] + motion.yaw_rate) * dt
    a_x = (motion.v_x - body.twist[0]) / dt - motion.yaw_rate * motion.v_y
    a_y = (motion.v_y - body.twist[1]) / dt + motion.yaw_rate * motion.v_x
    share = 1.0 - math.exp(-dt / (CASCADE * law.observer_time))
    a = math.hypot(a_x, a_y)
    gain = body.responded * (1.0 - math.exp(-dt / law.observer_time)) / (a + GRAVITY)
    body.mass += gain * (math.hypot(f_x, f_y) - body.mass * a)
    turned = (motion.yaw_rate - body.twist[2]) / dt - moment / (body.mass * law.gyration**2)
    body.yaw_disturbance += share * (turned - body.yaw_disturbance)
    pushed = (a_x - f_x / body.mass) * motion.across_x + (a_y - f_y / body.mass) * motion.across_y
    body.lateral_disturbance += share * (pushed - body.lateral_disturbance)
