"""Simulated sensor faults, which replace the fault-free readings of a channel.

The channels are the velocity sensor, the gyro, the accelerometer and the wheel encoders. A fault
affects one axis (or wheel) of a channel, or all of them, from its onset for a limited time. Let
``y`` be the fault-free reading, ``tau`` the time since the onset, ``a`` the amplitude, ``T`` the
period, and ``N(0, 1)`` a standard normal value. The faulty reading is

    offset   y + a                   drop_out     NaN
    drift    y + a tau               zero         0
    ramp     y + a min(tau / T, 1)   stuck        y at the onset
    scale    (1 + a) y               stuck_noise  y at the onset plus 1e-9 N(0, 1)
    sine     y + a sin(2 pi tau / T) delay        y at the time T ago
    noise    y + a N(0, 1)           swap         reading of the other axis or next wheel
    sign     -y                      echo         a y + (1 - a) times y at the onset
    square   y + a, then y - a       quantized    y rounded to a multiple of a
             for T / 2 each

Several faults of one channel are applied one after another.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from omni_core.configuration import ConfigurationError
from omni_core.kernels import by_reference, kernel, lean
from omni_core.quantities import SECOND_NS, FloatArray, IntArray
from omni_sim.sensor_configuration import CHANNELS, KINDS, FaultConfiguration

TWIST, GYRO, ACCELEROMETER, ENCODER = range(len(CHANNELS))
(_OFFSET, _DRIFT, _RAMP, _SCALE, _SINE, _NOISE, _SIGN, _DROP_OUT, _ZERO, _STUCK, _STUCK_NOISE,
 _DELAY, _SWAP, _ECHO, _SQUARE, _QUANTIZED) = range(len(KINDS))  # fmt: skip

# Columns of the table of faults.
_CHANNEL, _KIND, _AXIS, _START, _END, _AMPLITUDE, _PERIOD = range(7)
_COLUMNS = 7

_MOST_READINGS = 1_000_000  # limit on the number of readings in a delay
_STUCK_NOISE_DEVIATION = 1e-9
_ROUNDING = 1e-6  # share of half a period that rounding of times may cause [1]


@by_reference
class Faults(NamedTuple):
    """Faults of a run and their state, for K faults and W values in the widest channel.

    Attributes:
        table: one row per fault: channel, kind, axis, onset and end [ns], amplitude [unit of the
            channel], period [s]; shape (K, 7).
        held: reading at the onset of each fault, shape (K, W).
        begun: 1 if the onset of a fault has passed, else 0, shape (K,).
        past: latest readings before each fault is applied, a ring buffer of R readings, which
            reach back for the longest delay, shape (K, R, W).
        stamps: stamps of these readings [ns], shape (K, R).
    """

    table: FloatArray
    held: FloatArray
    begun: FloatArray
    past: FloatArray
    stamps: IntArray


def build_faults(faults: Mapping[str, FaultConfiguration], wheels: int, period: float) -> Faults:
    """Return the faults of a run as the arrays that the kernel uses.

    Args:
        faults: faults, keyed by name.
        wheels: number of wheels, each with an encoder.
        period: shortest time between two readings of a channel [s].

    Raises:
        ConfigurationError: a fault affects an unknown axis or wheel, or its delay contains too many
            readings.
    """
    sizes, rows, stored = (3, 1, 2, wheels), [], 1
    for name, fault in faults.items():
        size = sizes[CHANNELS.index(fault.channel)]
        if fault.axis >= size:
            raise ConfigurationError(
                f"faults.{name}.axis",
                f"{fault.axis} must be -1 to {size - 1}, because {fault.channel} has {size}",
            )
        if fault.kind == "delay":
            stored = max(stored, math.ceil(fault.period / period) + 1)
        if stored > _MOST_READINGS:
            raise ConfigurationError(
                f"faults.{name}.period",
                f"{fault.period:g} s is longer than {_MOST_READINGS} readings of {period:g} s",
            )
        kind = CHANNELS.index(fault.channel), KINDS.index(fault.kind), fault.axis
        times = (round(time * SECOND_NS) for time in (fault.time, fault.time + fault.duration))
        rows.append((*kind, *times, fault.amplitude, fault.period))
    count, width = len(rows), max(wheels, 3)
    table = np.array(rows, dtype=np.float64).reshape(count, _COLUMNS)
    late, stamps = np.zeros((count, stored, width)), np.zeros((count, stored), np.int64)
    return Faults(table, np.zeros((count, width)), np.zeros(count), late, stamps)


@kernel
def corrupt(
    faults: Faults, channel: int, step: int, now_ns: int, draw: FloatArray, values: FloatArray
) -> None:
    """Apply the faults of a channel to a reading; call this once per reading.

    Args:
        faults: faults of the run; their memory of past readings is changed in place.
        channel: one of TWIST, GYRO, ACCELEROMETER, ENCODER.
        step: number of the reading.
        now_ns: stamp of the reading [ns].
        draw: standard normal noise, shape (n,).
        values: reading of the channel, changed in place, shape (n,).
    """
    size, stored = values.size, faults.stamps.shape[1]
    for k in range(faults.table.shape[0]):
        row = faults.table[k]
        if row[_CHANNEL] != channel:
            continue
        ring, stamps = faults.past[k], faults.stamps[k]
        stamps[step % stored] = now_ns
        for j in range(size):
            ring[step % stored, j] = values[j]
        if not row[_START] <= now_ns < row[_END]:
            continue
        if faults.begun[k] == 0.0:
            faults.begun[k] = 1.0
            for j in range(size):
                faults.held[k, j] = values[j]
        tau = (now_ns - row[_START]) * 1e-9
        back, until_ns = 0, now_ns - round(row[_PERIOD] * SECOND_NS)
        while back < min(stored - 1, step) and stamps[(step - back) % stored] > until_ns:
            back += 1
        delayed, true = ring[(step - back) % stored], ring[step % stored]
        for j in range(size):
            if row[_AXIS] < 0.0 or row[_AXIS] == j:
                # In a twist only v_x and v_y are exchanged, because they have the same unit.
                pair = 2 if channel == TWIST and j < 2 else size
                other = true[(j + 1) % pair] if j < pair else true[j]
                values[j] = _faulty_reading(
                    row, tau, true[j], faults.held[k, j], delayed[j], other, draw[j]
                )


@lean
def _faulty_reading(  # noqa: PLR0911, PLR0912 - a line for each kind
    row: FloatArray, tau: float, y: float, held: float, delayed: float, other: float, draw: float
) -> float:
    """Return the reading of a faulty axis; the module's docstring defines the symbols.

    Args:
        row: row of the fault in `Faults.table`, shape (7,).
        tau: time since the onset of the fault [s].
        y: reading without this fault.
        held: reading at the onset.
        delayed: reading without this fault one period ``T`` ago.
        other: reading of the other axis or the next wheel.
        draw: standard normal value.
    """
    kind: float = row[_KIND]
    a: float = row[_AMPLITUDE]
    period: float = row[_PERIOD]
    if kind == _OFFSET:
        return y + a
    if kind == _DRIFT:
        return y + a * tau
    if kind == _RAMP:
        return y + a * min(tau / period, 1.0)
    if kind == _SCALE:
        return (1.0 + a) * y
    if kind == _SINE:
        return y + a * math.sin(2.0 * math.pi * tau / period)
    if kind == _NOISE:
        return y + a * draw
    if kind == _SIGN:
        return -y
    if kind == _DROP_OUT:
        return math.nan
    if kind == _ZERO:
        return 0.0
    if kind == _STUCK:
        return held
    if kind == _STUCK_NOISE:
        return held + _STUCK_NOISE_DEVIATION * draw
    if kind == _DELAY:
        return delayed
    if kind == _SWAP:
        return other
    if kind == _ECHO:
        return a * y + (1.0 - a) * held
    if kind == _SQUARE:
        return y + (a if math.floor(2.0 * tau / period + _ROUNDING) % 2 == 0 else -a)
    if kind == _QUANTIZED:
        return a * round(y / a) if a != 0.0 else y
    return math.nan  # a kind that has no branch here
