"""Friction observer and capacity estimator of each wheel, and the dead time of the brakes.

``I dw/dt = g f - T``, with the lever ``g`` of the force, gives the friction force ``f`` from wheel
speed and nominal torque ``T``. If a wheel slides, its force is its capacity. If a wheel uses its
whole capacity without sliding, the capacity is raised.
"""

import math

from omni_brake_assist.laws.allocation_state import Constants, Memory, Wheels
from omni_brake_assist.laws.wheel_model import BrakedWheel, turn_on
from omni_platform.kernels import lean

_RESPONSE = 0.3  # share of the expected loss of wheel speed that counts as a response [1]
_VISIBLE = 0.02  # smallest expected loss that is compared, as a share of the wheel speed [1]
_LONGEST_EXTRA = 0.15  # largest estimated excess over the nominal dead time [s]
_LEAST_CAPACITY = 1.0  # smallest capacity, so that shares of it are defined [N]


@lean
def estimate_dead_time(law: Constants, memory: Memory, wheels: Wheels, dt: float) -> None:
    """Extend the dead time while the wheels lose far less speed than the torque should cause."""
    body, wheel = memory.body[0], memory.wheel
    expected = lost = total = 0.0
    for i in range(law.rim.size):
        total += wheels.speed[i]
        if wheels.locked[i]:
            continue
        model = BrakedWheel(
            wheel[i].capacity, law.target_slip, law.rim[i], law.radius[i], law.inertia
        )
        after, _ = turn_on(model, wheel[i].speed, wheel[i].mean_torque, wheels.hub[i], dt)
        expected += wheel[i].speed - after
        lost += wheel[i].speed - wheels.speed[i]
    if expected <= _VISIBLE * total:
        return
    if lost > _RESPONSE * expected or body.dead_time > law.brake.dead_time + _LONGEST_EXTRA:
        body.responded = True
        return
    body.dead_time += dt
    for i in range(law.rim.size):
        wheel[i].torque = wheel[i].mean_torque = 0.0


@lean
def observe_friction(law: Constants, memory: Memory, wheels: Wheels, dt: float) -> None:
    """Update friction forces and capacities.

    If a force rises faster than a capacity may grow, the tire still deflects; its capacity then is
    at least the unfiltered force. With on-off brakes the filtered force is used, because their
    torque changes in large steps.
    """
    gain = 1.0 - math.exp(-dt / law.observer_time)
    others = 0.0
    for i in range(law.rim.size):
        wheel, rim = memory.wheel[i], law.rim[i]
        change = wheels.speed[i] - wheel.speed if wheels.known[i] else 0.0
        measured = (wheel.mean_torque + law.inertia * change / dt) / rim
        if wheels.locked[i]:
            measured = 0.0
        elif rim * max(wheels.speed[i], wheel.speed) <= law.locked_share * wheels.hub[i]:
            measured = wheel.force  # the wheel has stopped: its brake holds with less than T
        most = law.brake.max_torque / rim
        measured = min(max(measured, 0.0), most)
        rise = gain * (measured - wheel.force)
        wheel.force += rise
        if wheels.known[i] and not wheels.locked[i]:
            capacity = wheel.capacity
            growth = dt / law.growth_time * capacity
            if rise > growth:
                capacity = max(
                    capacity, wheel.force if law.brake.pressure_step >= 1.0 else measured
                )
            elif wheels.slip[i] > law.target_slip:
                capacity += gain * (wheel.force - capacity)
            elif wheel.demand >= capacity:
                capacity += growth
            wheel.capacity = min(max(capacity, wheel.force, _LEAST_CAPACITY), most)
        others += wheel.capacity if wheels.known[i] else 0.0
    for i in range(law.rim.size):
        if not wheels.known[i]:  # estimates from a faulty encoder are not used
            memory.wheel[i].capacity = others / (law.rim.size - 1)
