"""Minimum dwell time for valves that cannot switch in every control step of 10 ms.

A valve that has switched keeps its state for the dwell time. There are two exceptions, and both
apply more brakes. If all brakes must act, all valves open at once. If otherwise no brake would act,
the valves with a command to brake open at once. With a dwell time of 0, every valve follows its
command in every step.
"""

import numpy as np
from numpy.typing import NDArray

from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_VALVE = np.dtype(
    [
        ("shut", "?"),  # whether the valve is shut, which lets its wheel roll freely
        ("held", "f8"),  # remaining time until the valve may switch [ns]
    ]
)


def new_valves(wheels: int) -> NDArray[np.void]:
    """Return the state of open valves that may switch at once, shape (N,)."""
    return np.zeros(wheels, _VALVE)


@lean
def open_valves(valves: NDArray[np.void], dwell: float, elapsed: float) -> None:
    """Open all valves, regardless of their dwell time.

    Args:
        valves: changed in place, shape (N,).
        dwell: shortest time between two switchings [ns].
        elapsed: time since the last step [ns].
    """
    for i in range(valves.size):
        valve = valves[i]
        valve.held = max(valve.held - elapsed, 0.0)
        if valve.shut:
            valve.shut, valve.held = False, dwell


@lean
def switch_valves(
    valves: NDArray[np.void], dwell: float, elapsed: float, enable: FloatArray
) -> None:
    """Switch the valves whose dwell time has passed.

    Args:
        valves: changed in place, shape (N,).
        dwell: shortest time between two switchings [ns].
        elapsed: time since the last step [ns].
        enable: command to each valve [1], at least one above 0, shape (N,); 0 shuts a valve. The
            command to a valve that must keep its state is overwritten with 0 or 1.
    """
    acting = False
    for i in range(valves.size):
        valve = valves[i]
        valve.held = max(valve.held - elapsed, 0.0)
        acting |= not valve.shut if valve.held > 0.0 else enable[i] != 0.0
    for i in range(valves.size):
        valve, shut = valves[i], enable[i] == 0.0
        if acting and valve.held > 0.0:
            enable[i] = 0.0 if valve.shut else 1.0
        elif shut != valve.shut:
            valve.shut, valve.held = shut, dwell
