"""Monitor of the wheel speeds: which of them a law may use, and whether they refute the estimate.

A braked wheel turns with the ground and no faster; a released one spins up. A wheel that for a
while turns faster than it rolls, or backwards, or does not spin up after its release, has a faulty
encoder or a valve that does not release. A law would take it for a wheel on ice and release others
to keep the heading, so its speed is rejected until the pedal is released.

Two such wheels at a time refute the estimate of the motion instead: a fault that twist and IMU
share passes every comparison of these two, but not that with the wheels. Nor has an estimate
without a valid twist any support if no wheel follows the ground although a brake is released.
"""

import math

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.monitors.brake_monitor import BrakeConstants, BrakedWheels
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

WATCH = np.dtype(
    [
        ("impossible", "f8"),  # for how long it has turned as no wheel does [s]
        ("free", "f8"),  # for how long it has not gained though it has been let go [s]
        ("rim", "f8"),  # speed of the rim as that began [m/s]
        ("rejected", "?"),
        ("slides", "f8"),  # of the first: for how long no wheel has followed the ground [s]
    ]
)
"""State of the monitor for one wheel."""

SUPPORTED, UNSUPPORTED, REFUTED = range(3)

_SLOW = 0.5  # speed along the active direction below which nothing shows [m/s]
_OFF, _OFF_SHARE = 0.3, 0.03  # by which a rim that rolls may be off for a while [m/s], [1]
_IMPOSSIBLE = 0.1  # for how long it may be farther off [s]
_LET_GO = 0.05  # share of the pedal's demand that counts for none [1]
_FOLLOWS = 0.85  # share of its hub's speed at which a rim follows the ground [1]
_SLIDES = 0.2  # time for which all may slide while a brake is released [s]
_RELEASED = 0.5  # share of the pedal's demand below which a brake counts as released [1]
_REFUTING = 2  # wheels that refute the estimate
_GAIN = 0.2  # of a rim that is dragged, on ice too, while a brake is let go and as long again [m/s]


def wheel_memory(wheels: int) -> NDArray[np.void]:
    """Return a memory in which no wheel is rejected, `WATCH`, shape (N,)."""
    return np.zeros(wheels, WATCH)


@lean
def watch_wheels(
    constants: BrakeConstants,
    memory: NDArray[np.void],
    dt: float,
    pedal: float,
    wheels: BrakedWheels,
    twist: tuple[float, float, float],
    law_speeds: FloatArray,
) -> int:
    """Check the wheel speeds after a step of braking.

    Args:
        constants: of the vehicle.
        memory: of `wheel_memory`, changed in place.
        dt: length of the step [s].
        pedal: the driver's demand in it, 0 while there is none [1].
        wheels: after the step, commanded before it.
        twist: current body twist [m/s, m/s, rad/s].
        law_speeds: that a law may use [rad/s], shape (N,); NaN for a rejected wheel.

    Returns:
        REFUTED if wheels refute the twist, UNSUPPORTED if none follows the ground although a brake
        is released, else SUPPORTED.
    """
    follows, released, seen, refuting = False, False, False, 0
    for i in range(law_speeds.size):
        wheel = memory[i]
        if pedal <= 0.0:
            wheel.impossible = wheel.free = 0.0
            wheel.rejected = False
            continue
        hub = constants.n_x[i] * twist[0] + constants.n_y[i] * twist[1]
        hub += constants.lever[i] * twist[2]
        rim = constants.roll[i] * wheels.speeds[i] / (1.0 + wheels.scale)
        if math.isfinite(rim):
            rim, fast = (rim, hub) if hub >= 0.0 else (-rim, -hub)
            off = _OFF + _OFF_SHARE * fast
            shows = fast > _SLOW
            seen = seen or shows
            follows = follows or (shows and rim >= _FOLLOWS * fast)
            released = released or wheels.commanded[i] < _RELEASED
            wrong = shows and (rim > fast + off or rim < -off)
            wheel.impossible = wheel.impossible + dt if wrong else max(wheel.impossible - dt, 0.0)
            behind = shows and wheels.commanded[i] <= _LET_GO and rim < fast - off
            if not behind or wheel.free <= 0.0 or rim > wheel.rim + _GAIN:
                wheel.free, wheel.rim = 0.0, rim
            if behind:
                wheel.free += dt
            if wheel.impossible > _IMPOSSIBLE or wheel.free > 2.0 * constants.time:
                wheel.rejected = True
                refuting += 1
        if wheel.rejected:
            law_speeds[i] = math.nan
    slides = pedal > 0.0 and seen and released and not follows
    memory[0].slides = memory[0].slides + dt if slides else 0.0
    if refuting >= _REFUTING:
        return REFUTED
    return UNSUPPORTED if memory[0].slides > _SLIDES else SUPPORTED
