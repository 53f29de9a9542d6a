"""Observer of each wheel's friction force and capacity, and estimator of the brakes' dead time.

The model ``I/g^2 du/dt = f - B`` (`wheel_model`) gives the friction force ``f`` from the speed of
the rim and the nominal brake force. The force of a sliding wheel is its friction capacity. The
estimated capacity is raised if a wheel uses all of it without sliding.
"""

import math

from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.disturbance_observer import CASCADE
from omni_brake_assist.laws.wheel_model import BrakedWheel, advance_rim
from omni_platform.kernels import lean

_RESPONSE = 0.3  # share of the expected loss of wheel speed that counts as response [1]
_LONGEST_EXTRA = 0.15  # largest estimated dead time beyond the nominal one [s]
_LEAST_CAPACITY = 1.0  # lower limit, so that shares of the capacity are defined [N]


@lean
def estimate_dead_time(law: Constants, memory: Memory, dt: float) -> None:
    """Increase the dead time while the wheels slow much less than the nominal torque predicts."""
    body = memory.body[0]
    expected = lost = 0.0
    for i in range(law.rim.size):
        wheel = memory.wheel[i]
        model = BrakedWheel(wheel.capacity, law.peak_slip[i], law.wheel_mass[i], wheel.hub)
        after, _ = advance_rim(model, wheel.last_speed, wheel.mean_brake, dt)
        expected += wheel.last_speed - after
        lost += wheel.last_speed - wheel.speed
    if expected <= 0.0:
        return
    if lost > _RESPONSE * expected or body.dead_time > law.brake.dead_time + _LONGEST_EXTRA:
        body.responded = True
        return
    body.dead_time += dt
    for i in range(law.rim.size):
        memory.wheel[i].brake = memory.wheel[i].mean_brake = 0.0


@lean
def observe_friction(law: Constants, memory: Memory, dt: float) -> None:
    """Update friction forces and capacities of all wheels.

    If the force rises faster than the allowed growth of the capacity, the tire is still deflecting.
    The capacity is then at least the unfiltered force. On-off torques are too coarse for this, so
    the filtered force is used instead.
    """
    gain = 1.0 - math.exp(-dt / law.observer_time)
    others = known = 0.0
    for i in range(law.rim.size):
        wheel, most = memory.wheel[i], law.most[i]
        change = wheel.speed - wheel.last_speed if wheel.known else 0.0
        measured = wheel.mean_brake + law.wheel_mass[i] * change / dt
        if wheel.locked:
            measured = 0.0
        elif max(wheel.speed, wheel.last_speed) <= law.locked_share * wheel.hub:
            # A locked wheel slides. Its friction force has not decreased with the nominal brake
            # force, or the wheel would turn again.
            measured = min(max(measured, wheel.force), wheel.capacity)
        wheel.measured = measured = min(max(measured, 0.0), most)
        rise = gain * (measured - wheel.force)
        wheel.force += rise
        if wheel.known and not wheel.locked:
            capacity = wheel.capacity
            growth = dt / (CASCADE**4 * law.observer_time) * capacity
            if rise > growth:
                shown = wheel.force if law.brake.pressure_step >= 1.0 else measured
                capacity = max(capacity, shown)
            elif wheel.hub > (1.0 + law.peak_slip[i]) * wheel.speed:
                capacity += gain * (wheel.force - capacity)
            elif memory.qp.solution[i] >= 1.0:
                capacity += growth
            wheel.capacity = min(max(capacity, wheel.force, _LEAST_CAPACITY), most)
        others += wheel.capacity * wheel.known
        known += wheel.known
    for i in range(law.rim.size):
        if not memory.wheel[i].known:  # the encoder is faulty
            memory.wheel[i].capacity = others / known
