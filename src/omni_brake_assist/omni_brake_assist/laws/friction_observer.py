"""Friction observer and capacity estimator of each wheel, and the dead time of the brakes.

``I dw/dt = g f - T`` gives the friction force ``f`` from wheel speed and nominal torque. A wheel
that slides shows its friction limit; a limit that is fully used without a slide is raised.
"""

import math

from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.wheel_model import BrakedWheel, turn_on
from omni_platform.kernels import lean

_RESPONSE = 0.3  # share of the expected loss of wheel speed that shows a response [1]
_VISIBLE = 0.02  # expected loss as a share of the wheel speed from which on it is compared [1]
_LONGEST_EXTRA = 0.15  # dead time beyond the nominal one that is learned at most [s]
_LEAST_CAPACITY = 1.0  # so that shares of it are defined [N]


@lean
def estimate_dead_time(law: Constants, memory: Memory, dt: float) -> None:
    """Extend the dead time while the wheels lose far less speed than the torque should take."""
    body, wheel = memory.body[0], memory.wheel
    expected = lost = total = 0.0
    for i in range(law.rim.size):
        w = wheel[i]
        total += w.speed
        if w.locked:
            continue
        model = BrakedWheel(w.capacity, law.target_slip, law.rim[i], law.radius[i], law.inertia)
        after, _ = turn_on(model, w.last_speed, w.mean_torque, w.hub, dt)
        expected += w.last_speed - after
        lost += w.last_speed - w.speed
    if expected <= _VISIBLE * total:
        return
    if lost > _RESPONSE * expected or body.dead_time > law.brake.dead_time + _LONGEST_EXTRA:
        body.responded = True
        return
    body.dead_time += dt
    for i in range(law.rim.size):
        wheel[i].torque = wheel[i].mean_torque = 0.0


@lean
def observe_friction(law: Constants, memory: Memory, dt: float) -> None:
    """Update friction forces and capacities.

    A force that rises faster than a capacity may grow shows a tire that still deflects, which
    will transmit at least its unfiltered force. On-off torques are too coarse for that.
    """
    gain = 1.0 - math.exp(-dt / law.observer_time)
    others = 0.0
    for i in range(law.rim.size):
        wheel, rim = memory.wheel[i], law.rim[i]
        change = wheel.speed - wheel.last_speed if wheel.known else 0.0
        measured = (wheel.mean_torque + law.inertia * change / dt) / rim
        if wheel.locked:
            measured = 0.0
        elif rim * max(wheel.speed, wheel.last_speed) <= law.locked_share * wheel.hub:
            # It slides: a force that decreases with the torque would let it turn.
            measured = min(max(measured, wheel.force), wheel.capacity)
        most = law.brake.max_torque / rim
        measured = min(max(measured, 0.0), most)
        rise = gain * (measured - wheel.force)
        wheel.force += rise
        if wheel.known and not wheel.locked:
            capacity = wheel.capacity
            growth = dt / law.growth_time * capacity
            if rise > growth:
                capacity = max(
                    capacity, wheel.force if law.brake.pressure_step >= 1.0 else measured
                )
            elif wheel.slip > law.target_slip:
                capacity += gain * (wheel.force - capacity)
            elif wheel.demand >= 1.0:
                capacity += growth
            wheel.capacity = min(max(capacity, wheel.force, _LEAST_CAPACITY), most)
        others += wheel.capacity if wheel.known else 0.0
    for i in range(law.rim.size):
        if not memory.wheel[i].known:  # what a faulty encoder has shown is not used
            memory.wheel[i].capacity = others / (law.rim.size - 1)
