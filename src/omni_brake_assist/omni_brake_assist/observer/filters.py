"""The filters: prediction by gyro and accelerometer, scalar updates."""

from __future__ import annotations

import math
from typing import NamedTuple

from omni_brake_assist.observer.state import (
    ALL,
    BIAS_RATE,
    BIAS_X,
    BIAS_Y,
    FASTEST_TURN,
    FILTERS,
    GAIN_X,
    GAIN_Y,
    GYRO,
    HEADING,
    HISTORY,
    LARGEST_FORCE,
    LAST_RATE,
    NO_FORCE,
    NO_GYRO,
    PATH,
    RATE,
    STATES,
    U_X,
    U_Y,
    Force,
    ObserverConstants,
    ObserverMemory,
    copy,
)
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray


class Filter(NamedTuple):
    """State of a filter, shape (6,), and its covariance, shape (6, 6)."""

    state: FloatArray
    covariance: FloatArray


@lean
def _predict(
    constants: ObserverConstants,
    state: FloatArray,
    covariance: FloatArray,
    dt: float,
    measured: Force,
    product: FloatArray,
) -> None:
    """Carry one filter on by a step."""
    inertial, f_x, f_y = measured
    rate, u_x, u_y = state[RATE], state[U_X], state[U_Y]
    cos, sin = math.cos(rate * dt), math.sin(rate * dt)
    state[U_X], state[U_Y] = cos * u_x + sin * u_y, cos * u_y - sin * u_x
    spread = constants.walk
    if inertial:
        spread = constants.force
        a_x, a_y = f_x - state[BIAS_X], f_y - state[BIAS_Y]
        half_c, half_s = math.cos(0.5 * rate * dt), math.sin(0.5 * rate * dt)
        state[U_X] += dt * (half_c * a_x + half_s * a_y)
        state[U_Y] += dt * (half_c * a_y - half_s * a_x)
    # Rows of the Jacobian that differ from those of the unit matrix.
    t_x, t_y = dt * state[U_Y], -dt * state[U_X]
    bias = -dt if inertial else 0.0
    for j in range(STATES):
        p_x, p_y = covariance[U_X, j], covariance[U_Y, j]
        turn = covariance[RATE, j]
        product[0, j] = cos * p_x + sin * p_y + t_x * turn + bias * covariance[BIAS_X, j]
        product[1, j] = cos * p_y - sin * p_x + t_y * turn + bias * covariance[BIAS_Y, j]
    for j in range(STATES):
        covariance[U_X, j], covariance[U_Y, j] = product[0, j], product[1, j]
    for i in range(STATES):
        p_x, p_y = covariance[i, U_X], covariance[i, U_Y]
        turn = covariance[i, RATE]
        covariance[i, U_X] = cos * p_x + sin * p_y + t_x * turn + bias * covariance[i, BIAS_X]
        covariance[i, U_Y] = cos * p_y - sin * p_x + t_y * turn + bias * covariance[i, BIAS_Y]
    covariance[U_X, U_X] += (spread * dt) ** 2
    covariance[U_Y, U_Y] += (spread * dt) ** 2
    covariance[RATE, RATE] += (constants.turn * dt) ** 2


@lean
def spread(covariance: FloatArray, h: FloatArray) -> float:
    """Return the variance of ``h . x``."""
    total = 0.0
    for i in range(STATES):
        if h[i] != 0.0:
            for j in range(STATES):
                total += h[i] * covariance[i, j] * h[j]
    return total


@lean
def correct(
    filtered: Filter, h: FloatArray, innovation: float, variance: float, gain: FloatArray
) -> None:
    """Correct one filter by a scalar measurement ``h . x``; its gain is left in `gain`."""
    state, covariance = filtered
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
        state[i] += gain[i] * (share * innovation)
        for j in range(STATES):
            covariance[i, j] -= gain[i] * gain[j] * share


@lean
def of_then(memory: ObserverMemory, k: int, stamp_ns: int, then: FloatArray) -> None:
    """Write the state of a filter at a time; the oldest known one if it is longer ago."""
    row = memory.newest[0]
    copy(memory.state[k], then)
    later_ns = memory.stamps[row]
    for _ in range(HISTORY - 1):
        if later_ns <= stamp_ns:
            return
        row = (row - 1) % HISTORY
        earlier_ns = memory.stamps[row]
        if earlier_ns < 0 or earlier_ns >= later_ns:
            return
        if earlier_ns <= stamp_ns:
            share = (later_ns - stamp_ns) / (later_ns - earlier_ns)
            for j in range(STATES):
                then[j] += share * (memory.past[row, k, j] - then[j])
            return
        copy(memory.past[row, k], then)
        later_ns = earlier_ns


@lean
def correct_past(memory: ObserverMemory, k: int, since_ns: int, shift: FloatArray) -> None:
    """Shift the stored states after a late twist by its correction, or the next one repeats it."""
    later_ns = memory.stamps[memory.newest[0]]
    row = (memory.newest[0] - 1) % HISTORY
    while row != memory.newest[0] and later_ns > since_ns and memory.stamps[row] >= 0:
        for i in range(STATES):
            memory.past[row, k, i] += shift[i]
        later_ns = memory.stamps[row]
        row = (row - 1) % HISTORY


@lean
def carry_on(
    constants: ObserverConstants,
    memory: ObserverMemory,
    now_ns: int,
    dt: float,
    inertial: FloatArray,
) -> None:
    """Predict all filters, correct them by the gyro, and store the current states."""
    rate, f_x, f_y = inertial[0], inertial[1], inertial[2]
    # What no vehicle does is no reading.
    gyro = abs(rate) < FASTEST_TURN
    force = abs(f_x) < LARGEST_FORCE and abs(f_y) < LARGEST_FORCE
    if gyro and force:
        memory.isolation[0].inertial = 1.0
    _carry_path(memory, dt, rate if gyro else math.nan, f_x if force else math.nan, f_y)
    product, h = memory.workspace.product, memory.workspace.h
    h[:] = 0.0
    h[RATE] = h[BIAS_RATE] = 1.0
    for k in range(FILTERS):
        state, covariance = memory.state[k], memory.covariance[k]
        measured = Force(force and k != NO_FORCE, f_x, f_y)
        _predict(constants, state, covariance, dt, measured, product)
        if gyro and k != NO_GYRO:
            innovation = rate - state[RATE] - state[BIAS_RATE]
            filtered = Filter(state, covariance)
            correct(filtered, h, innovation, constants.gyro**2, memory.workspace.gain)
    row = (memory.newest[0] + 1) % HISTORY
    memory.newest[0] = row
    memory.stamps[row] = now_ns
    remember(memory)


@lean
def _carry_path(memory: ObserverMemory, dt: float, rate: float, f_x: float, f_y: float) -> None:
    """Turn the path by the gyro and add the specific force to it; NaN without an accelerometer."""
    path, course = memory.state[PATH], memory.course[0]
    known = memory.state[ALL, RATE]
    now = rate - course.still_rate if math.isfinite(rate) else known
    turn = 0.5 * dt * (now + path[LAST_RATE])
    heading = path[HEADING] + 0.5 * turn
    path[HEADING] += turn
    path[LAST_RATE], path[GYRO] = now, rate
    if math.isfinite(f_x):
        a_x, a_y = f_x - course.still_x, f_y - course.still_y
        c, s = math.cos(heading), math.sin(heading)
        path[GAIN_X] += dt * (c * a_x - s * a_y)
        path[GAIN_Y] += dt * (s * a_x + c * a_y)


@lean
def remember(memory: ObserverMemory) -> None:
    """Store the current states in the newest row of the history."""
    row = memory.newest[0]
    for k in range(FILTERS + 1):
        copy(memory.state[k], memory.past[row, k])
