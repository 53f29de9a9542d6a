"""The pressure in the brakes: it follows the valves late, and not at once.

What is asked of a brake, ``c`` (the pedal's share of the largest torque, times the share that its
valve lets pass: all or nothing, or any in steps), reaches its cylinder after a dead time ``t_d``,
and the torque that the brake can then exert builds up and falls with a first-order lag:

    T dp/dt + p = c(t - t_d)

Within a physics step ``c`` is constant, so the solution is exact: ``p' = c + (p - c) exp(-dt/T)``.
A step is given the mean of ``p`` over it, so that the brake's impulse is exact too. The dead time
is rounded to whole physics steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_platform.quantities import FloatArray

IntArray = NDArray[np.int64]


class BrakePressure(NamedTuple):
    """Pressure in the brakes of N wheels, as the torque that it lets each exert.

    Attributes:
        remainder: of a difference to what is asked, after a step [1].
        mean_remainder: of such a difference, on average over a step [1].
        torque: that each brake can exert [N m], shape (N,).
        delayed: what was asked in the last D steps of the dead time [N m], shape (D, N).
        oldest: row of `delayed` that takes effect next, shape (1,).
        grain: step of the share that a valve can let pass [1], 1 for on and off, 0 for any.
    """

    remainder: float
    mean_remainder: float
    torque: FloatArray
    delayed: FloatArray
    oldest: IntArray
    grain: float = 0.0


def build_brake_pressure(
    time_constant: float, dead_time: float, wheels: int, physics_step: float, grain: float = 0.0
) -> BrakePressure:
    """Return brakes without pressure.

    Args:
        time_constant: ``T`` [s], 0 for a pressure without lag.
        dead_time: ``t_d`` [s].
        wheels: number of them.
        physics_step: [s].
        grain: step of the share that a valve can let pass [1].
    """
    remainder = mean_remainder = 0.0
    if time_constant > 0.0:
        ratio = physics_step / time_constant
        remainder, mean_remainder = math.exp(-ratio), -math.expm1(-ratio) / ratio
    delay = round(dead_time / physics_step)
    return BrakePressure(
        remainder,
        mean_remainder,
        np.zeros(wheels),
        np.zeros((delay, wheels)),
        np.zeros(1, dtype=np.int64),
        grain,
    )


def release(pressure: BrakePressure) -> None:
    """Take all pressure out of the brakes."""
    pressure.torque[:] = 0.0
    pressure.delayed[:] = 0.0
    pressure.oldest[0] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def passed(pressure: BrakePressure, enable: FloatArray) -> FloatArray:
    """Return the shares of the pressure that the valves let pass when told to [1], shape (N,)."""
    shares = enable.copy()
    if pressure.grain > 0.0:
        for i in range(enable.size):
            shares[i] = min(math.floor(enable[i] / pressure.grain + 0.5) * pressure.grain, 1.0)
    return shares


@njit(cache=True, nogil=True, error_model="numpy")
def brake_torques(
    pressure: BrakePressure, demand: float, enable: FloatArray, n_steps: int
) -> FloatArray:
    """Advance the pressure by some physics steps under a constant demand.

    Args:
        pressure: changed in place.
        demand: of the pedal, the torque of a brake that gets all of it [N m].
        enable: share that each valve is told to let pass [1], shape (N,).
        n_steps: number of physics steps.

    Returns:
        Torque that each brake can exert in each step [N m], shape (n_steps, N); a single row that
        holds for all steps, (1, N), where the pressure follows at once.
    """
    delay = pressure.delayed.shape[0]
    asked: FloatArray = passed(pressure, enable)
    for i in range(asked.size):
        asked[i] *= demand
    if pressure.remainder == 0.0 and delay == 0:
        return asked.reshape((1, asked.size))
    torques = np.empty((n_steps, asked.size))
    for k in range(n_steps):
        row = pressure.oldest[0]
        for i in range(asked.size):
            target = asked[i]
            if delay > 0:
                target = pressure.delayed[row, i]
                pressure.delayed[row, i] = asked[i]
            missing = pressure.torque[i] - target
            torques[k, i] = target + missing * pressure.mean_remainder
            pressure.torque[i] = target + missing * pressure.remainder
        if delay > 0:
            pressure.oldest[0] = (row + 1) % delay
    return torques
