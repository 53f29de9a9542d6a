"""Update of the filters by the wheels that roll: one component of the motion each."""

from __future__ import annotations

import math
from typing import NamedTuple

from omni_brake_assist.observer.filters import Filter, correct, spread
from omni_brake_assist.observer.state import (
    ALL,
    ALONE,
    BIAS_X,
    BIAS_Y,
    FILTERS,
    GYRO,
    HISTORY,
    LARGEST_FORCE,
    NO_TWIST,
    PATH,
    RATE,
    READINGS,
    U_X,
    U_Y,
    WHEEL_GATE,
    Brakes,
    ObserverConstants,
    ObserverMemory,
    PassedTwist,
    Sensed,
)
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_FADE = 0.96  # of evidence, per step
_LARGEST_SCALE = 0.03  # error of wheel radii that is learned [1]
_FASTEST_RIM = 200.0  # [m/s]
_GAIN_FADE = 0.7  # of what a rim has gained, per step
_LARGEST_GAIN = 0.2  # of a rim in a step that counts [m/s]
_SLID_MEMORY = 1.0  # for how long what a driven wheel has slid counts [s]
_OFF_SHARE = 0.1  # of a new twist in how far a rim is off
# Slip of driven wheels by acceleration [s^2/m], [s^4/m^2]; all readings of the last steps share it.
_SLIP, _SLIP_GROWTH, _SLIP_SHARED = 0.01, 0.002, 40.0


class _RollingWheel(NamedTuple):
    """Measurement by a rolling wheel: ``h . x`` is `rim` [m/s], with a variance."""

    h: FloatArray
    rim: float
    variance: float


@lean
def update_by_wheels(
    constants: ObserverConstants,
    memory: ObserverMemory,
    dt: float,
    brakes: Brakes,
    sensed: Sensed,
    twist: PassedTwist,
) -> None:
    """Find the wheels that roll, add up their innovations, and correct the filters by them."""
    braking, enable = brakes
    speeds = sensed.speeds
    h, innovations, spreads = (
        memory.workspace.h,
        memory.workspace.innovation,
        memory.workspace.spread,
    )
    h[:] = 0.0
    memory.wheel_ratio[:] = math.nan
    for k in range(FILTERS):
        memory.score[k] *= _FADE
    memory.score[READINGS] *= _FADE
    slip = 0.0 if braking else _SLIP_SHARED * driven_slip(memory, sensed.inertial) ** 2
    _notice_slides(constants, memory, dt, braking, sensed, twist)
    inertial = (
        memory.isolation[0].inertial != 0.0
    )  # without, wheels are all that contradicts a twist
    for i in range(speeds.size):
        rim = constants.roll[i] * speeds[i] / (1.0 + memory.isolation[0].scale)
        before, memory.rim[i] = memory.rim[i], rim
        h[U_X], h[U_Y], h[RATE] = constants.n_x[i], constants.n_y[i], constants.lever[i]
        spins_up = _gain_of(memory, i, h, rim - before, dt) > constants.spinning
        held = braking and enable[i] > 0.0
        memory.released[i] = 0.0 if held else memory.released[i] + dt
        limit = 8.0 * dt + 2.0 * constants.wheel
        rolls = (
            not held
            and memory.released[i] >= constants.spin_up
            and abs(rim) < _FASTEST_RIM
            and abs(rim - before) <= limit
            and not (braking and (abs(rim) < 0.1 or (inertial and spins_up)))
        )
        if not rolls:
            continue
        # A wheel that still spins up is slower than it will be by some of its changes.
        own = constants.wheel**2 + (constants.scale**2 + slip) * rim**2 + 16.0 * (rim - before) ** 2
        own += min(abs(memory.slid[i]), abs(memory.off[i])) ** 2
        blind = own + 0.05**2
        if braking:
            fresh = min(constants.rebound_time / memory.released[i], 1.0)
            own += (constants.rebound * fresh) ** 2
            blind += (constants.blind_rebound * fresh) ** 2
        for k in range(FILTERS):
            state = memory.state[k]
            predicted = h[0] * state[0] + h[1] * state[1] + h[2] * state[2]
            innovations[k] = rim - predicted
            spreads[k] = spread(memory.covariance[k], h) + own
            memory.score[k] += min(innovations[k] ** 2 / own, 25.0)
        memory.score[READINGS] += 1.0
        memory.wheel_ratio[i] = innovations[ALL] ** 2 / (WHEEL_GATE * spreads[ALL])
        if twist.received:
            _compare_twist(constants, memory, braking, _RollingWheel(h, rim, blind), twist)
        for k in range(FILTERS):
            misfit = innovations[k] ** 2 / spreads[k]
            if misfit <= WHEEL_GATE:
                filtered = Filter(memory.state[k], memory.covariance[k])
                correct(filtered, h, innovations[k], own, memory.workspace.gain)


@lean
def _gain_of(memory: ObserverMemory, i: int, h: FloatArray, gained: float, dt: float) -> float:
    """Return the recent increase of a rim's speed beyond that of the vehicle's motion.

    Braking takes speed from a wheel that rolls. On ice one spins up so slowly that no single step
    shows it.
    """
    state, row = memory.state[ALL], (memory.newest[0] - 1) % HISTORY
    turned = h[U_X] * state[U_Y] - h[U_Y] * state[U_X]
    explained = turned * state[RATE] * dt + h[RATE] * (state[RATE] - memory.past[row, ALL, RATE])
    gain = gained - explained if memory.rim[i] >= 0.0 else explained - gained
    if not abs(gain) < _LARGEST_GAIN:
        gain = _LARGEST_GAIN  # a rim that was not known, or has just been let go
    memory.gain[i] = max(_GAIN_FADE * memory.gain[i] + gain, 0.0)
    return float(memory.gain[i])


@lean
def _notice_slides(
    constants: ObserverConstants,
    memory: ObserverMemory,
    dt: float,
    braking: bool,
    sensed: Sensed,
    twist: PassedTwist,
) -> None:
    """Accumulate how much faster driven rims become than rotation and specific force explain.

    Where tires cannot hold a turn or bear a push, rims keep what the drive wants and the vehicle
    does not. It turns as rims and gyro say, for who else is right is not known. A wheel is rejected
    by as much as accelerometer and twist both say that it slips.
    """
    if braking:
        memory.slid[:] = memory.off[:] = 0.0
        return
    value = twist.value
    f_x, f_y = sensed.inertial[1], sensed.inertial[2]
    state, row = memory.state[NO_TWIST], (memory.newest[0] - 1) % HISTORY
    a_x, a_y = f_x - state[BIAS_X], f_y - state[BIAS_Y]
    felt = abs(f_x) < LARGEST_FORCE and abs(f_y) < LARGEST_FORCE
    rate = memory.state[PATH, GYRO]
    gained = rate - memory.past[row, PATH, GYRO]
    keep, scale = math.exp(-dt / _SLID_MEMORY), 1.0 + memory.isolation[0].scale
    u_x = u_y = 0.0
    for i in range(sensed.speeds.size):
        rim = constants.roll[i] * sensed.speeds[i] / scale
        u_x += constants.inverse[0, i] * rim
        u_y += constants.inverse[1, i] * rim
    for i in range(sensed.speeds.size):
        n_x, n_y = constants.n_x[i], constants.n_y[i]
        rim = constants.roll[i] * sensed.speeds[i] / scale
        lever = constants.lever[i] + n_y * constants.p_x - n_x * constants.p_y  # of base_link
        misfit = rim - n_x * value[0] - n_y * value[1] - lever * value[2]
        if twist.received and math.isfinite(misfit):
            memory.off[i] += _OFF_SHARE * (misfit - memory.off[i])
        excess = rim - memory.rim[i]
        excess -= (n_x * u_y - n_y * u_x) * rate * dt + constants.lever[i] * gained
        excess -= dt * (n_x * a_x + n_y * a_y)
        added = excess if felt and math.isfinite(excess) else 0.0
        memory.slid[i] = keep * memory.slid[i] + added


@lean
def driven_slip(memory: ObserverMemory, inertial: FloatArray) -> float:
    """Return the possible slip of driven wheels in a turn while the pedal is up [1].

    The harder they push, the more; specific force and turning must both say that they do.
    """
    f_x, f_y = inertial[1], inertial[2]
    if not (abs(f_x) < LARGEST_FORCE and abs(f_y) < LARGEST_FORCE):
        return 0.0
    state = memory.state[ALL]
    turning = abs(state[RATE]) * math.hypot(state[U_X], state[U_Y])
    push = min(turning, math.hypot(f_x - state[BIAS_X], f_y - state[BIAS_Y]))
    return float(_SLIP * push + _SLIP_GROWTH * push * push)


@lean
def _compare_twist(
    constants: ObserverConstants,
    memory: ObserverMemory,
    braking: bool,
    wheel: _RollingWheel,
    passed: PassedTwist,
) -> None:
    """Compare the twist with a rolling wheel; estimate the radius error while the pedal is up."""
    h, rim, spread = wheel
    twist, variance = passed.value, passed.variance
    # The twist of base_link at the wheel.
    place = (h[RATE] + h[U_Y] * constants.p_x - h[U_X] * constants.p_y) * twist[2]
    misfit = rim - h[U_X] * twist[0] - h[U_Y] * twist[1] - place
    if not braking and abs(rim) > 0.5:
        error = misfit / (rim - misfit) if rim != misfit else 0.0
        if abs(error) < _LARGEST_SCALE:
            scale = memory.isolation[0].scale + 0.02 * error
            memory.isolation[0].scale = min(max(scale, -_LARGEST_SCALE), _LARGEST_SCALE)
    total = spread
    for j in range(3):
        total += 4.0 * h[j] ** 2 * variance[j]
    memory.score[ALONE] = 0.9 * memory.score[ALONE] + min(misfit**2 / total, 25.0)
