"""Steps of a vehicle one by one, with wheels and energies after each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from omni_core.kernels import kernel
from omni_core.quantities import FloatArray
from omni_sim.vehicle import dynamics, state
from omni_sim.vehicle.vehicle import Vehicle


class Log(NamedTuple):
    """Record of n steps.

    Attributes:
        trajectory: as returned by `Vehicle.advance`, shape (n + 1, 6).
        wheels: records of `state.WHEEL` after each step, shape (n, N).
        energy: `state.Energies` after each step [J], shape (n, 5).
    """

    trajectory: FloatArray
    wheels: state.Structured
    energy: FloatArray


@kernel
def _advance(vehicle: state.State, control: state.Control, step: int, log: Log) -> None:
    for k in range(log.wheels.shape[0]):
        dynamics.advance(vehicle, control, step, log.trajectory[k : k + 2])
        for i in range(vehicle.wheels.shape[0]):
            log.wheels[k, i] = vehicle.wheels[i]
        energies = dynamics.energies(vehicle)
        for j in range(len(energies)):
            log.energy[k, j] = energies[j]


def advance_logged(
    vehicle: Vehicle, steps: int, pedal: float, enable: ArrayLike, command: ArrayLike
) -> Log:
    """Advance by a number of steps and record them; inputs as in `Vehicle.advance`."""
    wheels = np.empty((steps, len(vehicle.wheel_names)), state.WHEEL)
    log = Log(np.empty((steps + 1, 6)), wheels, np.empty((steps, 5)))
    before = vehicle.tipping_steps
    control = vehicle._control(pedal, enable, command, hold_world=False)
    # numba would compile `dynamics.advance` again for a literal 1.
    _advance(vehicle.state, control, 1, log)
    vehicle.tipping = vehicle.tipping_steps > before
    return log


def kinetic_energy(vehicle: Vehicle) -> float:
    """Return the sum of the energies of translation, rotation and spin [J]."""
    return float(sum(vehicle.energies[:3]))
