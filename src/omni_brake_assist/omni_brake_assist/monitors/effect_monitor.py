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

With an IMU, ``a`` is the low-passed specific force, without the centripetal acceleration of the IMU
about the center of the wheels, plus the low-passed decrease of the speed of the wheels about their
center. Without an IMU, it is the difference between ``v`` and its low-pass.
The deceleration ``c`` is `least_loss`, scaled by the pedal position. It does not depend on earlier
decelerations in the stop: on ice under one side of the vehicle, the assistant can only keep the
heading with little deceleration, because it has to release brakes on the other side.

On such ice the braked wheels slide. `least_loss` is computed with a share of the wheels that use
all of their friction. With an IMU, ``c`` decreases to the deceleration on ice, as far as the wheels
use this share of their friction. The used share of a wheel's friction is its slip divided by
`target_slip`, at most 1; it is low-passed like the specific force. The velocity that the wheels
have before the stop and the integral of the IMU's readings give the direction of motion. The wheel
with the second smallest slip gives the speed, because one encoder may read too much. A wheel whose
active direction is nearly perpendicular to the motion uses no friction, even if it is locked.

Two more bounds limit how long brakes may be released. The first is the duration of a stop with the
mean deceleration `least`, extended by `grace`. On ice, time counts in proportion to ``c``, and the
stop may last longer if ``v`` has decreased by `least` times this time without `grace`: the specific
force alone, whose bias resembles sliding wheels, extends no stop. The second bound is used only
with an IMU: at the end of a stop, the deceleration may be small for at most the time constant of
the specific force's low-pass. This bound is exceeded in stops in which the braked wheels exert no
force along the motion, because the vehicle moves along their passive direction. Without an IMU, the
end of a stop cannot be recognized, because locked wheels also have slow rims.

After a bound is exceeded, all brakes act until the pedal is released.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.filter_bank.state import LEAST_FRICTION, least_loss
from omni_core.geometry import PlatformGeometry
from omni_core.kernels import by_reference, lean
from omni_core.quantities import GRAVITY, FloatArray, Pair, Triple

_LEDGER = np.dtype(
    [
        ("missed", "f8"),  # missed distance [m]
        ("braked", "f8"),  # braked distance [m]
        ("tripped", "?"),  # whether a bound has been exceeded
        ("start", "f8"),  # speed of the fastest rim when the pedal was pressed [m/s]
        ("demanded", "f8"),  # time since the pedal was pressed, times ``c`` / `least_loss` [s]
        ("elapsed", "f8"),  # time since the pedal was pressed [s]
        ("speed", "f8"),  # speed v [m/s]
        ("mean_speed", "f8"),  # speed v, low-passed [m/s]
        ("turn", "f8"),  # magnitude of the yaw rate [rad/s], NaN if unknown
        ("force_x", "f8"),  # low-passed specific force, x [m/s^2]
        ("force_y", "f8"),
        ("slowing", "f8"),  # low-passed decrease of `reach` times `turn` per time [m/s^2]
        ("used", "f8"),  # low-passed share of the friction that the wheels use [1]
        ("v_x", "f8"),  # velocity before the stop plus its change by the IMU, body frame [m/s]
        ("v_y", "f8"),
        ("stalled", "f8"),  # time without much deceleration at the end of the stop [s]
    ]
)

# Share of the initial speed below which a speed is small, share of the smallest deceleration of a
# braked vehicle below which a deceleration is small, and share of the speed below which its
# component along an active direction is small [1].
_LITTLE = 0.3
_ICE = 0.05 * GRAVITY  # deceleration of a vehicle on wet ice if all wheels slide [m/s^2]


@by_reference
class EffectConstants(NamedTuple):
    """Constants of the effect monitor.

    Attributes:
        roll: speed of the rim along the active direction per wheel speed [m], shape (N,).
        active: speed of each wheel's hub along its active direction per body twist, columns x, y
            [1] and yaw rate [m], shape (N, 3).
        twist: pseudo-inverse of `active`, shape (3, N).
        slip: slip at which a rim uses all of its friction [1], shape (N,).
        sliding: share of the friction of all wheels that `least_loss` assumes [1].
        reach: largest speed of a rolling rim per yaw rate [m].
        imu: position of the IMU relative to the center of the wheels [m], shape (2,).
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
    active: FloatArray
    twist: FloatArray
    slip: FloatArray
    sliding: float
    reach: float
    imu: FloatArray
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
    least = least_loss(geometry.rim.size)
    active = np.column_stack((geometry.active, geometry.lever))
    return EffectConstants(
        roll=geometry.rim,
        active=active,
        twist=np.asarray(np.linalg.pinv(active), dtype=np.float64),
        slip=configuration.allocation.target_slip * geometry.radius / np.abs(geometry.rim),
        sliding=least / LEAST_FRICTION,
        reach=float(np.max(np.abs(geometry.lever))),
        imu=np.array([configuration.imu_x, configuration.imu_y]),
        empty=effect_memory(),
        allowance=0.15 + configuration.brake.settling_time,
        least_loss=least,
    )


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
    rate, force_x, force_y = measured = _at_center(constants, inertial)
    ledger, turn, top, known = memory[0], abs(rate), 0.0, False
    for i in range(speeds.size):
        rim = abs(constants.roll[i] * speeds[i])
        if math.isfinite(rim):
            top, known = max(top, rim), True
    if pedal <= 0.0:
        v_x, v_y = _rolling_velocity(constants, ledger, speeds)
        memory[0] = constants.empty[0]
        ledger.start = ledger.speed = ledger.mean_speed = top
        ledger.turn, ledger.v_x, ledger.v_y = turn, v_x, v_y
        return False
    ledger.elapsed += dt
    felt = math.isfinite(force_x + force_y)
    loss = math.hypot(force_x, force_y) if felt else constants.loss
    turned = constants.reach * (ledger.turn - turn)
    turned = turned if math.isfinite(turned) else 0.0
    ledger.turn = turn
    ledger.speed = max(top, ledger.speed - (loss * dt if known else 0.0) - turned, 0.0)
    _integrate(ledger, dt, measured)
    used = _used_friction(constants, ledger, speeds, rate)
    ledger.used += (1.0 - math.exp(-dt / constants.force_time)) * (used - ledger.used)
    slides = min(ledger.used / constants.sliding, 1.0)
    expected = pedal * constants.least_loss
    expected += slides * min(constants.sliding * _ICE - expected, 0.0)
    ledger.demanded += expected / constants.least_loss * dt
    achieved = _achieved(constants, ledger, dt, expected, (force_x, force_y, turned))
    length = pedal * ledger.speed * dt
    if released:
        ledger.missed += (1.0 - achieved) * length
    ledger.braked += achieved * length
    stalls = felt and released and achieved < _LITTLE and ledger.speed < _LITTLE * ledger.start
    ledger.stalled = ledger.stalled + dt if stalls else 0.0
    bound = constants.creep + constants.allowance * ledger.start + constants.share * ledger.braked
    late = _lasts_too_long(constants, ledger)
    if released and (late or ledger.stalled > constants.force_time or ledger.missed > bound):
        ledger.tripped = True
    return bool(ledger.tripped)


@lean
def _at_center(constants: EffectConstants, inertial: FloatArray) -> Triple:
    """Return readings of the IMU without its centripetal acceleration, if the yaw rate is known."""
    spin = inertial[0] ** 2 if math.isfinite(inertial[0]) else 0.0
    x, y = constants.imu
    return inertial[0], inertial[1] + spin * x, inertial[2] + spin * y


@lean
def _lasts_too_long(constants: EffectConstants, ledger: Any) -> bool:
    """Return whether the stop exceeds its longest duration, which ice may extend."""
    lost = ledger.start - ledger.speed
    usual: bool = ledger.elapsed <= constants.grace + ledger.start / constants.least
    slows: bool = ledger.demanded <= constants.grace + lost / constants.least
    return not (usual or slows)


@lean
def _rolling_velocity(constants: EffectConstants, ledger: Any, speeds: FloatArray) -> Pair:
    """Return the velocity of a vehicle whose wheels roll, body frame [m/s].

    It is the last known one if the speed of a wheel is unknown.
    """
    v_x = v_y = 0.0
    for i in range(speeds.size):
        v_x += constants.twist[0, i] * constants.roll[i] * speeds[i]
        v_y += constants.twist[1, i] * constants.roll[i] * speeds[i]
    return (v_x, v_y) if math.isfinite(v_x + v_y) else (ledger.v_x, ledger.v_y)


@lean
def _integrate(ledger: Any, dt: float, inertial: Triple) -> None:
    """Advance the velocity of the memory by one step with the readings of the IMU, if known."""
    rate, force_x, force_y = inertial
    if not math.isfinite(rate + force_x + force_y):
        return
    c, s = math.cos(rate * dt), math.sin(rate * dt)
    v_x, v_y = ledger.v_x, ledger.v_y
    ledger.v_x = c * v_x + s * v_y + force_x * dt
    ledger.v_y = c * v_y - s * v_x + force_y * dt


@lean
def _used_friction(
    constants: EffectConstants, ledger: Any, speeds: FloatArray, rate: float
) -> float:
    """Return the share of the friction that the wheels use, 0 if it is unknown [1].

    Args:
        constants: constants of the vehicle.
        ledger: record of the memory.
        speeds: current wheel speeds [rad/s], shape (N,); NaN where unknown.
        rate: yaw rate [rad/s], NaN if unknown.
    """
    size = math.hypot(ledger.v_x, ledger.v_y)
    if not size > 0.0:
        return 0.0
    x, y = ledger.v_x / size, ledger.v_y / size
    fastest = speed = used = 0.0
    for i in range(speeds.size):
        n_x, n_y, lever = constants.active[i]
        along = n_x * x + n_y * y
        if abs(along) > _LITTLE and math.isfinite(speeds[i]):
            rolled = (constants.roll[i] * speeds[i] - lever * rate) / along
            fastest, speed = max(fastest, rolled), max(speed, min(fastest, rolled))
    for i in range(speeds.size):
        n_x, n_y, lever = constants.active[i]
        hub = abs((n_x * x + n_y * y) * speed + lever * rate)
        rim = abs(constants.roll[i] * speeds[i])
        if hub > rim and hub > _LITTLE * speed:
            used += (hub - rim) / max(constants.slip[i] * rim, hub - rim)
    return used / speeds.size


@lean
def _achieved(
    constants: EffectConstants, ledger: Any, dt: float, expected: float, lost: Triple
) -> float:
    """Return the deceleration divided by the expected one, 0 to 1.

    The module's docstring defines both quantities.

    Args:
        constants: constants of the vehicle.
        ledger: record of the memory, changed in place.
        dt: length of the step [s].
        expected: smallest deceleration with working brakes [m/s^2].
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
    least = expected * settled
    return min(max(loss / least, 0.0), 1.0) if least > 0.0 else 1.0
