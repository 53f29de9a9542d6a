"""One step of the filter bank at the stamp of the twist, and prediction to the present time."""

import math

from omni_brake_assist.filter_bank import filters
from omni_brake_assist.filter_bank import state as bank
from omni_brake_assist.filter_bank.state import RATE, STATES, U_X, U_Y, BankConstants, BankMemory
from omni_brake_assist.filter_bank.wheels import fuse_wheels
from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_core.signals import VALID, TwistSample


@lean
def estimate(
    constants: BankConstants,
    memory: BankMemory,
    now_ns: int,
    readings: bank.Readings,
    twist: TwistSample,
    answer: FloatArray,
) -> int:
    """Advance the filter bank by one step, and estimate the present twist.

    Args:
        constants: constants of the vehicle.
        memory: memory of the filter bank, changed in place.
        now_ns: time of validity of the readings [ns].
        readings: pedal, enables and readings of this step.
        twist: latest received twist.
        answer: output, the twist at the present time [m/s, m/s, rad/s], shape (3,).

    Returns:
        Number of the most probable hypothesis, whose filter gave the estimate, or NO_ESTIMATE.
    """
    record = memory.record[0]
    elapsed = (now_ns - memory.rows[memory.newest[0]].stamp_ns) * 1e-9
    braking = readings.pedal > 0.0
    received = twist.validity == VALID
    first = received and _is_first(memory, readings, braking)
    if first or not record.begun or not 0.0 <= elapsed <= constants.longest:
        if braking and not received:  # the wheels may slide
            record.begun = False
            return bank.NO_ESTIMATE
        bank.begin(constants, memory, now_ns, twist)
        elapsed = 0.0
    if record.pressed and not braking:  # the next stop begins with the priors
        bank.reset_posterior(constants, memory)
    record.pressed = braking
    memory.evidence[:], record.lag = 0.0, readings.lag
    _store(constants, memory, now_ns, readings)
    valid_ns = twist.stamp_ns - constants.delay
    fresh = received and valid_ns > record.twist_ns
    target_ns = max(record.horizon_ns, now_ns - (constants.twist_wait if record.received else 0))
    _advance(constants, memory, max(target_ns, valid_ns) if fresh else target_ns)
    if fresh:
        filters.fuse_twist(constants, memory, (valid_ns - record.twist_ns) * 1e-9, twist)
        record.twist_ns, record.received, record.kept = valid_ns, True, bank.NO_ESTIMATE
    if record.known:
        _update_posterior(constants, memory, elapsed)
    record.known = record.known or fresh
    if record.best != bank.NO_ESTIMATE:
        _mix(memory, record.best, braking, min(elapsed * 1e9 / bank.WINDOW_NS, 1.0))
    if _is_lost(memory):
        return bank.NO_ESTIMATE
    if not record.equipped:
        return bank.ALL
    best = int(_answer(constants, memory, record.best, answer))
    record.known = record.known or best != bank.NO_ESTIMATE
    if fresh and valid_ns == now_ns:
        _keep_precise(constants, memory, best, twist, answer)
    _add_precise(constants, memory, now_ns, best, answer)
    return best


@lean
def _is_first(memory: BankMemory, readings: bank.Readings, braking: bool) -> bool:
    """Return whether a received twist initializes the filters.

    It does if it is the first one while the pedal is up, or if readings that turn out to be stuck
    may have isolated it.
    """
    record = memory.record[0]
    rejected = record.best in (*bank.TWIST_FAULTS, bank.NO_ESTIMATE)
    first = not (record.received or braking)
    return bool(first or (readings.stuck and record.equipped and rejected))


@lean
def _add_precise(
    constants: BankConstants, memory: BankMemory, now_ns: int, best: int, answer: FloatArray
) -> None:
    """Add the difference that `_keep_precise` has stored, while it is recent.

    The arguments are those of `estimate`; `best` is its result. The difference belongs to one
    hypothesis.
    """
    record = memory.record[0]
    if best == record.kept and now_ns - record.twist_ns <= constants.twist_wait:
        for j in range(answer.size):
            answer[j] += memory.precise[j]


@lean
def _store(
    constants: BankConstants, memory: BankMemory, now_ns: int, readings: bank.Readings
) -> None:
    """Store the readings of this step in the ring buffer `memory.rows`.

    The buffer is full if the steps are shorter than the control period. The filters then use the
    oldest readings before these are overwritten, and wait less for a late twist.
    """
    size = memory.rows.size
    row = (memory.newest[0] + 1) % size
    if row == memory.newest[1]:
        _advance(constants, memory, memory.rows[(row + 1) % size].stamp_ns)
    memory.newest[0], stored = row, memory.rows[row]
    stored.stamp_ns, stored.pedal = now_ns, readings.pedal
    stored.fresh, stored.age = readings.fresh, readings.age
    for j in range(3):
        stored.inertial[j] = readings.inertial[j]
    for i in range(readings.speeds.size):
        memory.wheel_rows[row, 0, i] = readings.speeds[i]
        memory.wheel_rows[row, 1, i] = readings.enable[i]


@lean
def _advance(constants: BankConstants, memory: BankMemory, target_ns: int) -> None:
    """Predict the filters to a given time, and correct them with all readings up to that time."""
    record, size = memory.record[0], memory.rows.size
    while record.horizon_ns < target_ns and memory.newest[1] != memory.newest[0]:
        before_ns, row = memory.rows[memory.newest[1]].stamp_ns, (memory.newest[1] + 1) % size
        reading = memory.rows[row]
        stamp_ns, pedal, (rate, f_x, f_y) = reading.stamp_ns, reading.pedal, reading.inertial
        until_ns = min(stamp_ns, target_ns)
        dt = (until_ns - record.horizon_ns) * 1e-9
        step = constants.period if before_ns < 0 else (stamp_ns - before_ns) * 1e-9
        if stamp_ns > target_ns:  # the time of the twist is between two readings
            share = (until_ns - record.horizon_ns) / (stamp_ns - record.horizon_ns)
            rate = record.gyro + share * (rate - record.gyro)
        filters.predict(constants, memory, dt, f_x, f_y)
        record.horizon_ns = until_ns
        record.unmeasured += dt
        record.inertial = math.isfinite(rate + f_x + f_y)
        record.equipped = record.equipped or record.inertial
        record.held = reading.age if record.inertial else 0.0
        if math.isfinite(rate) and reading.fresh:
            # A reading that equals the last one in a stop is no evidence, but remains the best one.
            new = not (pedal > 0.0 and rate == record.gyro != 0.0)
            filters.fuse_gyro(constants, memory, record.unmeasured if new else 0.0, rate)
            record.unmeasured = 0.0 if new else record.unmeasured
        record.gyro = rate
        if stamp_ns > target_ns:
            return
        memory.newest[1] = row
        record.braked = record.braked + step if pedal > 0.0 else 0.0
        speeds, enable = memory.wheel_rows[row, 0], memory.wheel_rows[row, 1]
        fuse_wheels(constants, memory, step, pedal, enable, speeds, math.hypot(f_x, f_y))
        filters.weigh_braking(constants, memory, step, pedal)


@lean
def _is_lost(memory: BankMemory) -> bool:
    """Return whether too few working sources remain to determine the motion.

    If fewer than two encoders appear fault-free, the estimate itself must be wrong, because several
    encoders do not fail at the same time. If the twist or a part of it is isolated, or no twist has
    been received, the IMU must measure the motion.
    """
    record, left = memory.record[0], 0
    for probability in memory.faulty[record.best]:
        left += 1 if probability <= bank.FAULTY else 0
    without = record.best in bank.TWIST_FAULTS or not record.received
    without = without and not record.inertial
    return bool(record.best == bank.NO_ESTIMATE or without or (left < 2 and record.pressed))


@lean
def _update_posterior(constants: BankConstants, memory: BankMemory, dt: float) -> None:
    """Update the probabilities of the hypotheses by Bayes' rule, and select a hypothesis.

    The argument `dt` is the time since the previous update [s].
    """
    record, posterior, largest = memory.record[0], memory.posterior, -math.inf
    if record.pressed and _is_lost(memory):
        return  # all brakes act until the pedal is released
    for k in range(bank.HYPOTHESES):
        posterior[k] += memory.evidence[k]
        if not record.equipped and k in (bank.NO_GYRO, bank.NO_FORCE, bank.NO_IMU):
            posterior[k] = -1e3
        largest = max(largest, posterior[k])
    total = 0.0
    for k in range(bank.HYPOTHESES):
        total += math.exp(posterior[k] - largest)
    at_best = 0.0
    for k in range(bank.HYPOTHESES):
        probability = math.exp(posterior[k] - largest) / total
        probability += constants.transition_rate * dt * (constants.prior[k] - probability)
        posterior[k] = math.log(probability)
        if probability > at_best:
            record.best, at_best = k, probability


@lean
def _mix(memory: BankMemory, best: int, braking: bool, weight: float) -> None:
    """Mix the filter of all sources, and with the pedal up every filter, with the best filter.

    In the mean and in the covariance of the mixture, the filter `best` has the given weight. An
    isolated source that recovers thus agrees with the filter of all sources, and no filter drifts
    while the pedal is up.
    """
    there, p_there = memory.state[best], memory.covariance[best]
    for k in range(bank.ALL + 1 if braking else bank.FILTERS):
        here, p_here = memory.state[k], memory.covariance[k]
        for i in range(STATES):
            for j in range(STATES):
                apart = (1.0 - weight) * (there[i] - here[i]) * (there[j] - here[j])
                p_here[i, j] += weight * (p_there[i, j] - p_here[i, j] + apart)
        for i in range(STATES):
            here[i] += weight * (there[i] - here[i])
        for i in range(memory.rim.size):
            memory.faulty[k, i] += weight * (memory.faulty[best, i] - memory.faulty[k, i])


@lean
def _keep_precise(
    constants: BankConstants, memory: BankMemory, best: int, twist: TwistSample, answer: FloatArray
) -> None:
    """Store the differences of the received twist from `answer` where it has a smaller variance.

    A precise twist is better used directly, because the filter would only add its model errors.
    Until the next twist, the IMU predicts the twist, so that the estimate does not alternate
    between twist and filter. A twist is used only if its innovations are no larger than expected:
    the mean of their normalized squares must be at most 1. The estimated offset of the yaw rate
    counts as part of the twist's error. Both variances describe the motion of the wheels' center.
    """
    agrees = filters.GATE * (memory.ratio[0] + memory.ratio[1] + memory.ratio[RATE]) <= answer.size
    if best not in bank.TWIST_FAULTS and best != bank.NO_ESTIMATE and agrees:
        covariance, h, record = memory.covariance[best], memory.h, memory.record[0]
        for j in range(answer.size):
            offset = memory.state[best, bank.OFFSET] if j == RATE else 0.0
            filters.twist_direction(constants, h, j)
            h[bank.OFFSET] = 0.0
            own = twist.covariance[j, j] + offset**2
            own -= 0.0 if j == RATE else record.held * constants.walk**2
            precise = own < filters.variance_along(covariance, h)
            memory.precise[j] = twist.value[j] - answer[j] if precise else 0.0
        record.kept = best


@lean
def _answer(constants: BankConstants, memory: BankMemory, best: int, answer: FloatArray) -> int:
    """Predict the best estimate to the present time, and write the twist to `answer`.

    Returns:
        `best`, or NO_ESTIMATE if the estimate is too uncertain.
    """
    covariance, record, state = memory.covariance[best], memory.record[0], memory.gain
    for i in range(STATES):
        state[i] = memory.state[best, i]
    row, before_ns = memory.newest[1], record.horizon_ns
    while row != memory.newest[0]:
        row = (row + 1) % memory.rows.size
        reading = memory.rows[row]
        dt, before_ns = (reading.stamp_ns - before_ns) * 1e-9, reading.stamp_ns
        gyro = reading.inertial[0]
        if best not in (bank.NO_GYRO, bank.NO_IMU) and math.isfinite(gyro):
            state[RATE] = gyro - state[bank.BIAS_RATE]
        filters.propagate(state, best, dt, reading.inertial[1], reading.inertial[2])
    answer[0] = state[U_X] + state[RATE] * constants.p_y
    answer[1] = state[U_Y] - state[RATE] * constants.p_x
    answer[2] = state[RATE]
    spread = max(covariance[U_X, U_X], covariance[U_Y, U_Y])
    held = record.held * constants.turn**2  # until the next reading
    valid = (
        spread <= constants.velocity_deviation**2
        and covariance[RATE, RATE] - held <= constants.rate_deviation**2
        and math.isfinite(answer[0] + answer[1] + answer[2])
    )
    return best if valid else bank.NO_ESTIMATE
