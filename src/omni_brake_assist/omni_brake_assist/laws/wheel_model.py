"""The assistant's model of a braked wheel: brake lag and slip.

The nominal brake follows its command after a dead time and with a first-order lag. The wheel turns
by ``I dw/dt = g f - T``, with the lever ``g`` of the friction force ``f`` and the torque ``T``. The
force over the slip rises as a parabola to the estimated capacity and remains there. This is no tire
model: only the sign of the slope and the height matter, and the measured wheel speed corrects both
at every step.
"""

import math
from typing import NamedTuple

from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_SUBSTEPS = 2
_NEWTON = 3
QUEUE = 128
"""Steps that a dead time may last at most."""


class NominalBrake(NamedTuple):
    """Assumed properties of the brakes.

    Attributes:
        max_torque: torque with the pedal fully down [N m].
        dead_time: time from a command to the first change of the torque [s].
        time_constant: time constant of the lag after the dead time [s].
        pressure_step: resolution of the enable [1], 1 for on-off valves.
    """

    max_torque: float
    dead_time: float
    time_constant: float
    pressure_step: float


class BrakedWheel(NamedTuple):
    """Assumed properties of a wheel.

    Attributes:
        capacity: largest friction force [N].
        peak_slip: smallest slip at which the capacity is reached [1].
        rim: lever ``r |n_w . u|`` of the friction force about the axle [m].
        radius: radius of the wheel [m].
        inertia: inertia of the wheel about its axle [kg m^2].
    """

    capacity: float
    peak_slip: float
    rim: float
    radius: float
    inertia: float


@lean
def asked_at(sent: FloatArray, newest: int, delay: float, i: int) -> float:
    """Return the torque that was demanded of brake `i` a number of steps ago [N m].

    Args:
        sent: commanded torques by step [N m], a ring buffer, shape (QUEUE, N).
        newest: row of the newest command.
        delay: number of steps before it; may be fractional.
        i: index of the wheel.
    """
    whole = min(math.floor(delay), QUEUE - 2)
    share = min(delay - whole, 1.0)
    late, later = sent[(newest - whole) % QUEUE, i], sent[(newest - whole - 1) % QUEUE, i]
    return float((1.0 - share) * late + share * later)


@lean
def lagged(brake: NominalBrake, torque: float, asked: float, dt: float) -> tuple[float, float]:
    """Return the torque of a brake after a step, and its mean over the step [N m]."""
    if brake.time_constant <= 0.0:
        return asked, asked
    ratio = dt / brake.time_constant
    missing = torque - asked
    mean = asked + missing * -math.expm1(-ratio) / ratio
    return asked + missing * math.exp(-ratio), mean


@lean
def friction(slip: float, peak_slip: float, capacity: float) -> tuple[float, float]:
    """Return the assumed force [N] and its slope over the slip [N]."""
    if slip >= peak_slip:
        return capacity, 0.0
    if slip <= 0.0:
        return 0.0, 0.0
    missing = 1.0 - slip / peak_slip
    return capacity * (1.0 - missing * missing), 2.0 * capacity * missing / peak_slip


@lean
def turn_on(
    wheel: BrakedWheel, spin: float, torque: float, hub: float, dt: float
) -> tuple[float, float]:
    """Advance a wheel by a step; implicit, so that a stiff tire needs no small steps.

    Args:
        wheel: assumed properties of the wheel.
        spin: wheel speed in the sense in which it rolls [rad/s], at least 0.
        torque: torque of the brake [N m].
        hub: speed of the wheel's center along the active direction [m/s], at least 0.
        dt: length of the step [s].

    Returns:
        Wheel speed after the step [rad/s] and mean friction force during it [N].
    """
    capacity, peak_slip, rim, radius, inertia = wheel
    h = dt / _SUBSTEPS
    total = 0.0
    for _ in range(_SUBSTEPS):
        new, force = spin, 0.0
        for _ in range(_NEWTON):
            ground = radius * new + 1e-3
            slip = (hub - rim * new) / ground
            force, slope = friction(slip, peak_slip, capacity)
            stiff = slope * (rim + radius * slip) / ground  # -df/dspin
            residual = new - spin - h * (rim * force - torque) / inertia
            new = max(new - residual / (1.0 + h * rim * stiff / inertia), 0.0)
        force = min(max((inertia * (new - spin) / h + torque) / rim, 0.0), capacity)
        if new <= 0.0:
            force = friction((hub) / 1e-3, peak_slip, capacity)[0]
        total += force
        spin = new
    return spin, total / _SUBSTEPS
