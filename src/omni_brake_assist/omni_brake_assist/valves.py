"""Valves that cannot switch in every control step.

Some valves cannot switch in every control step of 10 ms. An open valve applies its brake. A valve
that has switched keeps its state for the dwell time. There are two exceptions, and both apply more
brakes. If all brakes must act, all valves open immediately. If no brake would act during the dwell
time, the valves that are commanded to brake open immediately. With a dwell time of 0, every valve
follows its command in every step.
"""

import numpy as np
from numpy.typing import NDArray

from omni_core.kernels import lean
from omni_core.quantities import FloatArray


@lean
def open_valves(valves: NDArray[np.void], dwell: float, elapsed: float) -> None:
    """Open all valves, regardless of their dwell time.

    Args:
        valves: state of the valves, changed in place, shape (N,).
        dwell: minimum time between two switching operations of a valve [ns].
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
        valves: state of the valves, changed in place, shape (N,).
        dwell: minimum time between two switching operations of a valve [ns].
        elapsed: time since the last step [ns].
        enable: command to each valve [1], shape (N,). A command of 0 shuts a valve, and at least
            one command is above 0. If a valve must keep its state, this function overwrites the
            command with 0 or 1.
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
