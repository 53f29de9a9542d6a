"""Monitor that uses pedal, wheel speeds and specific force to detect too little braking.

A vehicle that decelerates by ``a`` although braking decelerates it by at least ``c`` travels
``v (1 - a / c) dt`` farther than necessary. The monitor multiplies this length by the pedal
position, adds it to the missed distance ``M``, adds the remaining length ``v a / c dt``, also
multiplied by the pedal position, to the braked distance ``B``, and requires

    M <= creep + allowance v_0 + share B

with the speed ``v_0`` at the start of the stop and the constants of `EffectConstants`. The speed
``v`` is the larger of two: the speed of the fastest rim, because some wheel rolls in an assisted
stop, and the speed before the stop minus the integral of the specific force and minus the decrease
of the speed of the wheels about their center, which the gyro measures. A scale error that
all encoders and the twist share therefore does not shorten the computed distance. Without an IMU
such an error cannot be observed, and ``v`` decreases by at most `loss` per second. While all brakes
act, nothing is added to ``M``.

With an IMU, ``a`` is the low-passed specific force, plus the low-passed decrease of the speed of
the wheels about their center. Without an IMU, it is the difference between ``v`` and its low-pass.
The deceleration ``c`` is `least_loss`, scaled by the pedal position. It does not depend on earlier
decelerations in the stop: on ice under one side of the vehicle, the assistant can only keep the
heading with little deceleration, because it has to release brakes on the other side.

Two more bounds limit how long brakes may be released. The first is the duration of a stop with the
mean deceleration `least`, extended by `grace`. The second is used only with an IMU: at the end of a
stop, the deceleration may be small for at most the time constant of the specific force's low-pass.
This bound is exceeded in stops in which the braked wheels exert no force along the motion, because
the vehicle moves along their passive direction. Without an IMU, the end of a stop cannot be
recognized, because locked wheels also have slow rims.

After a bound is exceeded, all brakes act until the pedal is released.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.filter_bank.state import least_loss
from omni_core.geometry import PlatformGeometry
from omni_core.kernels import by_reference, lean
from omni_core.quantities import FloatArray, Triple

_LEDGER = np.dtype(
    [
        ("missed", "f8"),  # missed distance [m]
        ("braked", "f8"),  # braked distance [m]
        ("tripped", "?"),  # whether a bound has been exceeded
        ("start", "f8"),  # speed of the fastest rim when the pedal was pressed [m/s]
        ("demanded", "f8"),  # time since the pedal was pressed, weighted by its position [s]
        ("elapsed", "f8"),  # time since the pedal was pressed [s]
        ("speed", "f8"),  # speed v [m/s]
        ("mean_speed", "f8"),  # speed v, low-passed [m/s]
        ("turn", "f8"),  # magnitude of the yaw rate [rad/s], NaN if unknown
        ("force_x", "f8"),  # low-passed specific force, x [m/s^2]
        ("force_y", "f8"),
        ("slowing", "f8"),  # low-passed decrease of `reach` times `turn` per time [m/s^2]
        ("stalled", "f8"),  # time without much deceleration at the end of the stop [s]
    ]
)

# Share of the initial speed below which a speed is small, and share of the smallest deceleration of
# a braked vehicle below which a deceleration is small [1].
_LITTLE = 0.3


@by_reference
class EffectConstants(NamedTuple):
    """Constants of the effect monitor.

    Attributes:
        roll: speed of the rim along the active direction per wheel speed [m], shape (N,).
        reach: largest speed of a rolling rim per yaw rate [m].
        empty: initial record of the memory, which is copied for a reset, shape (1,).
        allowance: missed distance that is allowed per initial speed, because brakes act with a
            delay [s].
        least_loss: smallest deceleration of a braked vehicle, see `least_loss` [m/s^2].
        share: missed distance that is allowed per braked distance [1].
        creep: missed distance that is always allowed [m].
        loss: assumed deceleration if neither rims nor the specific force measure it [m/s^2].
        force_time: time constant of the low-pass of the specific force [s].
        wheel_time: time constant of the low-pass of the speed [s].
        least: smallest mean deceleration of a complete stop [m/s^2].
        grace: additional time that every stop may take [s].
    """

    roll: FloatArray
    reach: float
    empty: NDArray[np.void]
    allowance: float
    least_loss: float
    share: float = 0.25
    creep: float = 0.1
    loss: float = 6.0
    force_time: float = 0.2
    wheel_time: float = 0.6
    least: float = 1.0
    grace: float = 1.0


def effect_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> EffectConstants:
    """Return the constants of the effect monitor for a configuration and wheel geometry."""
    allowance = 0.15 + configuration.brake.settling_time
    reach, least = float(np.max(np.abs(geometry.lever))), least_loss(geometry.rim.size)
    return EffectConstants(geometry.rim, reach, effect_memory(), allowance, least)


def effect_memory() -> NDArray[np.void]:
    """Return the initial state of the effect monitor, shape (1,)."""
    return np.zeros(1, _LEDGER)


@lean
def watch_effect(
    constants: EffectConstants,
    memory: NDArray[np.void],
    dt: float,
    pedal: float,
    released: bool,
    speeds: FloatArray,
    inertial: FloatArray,
) -> bool:
    """Update the missed and braked distances by one step; return whether all brakes must act.

    Args:
        constants: constants of the vehicle.
        memory: from `effect_memory`, changed in place.
        dt: length of the step [s].
        pedal: the driver's brake demand, 0 while the pedal is up [1].
        released: whether any brake was released during the step.
        speeds: current wheel speeds [rad/s], shape (N,); NaN where unknown.
        inertial: yaw rate [rad/s] and specific force along x and y [m/s^2], shape (3,); NaN where
            unknown.
    """
    turn, force_x, force_y = abs(inertial[0]), inertial[1], inertial[2]
    ledger, top, known = memory[0], 0.0, False
    for i in range(speeds.size):
        rim = abs(constants.roll[i] * speeds[i])
        if math.isfinite(rim):
            top, known = max(top, rim), True
    if pedal <= 0.0:
        memory[0] = constants.empty[0]
        ledger.start = ledger.speed = ledger.mean_speed = top
        ledger.turn = turn
        return False
    ledger.elapsed += dt
    ledger.demanded += pedal * dt
    felt = math.isfinite(force_x + force_y)
    loss = math.hypot(force_x, force_y) if felt else constants.loss
    turned = constants.reach * (ledger.turn - turn)
    turned = turned if math.isfinite(turned) else 0.0
    ledger.turn = turn
    ledger.speed = max(top, ledger.speed - (loss * dt if known else 0.0) - turned, 0.0)
    achieved = _achieved(constants, ledger, dt, pedal, (force_x, force_y, turned))
    length = pedal * ledger.speed * dt
    if released:
        ledger.missed += (1.0 - achieved) * length
    ledger.braked += achieved * length
    stalls = felt and released and achieved < _LITTLE and ledger.speed < _LITTLE * ledger.start
    ledger.stalled = ledger.stalled + dt if stalls else 0.0
    bound = constants.creep + constants.allowance * ledger.start + constants.share * ledger.braked
    late = ledger.demanded > constants.grace + ledger.start / constants.least
    if released and (late or ledger.stalled > constants.force_time or ledger.missed > bound):
        ledger.tripped = True
    return bool(ledger.tripped)


@lean
def _achieved(
    constants: EffectConstants, ledger: Any, dt: float, pedal: float, lost: Triple
) -> float:
    """Return the deceleration divided by the smallest one with working brakes, 0 to 1.

    The module's docstring defines both quantities.

    Args:
        constants: constants of the vehicle.
        ledger: record of the memory, changed in place.
        dt: length of the step [s].
        pedal: the driver's brake demand [1].
        lost: specific force along x and y [m/s^2], NaN where unknown, and decrease of the speed of
            the wheels about their center in this step [m/s].
    """
    force_x, force_y, turned = lost
    felt = math.isfinite(force_x + force_y)
    time = constants.force_time if felt else constants.wheel_time
    follow, settled = 1.0 - math.exp(-dt / time), 1.0 - math.exp(-ledger.elapsed / time)
    ledger.mean_speed += follow * (ledger.speed - ledger.mean_speed)
    loss = (ledger.mean_speed - ledger.speed) / time
    if felt:
        ledger.force_x += follow * (force_x - ledger.force_x)
        ledger.force_y += follow * (force_y - ledger.force_y)
        ledger.slowing += turned / time - follow * ledger.slowing
        loss = math.hypot(ledger.force_x, ledger.force_y) + max(ledger.slowing, 0.0)
    least = constants.least_loss * pedal * settled
    return min(max(loss / least, 0.0), 1.0) if least > 0.0 else 1.0
