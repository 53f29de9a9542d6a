"""The shortest time for which a valve stays as it is: real ones cannot switch every 10 ms.

A valve that has switched keeps its state for the dwell time. Two things are more important than
that, and both only ever let more brakes act: when all brakes must act they do so at once, and so
do the brakes with a negative error if otherwise none would act. Where the dwell time is 0 every
valve does at every step what it is told.
"""

from __future__ import annotations

from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

# Columns of the valves: whether it is shut, so that its wheel rolls free; for how long it must
# still stay as it is [ns]. Zeros are valves that have been open for long.
SHUT, HELD = range(2)
VALVE_SIZE = 2


@lean
def open_valves(valves: FloatArray, dwell: float, elapsed: float) -> None:
    """Let all brakes act, however short a time ago their valves were shut.

    Args:
        valves: changed in place, shape (N, 2).
        dwell: shortest time between two switchings [ns].
        elapsed: time since the last step [ns].
    """
    for i in range(valves.shape[0]):
        valves[i, HELD] = max(valves[i, HELD] - elapsed, 0.0)
        if valves[i, SHUT] != 0.0:
            valves[i, SHUT] = 0.0
            valves[i, HELD] = dwell


@lean
def switch_valves(valves: FloatArray, dwell: float, elapsed: float, enable: FloatArray) -> None:
    """Switch the valves that may switch already.

    Args:
        valves: changed in place, shape (N, 2).
        dwell: shortest time between two switchings [ns].
        elapsed: time since the last step [ns].
        enable: 1 for a brake that should act, else 0, with at least one that should; receives what
            the valves then do, shape (N,).
    """
    acting = False
    for i in range(valves.shape[0]):
        valves[i, HELD] = max(valves[i, HELD] - elapsed, 0.0)
        acting |= valves[i, SHUT] == 0.0 if valves[i, HELD] > 0.0 else enable[i] != 0.0
    for i in range(valves.shape[0]):
        shut = 1.0 if enable[i] == 0.0 else 0.0
        if acting and valves[i, HELD] > 0.0:
            enable[i] = 1.0 - valves[i, SHUT]
        elif shut != valves[i, SHUT]:
            valves[i, SHUT] = shut
            valves[i, HELD] = dwell
