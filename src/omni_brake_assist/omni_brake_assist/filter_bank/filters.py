"""Prediction of the bank's filters with the accelerometer, and correction with a measurement."""

import math

from omni_brake_assist.filter_bank import state as bank
from omni_brake_assist.filter_bank.state import BIAS_X, BIAS_Y, RATE, STATES, U_X, U_Y
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray


@lean
def propagate(state: FloatArray, rate: float, dt: float, force: tuple[bool, float, float]) -> None:
    """Advance the velocity of a filter with the yaw rate and, if valid, the specific force.

    Args:
        state: state of a filter, changed in place, shape (8,).
        rate: yaw rate [rad/s].
        dt: length of the step [s].
        force: whether the specific force is valid, and its components along x and y [m/s^2].
    """
    known, f_x, f_y = force
    u_x, u_y = state[U_X], state[U_Y]
    cos, sin = math.cos(rate * dt), math.sin(rate * dt)
    state[U_X], state[U_Y] = cos * u_x + sin * u_y, cos * u_y - sin * u_x
    if known:
        a_x, a_y = f_x - state[BIAS_X], f_y - state[BIAS_Y]
        half_c, half_s = math.cos(0.5 * rate * dt), math.sin(0.5 * rate * dt)
        state[U_X] += dt * (half_c * a_x + half_s * a_y)
        state[U_Y] += dt * (half_c * a_y - half_s * a_x)


@lean
def predict(
    constants: bank.BankConstants,
    memory: bank.BankMemory,
    dt: float,
    force: tuple[bool, float, float],
    braking: bool,
) -> None:
    """Predict all filters over a step, with the specific force where a filter uses it.

    Args:
        constants: constants of the vehicle.
        memory: memory of the bank, changed in place.
        dt: length of the step [s].
        force: whether the specific force is valid, and its components along x and y [m/s^2].
        braking: whether the pedal is down. While it is up, the variances of the constant states
            (biases, scale, offset) approach their initial values.
    """
    product = memory.product
    for k in range(bank.FILTERS):
        state, covariance = memory.state[k], memory.covariance[k]
        used = force[0] and k not in (bank.NO_FORCE, bank.NO_IMU)
        rate = state[RATE]
        propagate(state, rate, dt, (used, force[1], force[2]))
        # Compute only the rows of the Jacobian that differ from the unit matrix.
        cos, sin = math.cos(rate * dt), math.sin(rate * dt)
        t_x, t_y = dt * state[U_Y], -dt * state[U_X]
        bias = -dt if used else 0.0
        for j in range(STATES):
            p_x, p_y, turn = covariance[U_X, j], covariance[U_Y, j], covariance[RATE, j]
            product[0, j] = cos * p_x + sin * p_y + t_x * turn + bias * covariance[BIAS_X, j]
            product[1, j] = cos * p_y - sin * p_x + t_y * turn + bias * covariance[BIAS_Y, j]
        for j in range(STATES):
            covariance[U_X, j], covariance[U_Y, j] = product[0, j], product[1, j]
        for i in range(STATES):
            p_x, p_y, turn = covariance[i, U_X], covariance[i, U_Y], covariance[i, RATE]
            covariance[i, U_X] = cos * p_x + sin * p_y + t_x * turn + bias * covariance[i, BIAS_X]
            covariance[i, U_Y] = cos * p_y - sin * p_x + t_y * turn + bias * covariance[i, BIAS_Y]
        spread = dt * (constants.force if used else constants.walk) ** 2
        covariance[U_X, U_X] += spread
        covariance[U_Y, U_Y] += spread
        covariance[RATE, RATE] += dt * constants.turn**2
        if not braking:
            for j in range(bank.BIAS_RATE, STATES):
                # A vehicle without a twist cannot observe all of these states. The variance
                # therefore approaches its initial value, and does not grow without limit.
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
