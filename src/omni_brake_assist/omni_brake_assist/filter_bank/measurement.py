"""Measurement sources of the bank.

For each source, the functions compute prediction, innovation, its variance, the test ratio (squared
normalized innovation over its gate) and the log likelihood under each hypothesis. The source is
fused if its test ratio is small enough. A source at fault is modeled as a random walk from its last
reading, with steps as large as a vehicle can move, so that its likelihood under the hypotheses that
exclude it can be compared with the others.
"""

import math
from typing import NamedTuple

from omni_brake_assist.filter_bank.filters import correct, variance_along
from omni_brake_assist.filter_bank.state import (
    ALL,
    BIAS_RATE,
    FASTEST_RIM,
    FILTERS,
    HYPOTHESES,
    LOSS_STEPS,
    NO_ESTIMATE,
    NO_GYRO,
    NO_IMU,
    NO_TWIST,
    OFFSET,
    RATE,
    SCALE,
    U_X,
    U_Y,
    BankConstants,
    BankMemory,
    Twist,
    reset,
)
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

GATE = 30.0
"""Squared normalized innovation above which a reading is rejected: 5.5 standard deviations [1]."""

_DRIVEN = 0.98  # prior probability that a wheel rolls while the pedal is up [1]
_BRAKED = 0.03  # prior probability that a wheel rolls while its brake acts [1]
_RELEASED = 0.5  # prior probability that a wheel rolls after its brake is released [1]
_LET_GO = 0.05  # enable up to which a brake counts as released [1]
# Rim speed [m/s] that a released wheel gains within a time [s]. On ice (friction 0.1, load 2500 N,
# radius 0.2 m, inertia 1 kg m^2) a rim gains it in a fifth of this time.
_GAIN, _IDLE = 0.1, 0.05
_FAULTY = 0.05  # prior probability of a faulty encoder [1]
_SPEED_RANGE, _SPEED_SHARE = 10.0, 2.0  # range of faulty readings: at rest [m/s], per speed [1]
_EDGE = 0.15  # speed by which a sliding rim may be outside rest to rolling [m/s]
# Slip of driven wheels by the specific force [s^2/m], [s^4/m^2], as a share of the vehicle's speed,
# and number of consecutive steps whose readings have the same error by slip.
_SLIP, _SLIP_GROWTH, _SLIP_STEPS = 0.01, 0.002, 40.0
_LEAST_LOSS, _LARGEST_LOSS = 1.5, 15.0  # deceleration of a braked vehicle [m/s^2]
_LOSS_DEVIATION = 0.05  # standard deviation of a loss of speed [m/s]


class _Wheel(NamedTuple):
    """Model of a wheel in a step.

    Attributes:
        rolls: prior probability that the wheel rolls [1].
        faulty: probability that its encoder is faulty [1].
        variance: variance of the speed of a rolling rim [m^2/s^2].
        push: specific force by which the wheels drive the vehicle, NaN where it is not measured
            [m/s^2].
        excess: speed of the rim above rolling after a release, as the tire springs back [m/s].
        span: range of the readings of a faulty encoder [m/s].
    """

    rolls: float
    faulty: float
    variance: float
    push: float
    excess: float
    span: float


@lean
def fuse_gyro(constants: BankConstants, memory: BankMemory, dt: float, rate: float) -> None:
    """Correct the filters that use the gyro by its yaw rate [rad/s]."""
    record, h = memory.record[0], memory.h
    own = constants.gyro**2 + (0.005 * rate) ** 2
    change = rate - record.gyro
    record.gyro = rate
    h[:] = 0.0
    h[RATE] = h[BIAS_RATE] = 1.0
    for k in range(HYPOTHESES):
        uses = k not in (NO_GYRO, NO_IMU, NO_ESTIMATE)
        if uses:
            innovation = rate - memory.state[k, RATE] - memory.state[k, BIAS_RATE]
            total = own + variance_along(memory.covariance[k], h)
        else:
            innovation = change if math.isfinite(change) else 0.0
            total = 2.0 * own + dt * constants.turn**2
        squared = innovation**2 / total
        memory.evidence[k] -= constants.weight * 0.5 * (min(squared, GATE) + math.log(total))
        if uses and squared <= GATE:
            correct(memory, k, innovation, own, (BIAS_RATE, OFFSET))


@lean
def _twist_direction(constants: BankConstants, h: FloatArray, j: int) -> None:
    """Write the direction in the state that a component of the twist measures."""
    h[:] = 0.0
    if j == RATE:
        h[RATE] = h[OFFSET] = 1.0
    else:
        h[j] = 1.0
        h[RATE] = constants.p_y if j == 0 else -constants.p_x


@lean
def _twist_variance(constants: BankConstants, twist: Twist, j: int) -> float:
    """Return the variance of a component of a fault-free twist."""
    value = twist.value
    if j == RATE:
        return float(twist.variance[j] + constants.rate**2 + (0.01 * value[RATE]) ** 2)
    speed2 = value[0] ** 2 + value[1] ** 2
    return float(twist.variance[j] + constants.wheel**2 + constants.share**2 * speed2)


@lean
def _twist_innovation(memory: BankMemory, k: int, reading: float) -> float:
    """Return a reading minus the prediction of a filter, along `BankMemory.h`."""
    innovation = reading
    for i in range(memory.h.size):
        innovation -= memory.h[i] * memory.state[k, i]
    return innovation


@lean
def fuse_twist(constants: BankConstants, memory: BankMemory, dt: float, twist: Twist) -> None:
    """Correct the filters that use the twist.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, at the time of validity of the twist.
        dt: time since the last twist [s].
        twist: the twist.
    """
    record, h, value = memory.record[0], memory.h, twist.value
    angle = 0.5 * (record.twist_rate + value[2]) * dt
    c, s = math.cos(angle), math.sin(angle)
    # The last twist in the body axes at this one.
    record.twist_x, record.twist_y = (
        c * record.twist_x + s * record.twist_y,
        c * record.twist_y - s * record.twist_x,
    )
    for k in range(HYPOTHESES):
        uses = k not in (NO_TWIST, NO_ESTIMATE)
        squared, logs = 0.0, 0.0
        for j in range(3):
            own = _twist_variance(constants, twist, j)
            last = record.twist_x if j == 0 else record.twist_y
            last = record.twist_rate if j == RATE else last
            innovation = value[j] - last
            total = 2.0 * own + dt * (constants.turn if j == RATE else constants.walk) ** 2
            cost = innovation**2 / total + math.log(total)
            # The yaw rate of a faulty twist may still be right.
            if uses or (k == NO_TWIST and j == RATE):
                _twist_direction(constants, h, j)
                misfit = _twist_innovation(memory, k, value[j])
                predicted = own + variance_along(memory.covariance[k], h)
                if uses or misfit**2 / predicted + math.log(predicted) < cost:
                    innovation, total = misfit, predicted
            squared += innovation**2 / total
            logs += math.log(total)
            if k == ALL and j >= 1:
                memory.ratio[j - 1] = squared / GATE
        if k == ALL:
            memory.ratio[1] -= memory.ratio[0]
        memory.evidence[k] -= constants.weight * 0.5 * (min(squared, 2.0 * GATE) + logs)
        if not uses:
            continue
        if squared <= GATE or not record.inertial:
            for j in range(3):
                _twist_direction(constants, h, j)
                innovation = _twist_innovation(memory, k, value[j])
                own = _twist_variance(constants, twist, j)
                correct(memory, k, innovation, own, (BIAS_RATE, OFFSET))
        elif record.best not in (k, NO_ESTIMATE):
            reset(memory, k, record.best)
    record.twist_x, record.twist_y, record.twist_rate = value[0], value[1], value[2]


@lean
def fuse_wheels(
    constants: BankConstants,
    memory: BankMemory,
    dt: float,
    braking: bool,
    enable: FloatArray,
    speeds: FloatArray,
    push: float,
) -> None:
    """Correct all filters by the wheels that roll.

    A reading is a mixture of three cases: the wheel rolls; it slides, at a speed between rest and
    rolling, or a little more while the tire springs back after a release; or its encoder is faulty.
    Only one encoder can be faulty at a time.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank.
        dt: length of the step [s].
        braking: whether the pedal is down.
        enable: enables [1], shape (N,).
        speeds: wheel speeds [rad/s], shape (N,).
        push: magnitude of the specific force, NaN without an IMU [m/s^2].
    """
    suspect = 0
    for i in range(speeds.size):
        suspect = i if memory.faulty[i] > memory.faulty[suspect] else suspect
    released, rolling = False, False
    speed = math.hypot(memory.record[0].twist_x, memory.record[0].twist_y)
    span = _SPEED_RANGE + _SPEED_SHARE * speed
    for i in range(speeds.size):
        rim = constants.roll[i] * speeds[i]
        change = rim - memory.rim[i]
        memory.rim[i] = rim
        memory.wheel_ratio[i] = math.nan
        held = braking and enable[i] > _LET_GO
        memory.released[i] = 0.0 if held else memory.released[i] + dt
        if not abs(rim) < FASTEST_RIM:
            continue
        memory.mark[i] = min(memory.mark[i], abs(rim))
        if held or not braking or abs(rim) > memory.mark[i] + _GAIN:
            memory.idle[i], memory.mark[i] = 0.0, abs(rim)
        memory.idle[i] += dt
        own = constants.wheel**2 + (16.0 * change**2 if math.isfinite(change) else 0.0)
        rolls, excess = _DRIVEN, 0.0
        if braking:
            fresh = min(constants.rebound_time / max(memory.released[i], dt), 1.0)
            own += (constants.rebound * fresh) ** 2
            excess = 0.0 if held else 2.0 * constants.rebound * fresh  # 95 % of its readings
            rolls = _BRAKED
            if memory.released[i] >= constants.spin_up:
                rolls = 1.0 - (1.0 - _RELEASED) * math.exp(-((memory.idle[i] / _IDLE) ** 2))
        faulty = memory.faulty[i] if i == suspect else min(memory.faulty[i], _FAULTY)
        memory.evidence[NO_ESTIMATE] -= constants.wheel_weight * math.log(span)
        wheel, odds = _Wheel(rolls, faulty, own, 0.0 if braking else push, excess, span), 1.0
        for k in range(FILTERS):
            possible = _fuse_wheel(constants, memory, i, k, wheel)
            if k == memory.record[0].best:
                odds = (possible * span) ** constants.weight
        _judge_encoder(constants, memory, i, odds)
        released = released or not held
        rolling = rolling or math.isfinite(memory.wheel_ratio[i])
    record = memory.record[0]
    record.unsupported += dt if braking and released else 0.0
    if rolling:
        record.unsupported = 0.0


@lean
def _fuse_wheel(
    constants: BankConstants, memory: BankMemory, i: int, k: int, wheel: _Wheel
) -> float:
    """Correct a filter by a wheel; return the likelihood of a fault-free encoder [s/m]."""
    rolls, faulty, own, push, excess, span = wheel
    h, state, rim = memory.h, memory.state[k], memory.rim[i]
    n_x, n_y, lever = constants.n_x[i], constants.n_y[i], constants.lever[i]
    ground = n_x * state[U_X] + n_y * state[U_Y] + lever * state[RATE]
    factor = 1.0 + state[SCALE]
    h[:] = 0.0
    h[U_X], h[U_Y], h[RATE], h[SCALE] = factor * n_x, factor * n_y, factor * lever, ground
    speed = math.hypot(state[U_X], state[U_Y])
    if math.isnan(push):
        push = speed * abs(state[RATE])  # of a turn
    slip = math.sqrt(_SLIP_STEPS) * (_SLIP + _SLIP_GROWTH * push) * push
    variance = own + (constants.share * ground) ** 2 + (slip * speed) ** 2
    predicted = variance_along(memory.covariance[k], h)
    total = variance + predicted
    innovation = rim - factor * ground
    squared = innovation**2 / total
    rolling = rolls * math.exp(-0.5 * min(squared, GATE)) / math.sqrt(2.0 * math.pi * total)
    edge = _EDGE + math.sqrt(predicted)
    fast, turns = (ground, rim) if ground >= 0.0 else (-ground, -rim)
    most = fast + edge + excess
    sliding = (1.0 - rolls) / (most + edge) if -edge <= turns <= most else 0.0
    possible = rolling + sliding
    likelihood = (1.0 - faulty) * possible + faulty / span
    memory.evidence[k] += constants.wheel_weight * math.log(likelihood)
    if (1.0 - faulty) * rolling > 0.5 * likelihood:
        if k == memory.record[0].best:
            memory.wheel_ratio[i] = squared / GATE
        # Driven wheels slip in a turn, so they must not correct the biases of other sensors.
        correct(memory, k, innovation, variance, (SCALE, SCALE))
    # A reading that could be a slide does not prove that the encoder works.
    return rolling + min(sliding, 1.0 / span)


@lean
def _judge_encoder(constants: BankConstants, memory: BankMemory, i: int, odds: float) -> None:
    """Update the probability that an encoder is faulty by Bayes' rule."""
    faulty = memory.faulty[i]
    faulty /= faulty + (1.0 - faulty) * odds
    memory.faulty[i] = faulty + constants.transition * (_FAULTY - faulty)


@lean
def weigh_braking(constants: BankConstants, memory: BankMemory, now_ns: int, pedal: float) -> None:
    """Compare the loss of speed in each filter with what brakes and tires allow."""
    loss = memory.loss
    for row in range(LOSS_STEPS):
        for k in range(FILTERS + 1):
            loss[row, k] = loss[row + 1, k]
    for k in range(FILTERS):
        loss[LOSS_STEPS, k] = math.hypot(memory.state[k, U_X], memory.state[k, U_Y])
    loss[LOSS_STEPS, FILTERS] = float(now_ns)
    time = (loss[LOSS_STEPS, FILTERS] - loss[0, FILTERS]) * 1e-9
    record = memory.record[0]
    if record.braked < time + constants.spin_up or not record.inertial:
        return
    for k in range(FILTERS):
        lost = loss[0, k] - loss[LOSS_STEPS, k]
        least = min(_LEAST_LOSS * pedal * time, 0.5 * loss[0, k])
        off = max(least - lost, 0.0) + max(lost - _LARGEST_LOSS * time, 0.0)
        squared = min((off / _LOSS_DEVIATION) ** 2, 5.0 * GATE)
        memory.evidence[k] -= constants.wheel_weight * 0.5 * squared
    memory.evidence[NO_ESTIMATE] -= constants.wheel_weight
