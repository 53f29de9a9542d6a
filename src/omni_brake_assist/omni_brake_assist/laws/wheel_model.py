"""Model of a braked wheel inside the assistant: brake lag and slip.

Each wheel is reduced to its rim. Let ``I`` be the wheel's moment of inertia, and ``g`` the lever of
the friction force ``f`` about the axle. The rim then has the mass ``I/g^2``. Its speed ``u`` along
the active direction follows from ``I/g^2 du/dt = f - B`` with the brake force ``B``. The nominal
brake follows its command after a dead time and with a first-order lag. The friction force is a
parabolic function of the sliding speed up to the estimated capacity and then remains constant. A
full tire model is not needed: only the sign of the slope and the height of the curve matter, and
the measured wheel speed corrects both at every step.
"""

import math
from typing import NamedTuple

from omni_core.kernels import lean
from omni_core.quantities import FloatArray


class NominalBrake(NamedTuple):
    """Properties of a brake that the law assumes.

    Attributes:
        dead_time: time from a command to the first change of the force [s].
        time_constant: time constant of the lag after the dead time [s].
        pressure_step: resolution of the enable [1], 1 for on-off valves.
    """

    dead_time: float
    time_constant: float
    pressure_step: float


class BrakedWheel(NamedTuple):
    """Properties of a braked wheel that the law assumes during a step.

    Attributes:
        capacity: largest friction force [N].
        peak_slip: smallest ratio of sliding speed to rim speed at which the friction force equals
            the capacity [1].
        mass: inertia of the wheel as a mass at its rim [kg].
        hub: speed of the wheel's center along the active direction [m/s], at least 0.
    """

    capacity: float
    peak_slip: float
    mass: float
    hub: float


@lean
def command_at(sent: FloatArray, newest: int, delay: float, i: int) -> float:
    """Return the command to brake `i` at a time in the past, in the unit of `sent`.

    Args:
        sent: commands of past steps, a ring buffer, shape (Q, N).
        newest: row of the newest command.
        delay: number of steps before the newest command; may be fractional.
        i: index of the wheel.
    """
    size = sent.shape[0]
    whole = min(math.floor(delay), size - 2)
    share = min(delay - whole, 1.0)
    late, later = sent[(newest - whole) % size, i], sent[(newest - whole - 1) % size, i]
    return float((1.0 - share) * late + share * later)


@lean
def lagged(brake: NominalBrake, force: float, command: float, dt: float) -> float:
    """Return the force of a brake with lag after one step [N].

    Args:
        brake: nominal lag of the brake; only its time constant is used.
        force: brake force before the step [N].
        command: commanded brake force [N].
        dt: length of the step [s].
    """
    if brake.time_constant <= 0.0:
        return command
    return command + (force - command) * math.exp(-(dt / brake.time_constant))


@lean
def advance_rim(wheel: BrakedWheel, speed: float, brake: float, dt: float) -> tuple[float, float]:
    """Return the rim speed of a braked wheel after one implicit step, and the friction force.

    The friction force is ``c (1 - q^2)``, where ``q = (u - u_p)/(hub - u_p)`` is limited to the
    range from 0 to 1. ``c`` is the friction capacity, ``u`` the speed of the rim, and ``u_p`` the
    speed of the rim at the peak slip. The equation of the step is quadratic in ``q``.

    Args:
        wheel: assumed properties of the wheel.
        speed: speed of the rim [m/s], at least 0.
        brake: brake force [N].
        dt: length of the step [s].

    Returns:
        Speed of the rim after the step [m/s] and mean friction force during it [N].
    """
    capacity, peak_slip, mass, hub = wheel
    inertia = mass / dt
    peak = hub / (1.0 + peak_slip)
    excess = capacity - brake + inertia * (speed - peak)
    if excess <= 0.0:  # the wheel slides
        return max(peak + excess / inertia, 0.0), capacity
    slope = inertia * (hub - peak)
    share = 2.0 * excess / (slope + math.sqrt(slope * slope + 4.0 * capacity * excess))
    if share >= 1.0:  # it rolls faster than its hub
        return max(speed - brake / inertia, 0.0), 0.0
    return peak + share * (hub - peak), capacity * (1.0 - share * share)
