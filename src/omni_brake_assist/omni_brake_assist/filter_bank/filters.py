"""Filters of the bank: prediction with the accelerometer; measurements of gyro, twist and braking.

For each source, the functions compute the prediction, the innovation, its variance, the test ratio
(normalized innovation squared divided by `GATE`) and the log-likelihood under each hypothesis about
the faulty source (see `state`). Gyro and twist are fused only if their test ratio is at most 1; the
twist of a vehicle without an IMU is always fused. The module `wheels` fuses the wheel speeds.

A reading of a faulty gyro or twist is modeled as a random walk from the last reading. The variance
of its steps is the larger of two: what the vehicle's motion allows, and the measured mean square of
the changes of the reading over `WINDOW_NS`. The likelihoods of hypotheses with and without the
source are thus comparable, also if the error changes its sign at every reading.
"""

import math

from omni_brake_assist.filter_bank import state as bank
from omni_brake_assist.filter_bank.state import BIAS_X, BIAS_Y, RATE, STATES, U_X, U_Y
from omni_core.kernels import lean
from omni_core.quantities import FloatArray, Pair
from omni_core.signals import TwistSample

GATE = 30.0
"""Normalized innovation squared above which a reading is rejected (5.5 standard deviations) [1]."""


@lean
def new_information(dt: float, correlation_time: float) -> float:
    """Return the exponent of the likelihood of a reading, at most 1.

    Args:
        dt: time since the last reading [s].
        correlation_time: time over which the errors of the readings are correlated [s].
    """
    return min(dt / correlation_time, 1.0)


@lean
def propagate(state: FloatArray, k: int, dt: float, f_x: float, f_y: float) -> bool:
    """Advance the velocity of a filter with the yaw rate and, if known, the specific force.

    Args:
        state: state of the filter, changed in place, shape (8,).
        k: number of the filter.
        dt: length of the step [s].
        f_x: specific force, x [m/s^2], NaN if unknown.
        f_y: specific force, y [m/s^2], NaN if unknown.

    Returns:
        Whether the filter has used the specific force.
    """
    used = math.isfinite(f_x + f_y) and k not in (bank.NO_FORCE, bank.NO_IMU)
    u_x, u_y, rate = state[U_X], state[U_Y], state[RATE]
    cos, sin = math.cos(rate * dt), math.sin(rate * dt)
    state[U_X], state[U_Y] = cos * u_x + sin * u_y, cos * u_y - sin * u_x
    if used:
        a_x, a_y = f_x - state[BIAS_X], f_y - state[BIAS_Y]
        half_c, half_s = math.cos(0.5 * rate * dt), math.sin(0.5 * rate * dt)
        state[U_X] += dt * (half_c * a_x + half_s * a_y)
        state[U_Y] += dt * (half_c * a_y - half_s * a_x)
    return used


@lean
def predict(
    constants: bank.BankConstants, memory: bank.BankMemory, dt: float, f_x: float, f_y: float
) -> None:
    """Predict all filters over a step, with the specific force where a filter uses it.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, changed in place.
        dt: length of the step [s].
        f_x: specific force, x [m/s^2], NaN if unknown.
        f_y: specific force, y [m/s^2], NaN if unknown.
    """
    for k in range(bank.FILTERS):
        state, covariance = memory.state[k], memory.covariance[k]
        rate = state[RATE]
        used = propagate(state, k, dt, f_x, f_y)
        # Compute only the rows of the Jacobian that differ from the unit matrix.
        cos, sin = math.cos(rate * dt), math.sin(rate * dt)
        t_x, t_y = dt * state[U_Y], -dt * state[U_X]
        bias = -dt if used else 0.0
        for j in range(STATES):
            p_x, p_y, turn = covariance[U_X, j], covariance[U_Y, j], covariance[RATE, j]
            covariance[U_X, j] = cos * p_x + sin * p_y + t_x * turn + bias * covariance[BIAS_X, j]
            covariance[U_Y, j] = cos * p_y - sin * p_x + t_y * turn + bias * covariance[BIAS_Y, j]
        for i in range(STATES):
            p_x, p_y, turn = covariance[i, U_X], covariance[i, U_Y], covariance[i, RATE]
            covariance[i, U_X] = cos * p_x + sin * p_y + t_x * turn + bias * covariance[i, BIAS_X]
            covariance[i, U_Y] = cos * p_y - sin * p_x + t_y * turn + bias * covariance[i, BIAS_Y]
        spread = dt * (constants.force if used else constants.walk) ** 2
        covariance[U_X, U_X] += spread
        covariance[U_Y, U_Y] += spread
        covariance[RATE, RATE] += dt * constants.turn**2
        for j in range(bank.BIAS_RATE, STATES):
            # A vehicle without a twist cannot observe all of these states. The variance therefore
            # approaches its initial value, and does not grow without limit.
            missing = constants.initial[j] ** 2 - covariance[j, j]
            covariance[j, j] += dt * constants.drift**2 * missing


@lean
def variance_along(covariance: FloatArray, h: FloatArray) -> float:
    """Return the variance of the scalar ``h . x`` for a state ``x`` with the given covariance."""
    total = 0.0
    for i in range(STATES):
        if h[i] != 0.0:
            for j in range(STATES):
                if h[j] != 0.0:
                    total += h[i] * covariance[i, j] * h[j]
    return total


@lean
def correct(
    memory: bank.BankMemory, k: int, innovation: float, variance: float, learned: tuple[int, int]
) -> None:
    """Correct the state ``x`` of a filter with a scalar measurement of ``h . x`` (`BankMemory.h`).

    While the pedal is down or a source is faulty, biases, scale and offset are not corrected, but
    their variances are taken into account (Schmidt-Kalman filter). Otherwise a filter could explain
    a fault by a change of these states.

    Args:
        memory: memory of the bank, changed in place.
        k: number of the filter.
        innovation: measurement minus its prediction [unit of the measurement].
        variance: variance of the measurement [square of its unit].
        learned: indices of the first and last of the constant states (biases, scale, offset) that
            the measurement may correct.
    """
    state, covariance, h, gain = memory.state[k], memory.covariance[k], memory.h, memory.gain
    record = memory.record[0]
    learns, (first, last) = record.best == bank.ALL and not record.pressed, learned
    gain[:] = 0.0
    for j in range(STATES):
        if h[j] != 0.0:
            for i in range(STATES):
                gain[i] += covariance[j, i] * h[j]
    total = variance
    for i in range(STATES):
        total += h[i] * gain[i]
    share = 1.0 / total
    for i in range(STATES):
        moves = i <= RATE or (learns and first <= i <= last)
        if moves:
            state[i] += gain[i] * (share * innovation)
        for j in range(STATES):
            if moves or j <= RATE or (learns and first <= j <= last):
                covariance[i, j] -= gain[i] * gain[j] * share


@lean
def _measure_spread(memory: bank.BankMemory, j: int, dt: float, change: float) -> None:
    """Update the mean square of the changes of a reading, `BankMemory.spread`.

    Without an IMU it remains 0, because the input gate then limits the changes of the twist.

    Args:
        memory: memory of the bank, changed in place.
        j: index of the reading in `BankMemory.spread`.
        dt: time since the last reading [s].
        change: newest change of the reading [unit of the reading].
    """
    share = 1.0 - math.exp(-dt * 1e9 / bank.WINDOW_NS) if memory.record[0].equipped else 0.0
    memory.spread[j] += share * (change**2 - memory.spread[j])


@lean
def fuse_gyro(
    constants: bank.BankConstants, memory: bank.BankMemory, dt: float, rate: float
) -> None:
    """Correct the filters that use the gyro, and update the likelihoods of all hypotheses.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, changed in place.
        dt: time since the last reading [s].
        rate: yaw rate that the gyro measures [rad/s].
    """
    record, h = memory.record[0], memory.h
    # On an overloaded computer, the newest reading may be older than a step.
    late = max(record.held - constants.period, 0.0)
    own = constants.rate**2 + (bank.SHARE * rate) ** 2 + late * constants.turn**2
    change = rate - record.gyro if math.isfinite(record.gyro) else 0.0
    weight = new_information(dt, constants.correlation_time)
    _measure_spread(memory, bank.GYRO, dt, change)
    h[:] = 0.0
    h[RATE] = h[bank.BIAS_RATE] = 1.0
    for k in range(bank.HYPOTHESES):
        uses = k not in (bank.NO_GYRO, bank.NO_IMU, bank.NO_ESTIMATE)
        if uses:
            innovation = rate - memory.state[k, RATE] - memory.state[k, bank.BIAS_RATE]
            total = own + variance_along(memory.covariance[k], h)
        else:
            innovation = change
            total = max(2.0 * own + dt * constants.turn**2, memory.spread[bank.GYRO])
        squared = innovation**2 / total
        memory.evidence[k] -= weight * 0.5 * (min(squared, GATE) + math.log(total))
        if uses and squared <= GATE:
            correct(memory, k, innovation, own, (bank.BIAS_RATE, bank.OFFSET))


@lean
def twist_direction(constants: bank.BankConstants, h: FloatArray, j: int) -> None:
    """Write to `h` the direction in the state space that component `j` of the twist measures."""
    h[:] = 0.0
    if j == RATE:
        h[RATE] = h[bank.OFFSET] = 1.0
    else:
        h[j] = 1.0
        h[RATE] = constants.p_y if j == 0 else -constants.p_x


@lean
def _uses_twist(k: int, j: int) -> bool:
    """Return whether component `j` of the twist is fault-free under hypothesis `k`."""
    part = bank.NO_RATE if j == RATE else bank.NO_VELOCITY
    return k not in (bank.NO_TWIST, bank.NO_ESTIMATE, part)


@lean
def _twist_error(
    constants: bank.BankConstants,
    memory: bank.BankMemory,
    k: int,
    j: int,
    dt: float,
    twist: TwistSample,
) -> tuple[float, float, float]:
    """Return the innovation of component `j` of a twist under a hypothesis, and two variances.

    These are the variances of the innovation and of a fault-free component.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank; its field `h` is set to the direction of the component.
        k: number of the hypothesis. Its filter predicts the component; if the component is faulty
            under this hypothesis, the last twist is the prediction.
        j: index of the component.
        dt: time since the last twist [s].
        twist: the twist.
    """
    value, innovation = twist.value, twist.value[j]
    if j == RATE:
        own = twist.covariance[j, j] + constants.rate**2 + (bank.SHARE * innovation) ** 2
    else:
        speed2 = value[0] ** 2 + value[1] ** 2
        own = twist.covariance[j, j] + bank.WHEEL**2 + bank.SHARE**2 * speed2
        own += memory.record[0].held * constants.walk**2
    if not _uses_twist(k, j):
        walk = constants.turn if j == RATE else constants.walk
        steps = max(2.0 * own + dt * walk**2, memory.spread[j])
        return innovation - memory.twist[j], steps, own
    twist_direction(constants, memory.h, j)
    for i in range(memory.h.size):
        innovation -= memory.h[i] * memory.state[k, i]
    return innovation, own + variance_along(memory.covariance[k], memory.h), own


@lean
def fuse_twist(
    constants: bank.BankConstants, memory: bank.BankMemory, dt: float, twist: TwistSample
) -> None:
    """Correct the filters that use the twist, and update the likelihoods of all hypotheses.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, predicted to the time of the twist; changed in place.
        dt: time since the last twist [s].
        twist: the twist.
    """
    record, last = memory.record[0], memory.twist
    weight = new_information(dt, constants.correlation_time)
    angle = 0.5 * (last[RATE] + twist.value[RATE]) * dt
    c, s = math.cos(angle), math.sin(angle)
    # Rotate the last twist into the body axes at the time of the new one.
    last[0], last[1] = c * last[0] + s * last[1], c * last[1] - s * last[0]
    for j in range(last.size):
        _measure_spread(memory, j, dt, twist.value[j] - last[j])
    for k in range(bank.HYPOTHESES):
        squared, rejects, logs = 0.0, 0.0, 0.0
        for j in range(3):
            innovation, total, _ = _twist_error(constants, memory, k, j, dt, twist)
            part = innovation**2 / total
            squared += part
            rejects += part if _uses_twist(k, j) else 0.0
            logs += math.log(total)
            if k == bank.ALL:
                memory.ratio[j] = part / GATE
        memory.evidence[k] -= weight * 0.5 * (min(squared, 2.0 * GATE) + logs)
        if rejects <= GATE or not record.equipped:
            for j in range(3):
                if _uses_twist(k, j):
                    innovation, _, own = _twist_error(constants, memory, k, j, dt, twist)
                    correct(memory, k, innovation, own, (bank.BIAS_RATE, bank.OFFSET))
    for j in range(last.size):
        last[j] = twist.value[j]


@lean
def speeds_of(constants: bank.BankConstants, state: FloatArray) -> Pair:
    """Return the speed of the wheels' center, and the root mean square of the wheels' speeds [m/s].

    Slip of driven wheels depends on the latter, and brakes may slow only the rotation.
    """
    v_x, v_y = state[U_X] + state[RATE] * constants.p_y, state[U_Y] - state[RATE] * constants.p_x
    speed = math.hypot(v_x, v_y)
    return speed, math.hypot(speed, constants.reach * state[RATE])


@lean
def weigh_braking(
    constants: bank.BankConstants, memory: bank.BankMemory, dt: float, pedal: float
) -> None:
    """Reduce the likelihoods of filters whose deceleration in a stop is too small.

    The limit is the deceleration on slippery ground. It holds for the part of the speed that cannot
    be the swing of the vehicle on its tires, whose direction and size change quickly. Either of the
    speeds that `speeds_of` returns must decrease.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, changed in place.
        dt: length of the step [s].
        pedal: the driver's brake demand, 0 to 1.
    """
    record, rows, row = memory.record[0], memory.rows, memory.newest[1]
    first, size, newest = row, rows.size, rows[row]
    while rows[first].stamp_ns > newest.stamp_ns - bank.WINDOW_NS and (first - 1) % size != row:
        first = (first - 1) % size
    weight = new_information(dt, constants.wheel_correlation_time)
    for k in range(bank.FILTERS):
        center, wheels = speeds_of(constants, memory.state[k])
        newest.speed[k, 0] = max(center - constants.swing, 0.0)
        newest.speed[k, 1] = max(wheels - constants.swing, 0.0)
    earlier = rows[first]
    time = (newest.stamp_ns - earlier.stamp_ns) * 1e-9
    if record.braked < time + constants.spin_up or not record.equipped:
        return
    least = constants.least_loss * pedal * time
    for k in range(bank.FILTERS):
        before, now = earlier.speed[k], newest.speed[k]
        slow = min(least, 0.5 * before[0]) - before[0] + now[0]
        missing = max(min(slow, min(least, 0.5 * before[1]) - before[1] + now[1]), 0.0)
        memory.evidence[k] -= weight * 0.5 * (missing / bank.WHEEL) ** 2
    memory.evidence[bank.NO_ESTIMATE] -= weight
