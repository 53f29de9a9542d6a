"""Delayed fusion horizon: all sensors are fused at the time of validity of a late twist.

A twist that is known to be older than its stamp cannot be compared with current readings
without a prediction of the change since. All other readings are therefore delayed by the same
time, the filters run with this delay, and only their estimate is predicted to the present, by the
later readings of gyro and accelerometer.
"""

from __future__ import annotations

import math

from omni_brake_assist.observer.observe import observe_at
from omni_brake_assist.observer.state import (
    BIAS_RATE,
    BIAS_X,
    BIAS_Y,
    FASTEST_TURN,
    KEPT,
    KEPT_IMU,
    KEPT_PRESSED,
    KEPT_WHEELS,
    LARGEST_FORCE,
    NO_ESTIMATE,
    NO_FORCE,
    NO_GYRO,
    RATE,
    U_X,
    U_Y,
    Brakes,
    ObserverConstants,
    ObserverMemory,
    PassedTwist,
    Sensed,
)
from omni_platform.kernels import inlined, lean
from omni_platform.quantities import FloatArray


@inlined
def observe(
    constants: ObserverConstants,
    memory: ObserverMemory,
    now_ns: int,
    brakes: Brakes,
    passed: PassedTwist,
    sensed: Sensed,
    answer: FloatArray,
) -> int:
    """Advance the observer by a step, as `observe_at`, and predict its estimate to the present."""
    late_ns = now_ns - int(constants.delay)
    if late_ns == now_ns:
        return int(observe_at(constants, memory, now_ns, brakes, passed, sensed, answer))
    _keep(constants, memory, now_ns, brakes, sensed)
    row = _find(memory, late_ns)
    if row < 0:
        return NO_ESTIMATE
    taken, n = memory.kept[KEPT], memory.released.size
    wheels = KEPT_WHEELS + n
    received, jumped, stamp_ns, value, variance = passed
    chosen = observe_at(
        constants,
        memory,
        late_ns,
        Brakes(memory.kept[row, KEPT_PRESSED] != 0.0, memory.kept[row, wheels:]),
        PassedTwist(received, jumped, stamp_ns - int(constants.delay), value, variance),
        Sensed(taken[KEPT_IMU:KEPT_WHEELS], taken[KEPT_WHEELS:wheels]),
        answer,
    )
    if chosen != NO_ESTIMATE and memory.isolation[0].inertial != 0.0:
        _carry_answer(constants, memory, chosen, late_ns, answer)
    return int(chosen)


@lean
def _keep(
    constants: ObserverConstants,
    memory: ObserverMemory,
    now_ns: int,
    brakes: Brakes,
    sensed: Sensed,
) -> None:
    """Write the readings of this step into the next row; after a gap, drop all earlier rows."""
    stamps, newest = memory.kept_stamps, memory.kept_newest[0]
    elapsed = (now_ns - stamps[newest]) * 1e-9
    if not 0.0 <= elapsed <= constants.longest:
        stamps[:] = -1
    row = (newest + 1) % KEPT
    memory.kept_newest[0] = row
    stamps[row] = now_ns
    kept, n = memory.kept[row], memory.released.size
    kept[KEPT_PRESSED] = 1.0 if brakes.pressed else 0.0
    for j in range(3):
        kept[KEPT_IMU + j] = sensed.inertial[j]
    for i in range(n):
        kept[KEPT_WHEELS + i] = sensed.speeds[i]
        kept[KEPT_WHEELS + n + i] = brakes.enable[i]


@lean
def _find(memory: ObserverMemory, late_ns: int) -> int:
    """Interpolate the readings at a time into the last row; return the row behind it, or -1."""
    row, stamps = memory.kept_newest[0], memory.kept_stamps
    for _ in range(KEPT - 1):
        before = (row - 1) % KEPT
        if stamps[row] < late_ns:
            return -1
        if stamps[row] == late_ns or (0 <= stamps[before] < late_ns):
            share = 0.0
            if stamps[row] > late_ns:
                share = (stamps[row] - late_ns) / (stamps[row] - stamps[before])
            for j in range(memory.kept.shape[1]):
                value = memory.kept[row, j]
                if share > 0.0:
                    value += share * (memory.kept[before, j] - value)
                memory.kept[KEPT, j] = value
            return int(row)
        if stamps[before] < 0:
            return -1
        row = before
    return -1


@lean
def _carry_answer(
    constants: ObserverConstants,
    memory: ObserverMemory,
    chosen: int,
    late_ns: int,
    answer: FloatArray,
) -> None:
    """Predict an estimate to the present by gyro and accelerometer, unless isolated."""
    state, isolation = memory.state[chosen], memory.isolation[0]
    u_x, u_y, rate = state[U_X], state[U_Y], state[RATE]
    gyro, force = chosen != NO_GYRO, chosen != NO_FORCE or isolation.out != NO_FORCE
    newest = memory.kept_newest[0]
    first = newest
    while memory.kept_stamps[(first - 1) % KEPT] > late_ns:
        first = (first - 1) % KEPT
    before_ns, row = late_ns, first
    while before_ns < memory.kept_stamps[newest]:
        dt = (memory.kept_stamps[row] - before_ns) * 1e-9
        before_ns = memory.kept_stamps[row]
        turn = memory.kept[row, KEPT_IMU]
        if gyro and abs(turn) < FASTEST_TURN:
            rate = turn - state[BIAS_RATE]
        f_x, f_y = memory.kept[row, KEPT_IMU + 1], memory.kept[row, KEPT_IMU + 2]
        a_x = a_y = 0.0
        if force and abs(f_x) < LARGEST_FORCE and abs(f_y) < LARGEST_FORCE:
            a_x, a_y = f_x - state[BIAS_X], f_y - state[BIAS_Y]
        cos, sin = math.cos(rate * dt), math.sin(rate * dt)
        half_c, half_s = math.cos(0.5 * rate * dt), math.sin(0.5 * rate * dt)
        u_x, u_y = (
            cos * u_x + sin * u_y + dt * (half_c * a_x + half_s * a_y),
            cos * u_y - sin * u_x + dt * (half_c * a_y - half_s * a_x),
        )
        row = (row + 1) % KEPT
    answer[0] = u_x + rate * constants.p_y
    answer[1] = u_y - rate * constants.p_x
    answer[2] = rate
