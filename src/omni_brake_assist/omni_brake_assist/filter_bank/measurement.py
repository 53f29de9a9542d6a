"""Measurement models of gyro, twist and braking in the filter bank.

For each source, the functions compute the prediction, the innovation, its variance, the test ratio
(normalized innovation squared divided by `GATE`) and the log-likelihood under each hypothesis about
the faulty source (see `state`). Gyro and twist are fused only if their test ratio is at most 1; the
twist of a vehicle without an IMU is always fused. The module `wheels` fuses the wheel speeds.

A reading of a faulty gyro or twist is modeled as a random walk from the last reading, with steps as
large as the vehicle's motion allows. The likelihoods of hypotheses with and without the source are
thus comparable.
"""

import math

from omni_brake_assist.filter_bank import state as bank
from omni_brake_assist.filter_bank.filters import correct, variance_along
from omni_brake_assist.filter_bank.state import RATE, U_X, U_Y, BankConstants, BankMemory
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

GATE = 30.0
"""Normalized innovation squared above which a reading is rejected (5.5 standard deviations) [1]."""


@lean
def fuse_gyro(constants: BankConstants, memory: BankMemory, dt: float, rate: float) -> None:
    """Correct the filters that use the gyro, and update the likelihoods of all hypotheses.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, changed in place.
        dt: time since the last reading [s].
        rate: yaw rate that the gyro measures [rad/s].
    """
    record, h = memory.record[0], memory.h
    own = constants.gyro**2 + (bank.SHARE * rate) ** 2
    change = rate - record.gyro
    record.gyro = rate
    h[:] = 0.0
    h[RATE] = h[bank.BIAS_RATE] = 1.0
    for k in range(bank.HYPOTHESES):
        uses = k not in (bank.NO_GYRO, bank.NO_IMU, bank.NO_ESTIMATE)
        if uses:
            innovation = rate - memory.state[k, RATE] - memory.state[k, bank.BIAS_RATE]
            total = own + variance_along(memory.covariance[k], h)
        else:
            innovation = change if math.isfinite(change) else 0.0
            total = 2.0 * own + dt * constants.turn**2
        squared = innovation**2 / total
        memory.evidence[k] -= constants.weight * 0.5 * (min(squared, GATE) + math.log(total))
        if uses and squared <= GATE:
            correct(memory, k, innovation, own, (bank.BIAS_RATE, bank.OFFSET))


@lean
def twist_direction(constants: BankConstants, h: FloatArray, j: int) -> None:
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
def _twist_variance(constants: BankConstants, twist: bank.Twist, j: int) -> float:
    """Return the variance of component `j` of a fault-free twist [square of its unit]."""
    value = twist.value
    if j == RATE:
        return float(twist.variance[j] + constants.rate**2 + (bank.SHARE * value[RATE]) ** 2)
    speed2 = value[0] ** 2 + value[1] ** 2
    return float(twist.variance[j] + bank.WHEEL**2 + bank.SHARE**2 * speed2)


@lean
def _twist_error(
    constants: BankConstants, memory: BankMemory, k: int, j: int, dt: float, twist: bank.Twist
) -> tuple[float, float]:
    """Return the innovation of component `j` of a twist under a hypothesis, and its variance.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank; its field `h` is set to the direction of the component.
        k: number of the filter that predicts the component. With NO_ESTIMATE, the prediction is
            the last twist, as for a faulty component.
        j: index of the component.
        dt: time since the last twist [s].
        twist: the twist.
    """
    record, own, value = memory.record[0], _twist_variance(constants, twist, j), twist.value[j]
    if k == bank.NO_ESTIMATE:
        last = record.twist_x if j == 0 else record.twist_y
        last = record.twist_rate if j == RATE else last
        walk = constants.turn if j == RATE else constants.walk
        return value - last, 2.0 * own + dt * walk**2
    twist_direction(constants, memory.h, j)
    innovation = value
    for i in range(memory.h.size):
        innovation -= memory.h[i] * memory.state[k, i]
    return innovation, own + variance_along(memory.covariance[k], memory.h)


@lean
def fuse_twist(constants: BankConstants, memory: BankMemory, dt: float, twist: bank.Twist) -> None:
    """Correct the filters that use the twist, and update the likelihoods of all hypotheses.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, predicted to the time of the twist; changed in place.
        dt: time since the last twist [s].
        twist: the twist.
    """
    record, value = memory.record[0], twist.value
    angle = 0.5 * (record.twist_rate + value[2]) * dt
    c, s = math.cos(angle), math.sin(angle)
    # The last twist, rotated into the body axes at the time of the new one.
    record.twist_x, record.twist_y = (
        c * record.twist_x + s * record.twist_y,
        c * record.twist_y - s * record.twist_x,
    )
    for k in range(bank.HYPOTHESES):
        squared, rejects, logs = 0.0, 0.0, 0.0
        for j in range(3):
            uses = _uses_twist(k, j)
            model = k if uses else bank.NO_ESTIMATE
            innovation, total = _twist_error(constants, memory, model, j, dt, twist)
            squared += innovation**2 / total
            rejects += innovation**2 / total if uses else 0.0
            logs += math.log(total)
            if k == bank.ALL and j >= 1:
                memory.ratio[j - 1] = squared / GATE
        if k == bank.ALL:
            memory.ratio[1] -= memory.ratio[0]
        memory.evidence[k] -= constants.weight * 0.5 * (min(squared, 2.0 * GATE) + logs)
        if rejects <= GATE or not record.equipped:
            for j in range(3):
                if _uses_twist(k, j):
                    innovation, _ = _twist_error(constants, memory, k, j, dt, twist)
                    own = _twist_variance(constants, twist, j)
                    correct(memory, k, innovation, own, (bank.BIAS_RATE, bank.OFFSET))
        elif record.best not in (k, bank.NO_ESTIMATE):
            bank.reset(memory, k, record.best)
    record.twist_x, record.twist_y, record.twist_rate = value[0], value[1], value[2]


@lean
def weigh_braking(constants: BankConstants, memory: BankMemory, now_ns: int, pedal: float) -> None:
    """Reduce the likelihoods of filters whose deceleration in a stop is too small.

    The limit is the deceleration on slippery ground.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, changed in place.
        now_ns: time of validity of the filters [ns].
        pedal: the driver's brake demand, 0 to 1.
    """
    loss = memory.loss
    for row in range(bank.LOSS_STEPS):
        for k in range(bank.FILTERS + 1):
            loss[row, k] = loss[row + 1, k]
    for k in range(bank.FILTERS):
        loss[bank.LOSS_STEPS, k] = math.hypot(memory.state[k, U_X], memory.state[k, U_Y])
    loss[bank.LOSS_STEPS, bank.FILTERS] = float(now_ns)
    time = (loss[bank.LOSS_STEPS, bank.FILTERS] - loss[0, bank.FILTERS]) * 1e-9
    record = memory.record[0]
    if record.braked < time + constants.spin_up or not record.equipped:
        return
    for k in range(bank.FILTERS):
        lost = loss[0, k] - loss[bank.LOSS_STEPS, k]
        least = min(constants.least_loss * pedal * time, 0.5 * loss[0, k])
        missing = max(least - lost, 0.0)
        memory.evidence[k] -= constants.wheel_weight * 0.5 * (missing / bank.WHEEL) ** 2
    memory.evidence[bank.NO_ESTIMATE] -= constants.wheel_weight
