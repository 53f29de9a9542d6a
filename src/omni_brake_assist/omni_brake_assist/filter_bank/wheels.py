"""Measurement model of the wheel speeds in the filter bank.

A wheel speed is fused only if the wheel probably rolls. A reading of a faulty encoder is uniformly
distributed over a range of speeds, so that the likelihoods of hypotheses with and without the
encoder are comparable.
"""

import math
from typing import NamedTuple

from omni_brake_assist.filter_bank import filters
from omni_brake_assist.filter_bank import state as bank
from omni_brake_assist.filter_bank.state import RATE, SCALE, U_X, U_Y, BankConstants, BankMemory
from omni_core.kernels import lean
from omni_core.quantities import FloatArray

# The slip of a released wheel only decreases, because friction accelerates its rim. The wheel is
# idle until its rim is faster by _GAIN [m/s] than with the smallest slip so far. An idle wheel
# either rolls, or its brake still acts.
# On ice (friction 0.1, load 2500 N, radius 0.2 m, inertia 1 kg m^2) the speed of a rim rises by
# _GAIN in 0.01 s. The idle time has a Rayleigh distribution. Its mode is _IDLE / sqrt(2) [s] for a
# sliding wheel, because the torques of brake and friction are equal only briefly. A locked wheel
# remains locked until the torque of its brake has fallen below that of friction; for such a wheel,
# _HELD [s] plus the lag that is not configured replaces _IDLE.
_GAIN, _IDLE, _HELD = 0.1, 0.05, 0.03
# Width of the range of readings of a faulty encoder: the width at standstill [m/s], and the
# increase of the width per vehicle speed [1].
_SPEED_RANGE, _SPEED_SHARE = 10.0, 2.0
# Standard deviation of a driven wheel's slip (share of the vehicle's speed) per specific force,
# times the square root of the step: 0.01 s^2/m times sqrt(0.4 s), because the slip is constant over
# about 0.4 s [s^2.5/m].
_SLIP = 0.0063
# Time for which the deviation from rolling that accompanies the acceleration of a rim lasts: the
# tire deflects, and the reading is a mean over a period [s].
_LAG = 0.04


_SHORTEST = 1e-6  # steps between repeated stamps count as this long [s]


class _Wheel(NamedTuple):
    """Model of one wheel in one step.

    Attributes:
        rolls: prior probability that the wheel rolls [1].
        slides: prior probability that the wheel slides without being locked [1].
        locked: likelihood of the reading if the wheel is locked, times the prior probability that
            it is locked [s/m].
        faulty: likelihood of the reading if the encoder is faulty [s/m].
        span: width of the range of readings of a faulty encoder that does not read 0 [m/s].
        variance: variance of the speed of a rolling rim [m^2/s^2].
        excess: amount by which the rim can exceed its rolling speed while the tire springs back
            after the brake has been released, or while a drive pushes the wheel [m/s].
        limit: largest slip of the wheel, as a share of the rim's speed in rolling [1].
    """

    rolls: float
    slides: float
    locked: float
    faulty: float
    span: float
    variance: float
    excess: float
    limit: float


@lean
def fuse_wheels(
    constants: BankConstants,
    memory: BankMemory,
    dt: float,
    pedal: float,
    enable: FloatArray,
    speeds: FloatArray,
    push: float,
) -> None:
    """Correct all filters with the speeds of the wheels that roll.

    A reading is modeled as a mixture of four cases: the wheel rolls; the wheel slides; the wheel is
    locked, which is possible only while the vehicle brakes; or the encoder is faulty. The speed
    of a sliding rim is uniformly distributed: at most as fast as in rolling, or faster while the
    tire springs back after a release or a drive pushes the wheel, and at least as fast as with the
    largest slip. Each hypothesis assumes that at most one encoder is faulty.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, changed in place.
        dt: length of the step [s].
        pedal: the driver's brake demand, 0 to 1; only if it is not 0 can a wheel be locked.
        enable: brake enables [1], shape (N,).
        speeds: wheel speeds [rad/s], shape (N,).
        push: magnitude of the specific force, NaN without an IMU [m/s^2].
    """
    record, dt = memory.record[0], max(dt, _SHORTEST)
    own = bank.WHEEL**2 + _slip(constants, memory, push) ** 2 / dt
    own += record.held * constants.walk**2
    braking = pedal > 0.0
    # Without an estimate, encoders are as probably faulty as under the best hypothesis.
    best = min(record.best, bank.NO_IMU)
    weight = filters.new_information(dt, constants.wheel_correlation_time)
    repeated = braking and _is_repeated(constants, memory, speeds)
    for i in range(speeds.size):
        rim = constants.roll[i] * speeds[i]
        last = memory.rim[i] if math.isfinite(memory.rim[i]) else rim
        load = pedal * enable[i] if enable[i] > bank.RELEASED else 0.0
        _follow_slowest(constants, memory, i, dt, braking, load)
        memory.rim[i], memory.wheel_ratio[i] = rim, math.nan
        memory.released[i] = 0.0 if load > 0.0 else memory.released[i] + dt
        if math.isnan(rim) or repeated:
            continue
        slow = not braking or memory.released[i] < constants.spin_up
        free = max(_rolling_speed(constants, memory, i), _GAIN)
        share = min(abs(rim) / free, 1.0)
        if slow or share > memory.mark[i] + _GAIN / free:
            memory.idle[i], memory.mark[i] = 0.0, share
        memory.idle[i] += dt
        variance = own + (_LAG * (rim - last) / dt) ** 2
        wheel = _mixture(constants, memory, i, dt, load, variance, last)
        faulty = memory.faulty[best, i]
        likelihood = (1.0 - faulty) * (wheel.locked + 1.0 / wheel.span) ** weight
        memory.evidence[bank.NO_ESTIMATE] += math.log(likelihood + faulty * wheel.faulty**weight)
        for k in range(bank.FILTERS):
            _fuse_wheel(constants, memory, i, k, wheel, dt)


@lean
def _is_repeated(constants: BankConstants, memory: BankMemory, speeds: FloatArray) -> bool:
    """Return whether no wheel speed differs from the last reading, although a wheel turns."""
    turns = False
    for i in range(speeds.size):
        rim = constants.roll[i] * speeds[i]
        if math.isfinite(rim) and rim != memory.rim[i]:
            return False
        turns = turns or abs(rim) > 0.0
    return turns


@lean
def _follow_slowest(
    constants: BankConstants, memory: BankMemory, i: int, dt: float, braking: bool, load: float
) -> None:
    """Update the lowest speed of a rim that the torque of its brake permits after the last reading.

    A rim slows down no faster than its brake can stop it without any friction, or than the vehicle.
    The brake is assumed to lag its command when it is released, but not when it is applied.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank with the last reading, changed in place.
        i: index of the wheel.
        dt: length of the step [s].
        braking: whether the pedal is down; otherwise the drives can slow the wheel down.
        load: brake command of the wheel as a share of the largest torque [1].
    """
    memory.pressure[i] = max(load, memory.pressure[i] * math.exp(-dt / constants.spin_up))
    lowest, rim = memory.slowest[i], abs(memory.rim[i])
    if math.isfinite(rim):
        lowest = max(lowest, rim)
    if memory.pressure[i] > 0.0:
        lowest -= constants.drop[i] * memory.pressure[i] * dt
    lowest = min(lowest, _rolling_speed(constants, memory, i))
    memory.slowest[i] = max(lowest, 0.0) if braking else 0.0


@lean
def _rolling_speed(constants: BankConstants, memory: BankMemory, i: int) -> float:
    """Return the speed of the rim of wheel `i` in rolling, according to the best filter [m/s]."""
    state = memory.state[min(memory.record[0].best, bank.NO_IMU)]
    ground = constants.n_x[i] * state[U_X] + constants.n_y[i] * state[U_Y]
    return float(abs(ground + constants.lever[i] * state[RATE]) * (1.0 + state[SCALE]))


@lean
def _slip(constants: BankConstants, memory: BankMemory, push: float) -> float:
    """Return the standard deviation of the slip of driven wheels times sqrt(step) [m/s sqrt(s)].

    In a stop, it is 0 after the clutches of the drives have opened, because no wheel is driven any
    more. The argument `push` is that of `fuse_wheels`.
    """
    # After the clutch has opened, a driven wheel takes as long to roll as a released one.
    if memory.record[0].braked >= constants.spin_up:
        return 0.0
    # All filters use the slip computed from the state of one. If each filter used its own state,
    # the one with the lowest yaw rate would have the smallest variance, and thus the largest
    # likelihood.
    state = memory.state[bank.NO_TWIST]
    _, ground = filters.speeds_of(constants, state)
    return _SLIP * ground * (ground * abs(state[RATE]) if math.isnan(push) else push)


@lean
def _mixture(
    constants: BankConstants,
    memory: BankMemory,
    i: int,
    dt: float,
    load: float,
    variance: float,
    last: float,
) -> _Wheel:
    """Return the model of wheel `i` in this step.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, changed in place.
        i: index of the wheel.
        dt: length of the step [s].
        load: brake command of the wheel as a share of the largest torque, 0 while its brake is
            released [1].
        variance: variance of the speed of the rim if the wheel rolls and its tire does not spring
            back [m^2/s^2].
        last: last speed of the rim along the active direction [m/s].
    """
    span = _SPEED_RANGE + _SPEED_SHARE * math.hypot(memory.twist[0], memory.twist[1])
    standing = math.exp(-0.5 * min((memory.rim[i] / bank.WHEEL) ** 2, filters.GATE))
    standing /= math.sqrt(2.0 * math.pi) * bank.WHEEL
    rolls, slides, excess, locked = 1.0 - bank.PRIOR, bank.PRIOR, 0.0, 0.0
    if memory.record[0].braked > 0.0:
        fresh = min(constants.rebound_time / max(memory.released[i], dt), 1.0)
        variance += (constants.rebound * fresh) ** 2
        excess = 0.0 if load > 0.0 else constants.overshoot * fresh
        if constants.pushes and load > 0.0:  # a drive does not speed up its wheel
            excess = max(abs(last) - _rolling_speed(constants, memory, i), 0.0)
        slides = stays = 0.5 * (1.0 - bank.PRIOR)  # sliding and locked are equally probable
        if memory.released[i] >= constants.spin_up:
            slides *= math.exp(-((memory.idle[i] / _IDLE) ** 2))
            held = _HELD + memory.record[0].lag
            stays *= math.exp(-((memory.idle[i] / held) ** 2))
        rolls, locked = 1.0 - slides - stays, stays * standing
        missing = max(memory.slowest[i] - abs(memory.rim[i]), 0.0)
        possible = math.exp(-0.5 * min((missing / bank.WHEEL) ** 2, filters.GATE))
        slides, locked = slides * possible, locked * possible
    faulty = constants.dead * standing + (1.0 - constants.dead) / span
    limit = 1.0 if constants.pushes else _largest_slip(constants, memory, i, dt, load)
    return _Wheel(rolls, slides, locked, faulty, span, variance, excess, limit)


@lean
def _largest_slip(
    constants: BankConstants, memory: BankMemory, i: int, dt: float, load: float
) -> float:
    """Return the largest slip of a wheel, as a share of the rim's speed in rolling [1].

    While the slip of a wheel changes slowly, the torques of brake and friction are equal. If the
    torque of the brake falls below its largest value, the slip falls at least by the same share,
    because friction is a concave function of the slip. The torque follows the command with a lag,
    so it is between the command and the filtered command.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, changed in place.
        i: index of the wheel.
        dt: length of the step [s].
        load: brake command of the wheel as a share of the largest torque, 0 while its brake is
            released [1].
    """
    ground, rim = _rolling_speed(constants, memory, i), abs(memory.rim[i])
    if load == 0.0 or rim < _GAIN or abs(rim - memory.share[i] * ground) > _GAIN:
        memory.torque[i] = memory.most[i] = 0.0
    memory.share[i] = min(rim / max(ground, _GAIN), 1.0)
    memory.torque[i] += dt / (dt + constants.spin_up) * (load - memory.torque[i])
    least, torque = min(load, memory.torque[i]), max(load, memory.torque[i])
    if least >= memory.most[i]:
        memory.most[i], memory.slip[i] = least, 1.0 - memory.share[i]
    return memory.slip[i] * torque / memory.most[i] if torque < memory.most[i] else 1.0


@lean
def _fuse_wheel(
    constants: BankConstants,
    memory: BankMemory,
    i: int,
    k: int,
    wheel: _Wheel,
    dt: float,
) -> None:
    """Update the evidence of filter `k` and its encoder probability with the speed of wheel `i`.

    If the wheel probably rolls, the filter is also corrected.
    """
    rolls, slides, locked, wrong, _, own, excess, limit = wheel
    h, state, rim = memory.h, memory.state[k], memory.rim[i]
    n_x, n_y, lever = constants.n_x[i], constants.n_y[i], constants.lever[i]
    ground = n_x * state[U_X] + n_y * state[U_Y] + lever * state[RATE]
    factor = 1.0 + state[SCALE]
    h[:] = 0.0
    h[U_X], h[U_Y], h[RATE], h[SCALE] = factor * n_x, factor * n_y, factor * lever, ground
    reading = (bank.SHARE * ground) ** 2
    variance, predicted = own + reading, filters.variance_along(memory.covariance[k], h)
    total = variance + predicted
    innovation = rim - factor * ground
    squared = innovation**2 / total
    rolling = rolls * math.exp(-0.5 * min(squared, filters.GATE)) / math.sqrt(2.0 * math.pi * total)
    # The speed of a sliding rim is uniformly distributed, plus the errors of reading and state.
    behind = excess - (innovation if ground >= 0.0 else -innovation)
    width = max(abs(factor * ground) * limit + excess, bank.WHEEL)
    spread = math.sqrt(2.0 * (bank.WHEEL**2 + reading + predicted))
    inside = math.erf(behind / spread) - math.erf((behind - width) / spread)
    sliding = locked + slides * 0.5 * inside / width
    possible = rolling + sliding
    weight = filters.new_information(dt, constants.wheel_correlation_time)
    faulty = memory.faulty[k, i]
    for other in memory.faulty[k]:
        faulty = min(faulty, bank.PRIOR) if other > faulty else faulty
    # The exponent is the same for both, so that hypotheses are compared together with the faults of
    # encoders that they imply.
    memory.evidence[k] += math.log((1.0 - faulty) * possible**weight + faulty * wrong**weight)
    if (1.0 - faulty) * rolling > 0.5 * ((1.0 - faulty) * possible + faulty * wrong):
        if k == memory.record[0].best:
            memory.wheel_ratio[i] = squared / filters.GATE
        # Driven wheels slip in a turn. They may therefore correct the scale of the wheel radii, but
        # no bias of another sensor. Without a twist, only the wheels can correct the biases.
        first = SCALE if memory.record[0].received else bank.BIAS_RATE
        filters.correct(memory, k, innovation, variance, (first, SCALE))
    # Bayes' rule. A reading that sliding could explain is no evidence that the encoder works.
    odds, faulty = (rolling + min(sliding, wrong)) / wrong, memory.faulty[k, i]
    faulty /= faulty + (1.0 - faulty) * odds**weight
    memory.faulty[k, i] = faulty + constants.transition_rate * dt * (bank.PRIOR - faulty)
