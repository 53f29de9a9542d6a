"""Whether braking has effect: it knows pedal, valves and wheel speeds, nothing else.

A released wheel that rolls at ``|R omega|`` brakes nothing along that path; a wheel whose brake
acts slides along a path that it does brake. With equal loads friction takes ``mu m g / N`` times
the latter, so a vehicle that needs the path ``L`` with all brakes on needs ``L + M`` with the path
``M`` missed by wheels that were released. The monitor bounds ``M`` by

    M <= allowance + share L

with the sliding path of braked wheels from below: from the speed that each rolled at last, less
what it may have lost since. Nor may brakes be released for longer than a stop with a modest
deceleration lasts. Once either bound is exceeded all brakes act until the pedal is released.
Locked wheels say nothing, and need not: then every brake acts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_platform.geometry import PlatformGeometry

FloatArray = NDArray[np.float64]

# Entries of the ledger: path missed [m], path braked [m], whether the bound has been exceeded, the
# speed of the fastest wheel when the pedal went down [m/s], time since [s].
MISSED, BRAKED, TRIPPED, START, ELAPSED = range(5)
LEDGER_SIZE = 5


class EffectConstants(NamedTuple):
    """What never changes.

    Attributes:
        roll: speed along the active direction per wheel speed [m], shape (N,).
        share: of the braked path that may be missed [1].
        allowance: that may be missed on top of it, in seconds of the speed at the start [s].
        loss: deceleration that a wheel which is not seen to roll is taken to have [m/s^2].
        creep: path that may be missed in any case [m].
        least: deceleration with which a stop must be over, on average [m/s^2].
        grace: time that it may take in any case [s].
    """

    roll: FloatArray
    share: float
    allowance: float
    loss: float
    creep: float
    least: float
    grace: float


class EffectMemory(NamedTuple):
    """What it remembers: the ledger, shape (5,), and the last rolling speeds [m/s], shape (N,)."""

    ledger: FloatArray
    rolled: FloatArray


def effect_constants(geometry: PlatformGeometry) -> EffectConstants:
    """Lay out the constants of wheels for the kernel."""
    return EffectConstants(
        roll=geometry.radius * np.sum(geometry.active * geometry.rolling, axis=1),
        share=0.6,
        allowance=0.15,
        loss=8.0,
        creep=0.1,
        least=1.0,
        grace=1.0,
    )


def effect_memory(wheels: int) -> EffectMemory:
    """Return a memory that has seen nothing, of N wheels."""
    return EffectMemory(np.zeros(LEDGER_SIZE), np.zeros(wheels))


@njit(cache=True, nogil=True, error_model="numpy")
def watch_effect(
    constants: EffectConstants,
    memory: EffectMemory,
    dt: float,
    braking: bool,
    enable: FloatArray,
    speeds: FloatArray,
) -> bool:
    """Book the last step and tell whether all brakes must act.

    Args:
        constants: of the vehicle.
        memory: changed in place.
        dt: length of the step [s].
        braking: whether the pedal was down in it.
        enable: what the brakes were told in it, shape (N,).
        speeds: of the wheels now [rad/s], shape (N,); no number where it is not known.
    """
    ledger, rolled = memory.ledger, memory.rolled
    if not braking:
        ledger[:] = 0.0
        for i in range(rolled.size):
            rim = abs(constants.roll[i] * speeds[i])
            rolled[i] = rim if math.isfinite(rim) else rolled[i]
        return False
    if ledger[ELAPSED] == 0.0:
        ledger[START] = np.max(rolled)
    ledger[ELAPSED] += dt
    missed, braked, count = 0.0, 0.0, rolled.size
    for i in range(count):
        rim = abs(constants.roll[i] * speeds[i])
        rolled[i] = max(rolled[i] - constants.loss * dt, 0.0)
        if math.isfinite(rim):
            rolled[i] = max(rolled[i], rim) if enable[i] > 0.0 else rim
        free = 1.0 - enable[i]
        missed += free * rolled[i] / count
        braked += (1.0 - free) * rolled[i] / count
    ledger[MISSED] += missed * dt
    ledger[BRAKED] += braked * dt
    bound = constants.creep + constants.allowance * ledger[START]
    due = constants.grace + ledger[START] / constants.least
    overdue = ledger[ELAPSED] > due and np.min(enable) < 1.0
    if overdue or ledger[MISSED] > bound + constants.share * ledger[BRAKED]:
        ledger[TRIPPED] = 1.0
    return bool(ledger[TRIPPED] != 0.0)
