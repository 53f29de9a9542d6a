"""Pressure in the brakes, which follows the valves after a dead time and with a lag.

The demand ``c`` of a brake is the torque that corresponds to the pedal position, times the share of
the pressure that the brake's valve passes. This share is 0 or 1 for on-off valves, a multiple of
the resolution for valves with steps, and any value from 0 to 1 for continuous valves. The demand
reaches the cylinder after a dead time ``t_d``. The torque ``p`` that the brake can exert then rises
and falls with a first-order lag:

    T dp/dt + p = c(t - t_d)

Within a physics step ``dt`` the demand ``c`` is constant, so the solution at its end is exact: ``p'
= c + (p - c) exp(-dt/T)``. Each step uses the mean of ``p`` over the step, so the impulse of the
brake is also exact. The dead time is rounded to whole physics steps. If a brake releases with a
longer dead time ``t_r``, the largest demand between ``t - t_r`` and ``t - t_d`` is used.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_core.brakes import BrakeConfiguration
from omni_core.kernels import by_reference, lean, lean_inline
from omni_core.quantities import FloatArray, IntArray


@by_reference
class BrakePressure(NamedTuple):
    """Pressure in the brakes of N wheels, expressed as the torque that each brake can exert.

    Attributes:
        remainder: share of the difference between torque and demand that remains after a step [1].
        mean_remainder: mean of this share during a step [1].
        demanded: demanded torque of each brake, from pedal and valve [N m], shape (N,).
        torque: torque that each brake can exert at the end of the step [N m], shape (N,).
        acting: torque that each brake can exert on average over the step [N m], shape (N,).
        delayed: demanded torques of the last D steps [N m], shape (D, N). D is the longer of the
            dead times of applying and releasing, in steps.
        oldest: row of `delayed` that takes effect next, shape (1,).
        open: smallest share of the pressure that each valve can pass [1], shape (N,).
        stuck: minimum of the demanded torque of each brake [N m], shape (N,).
        pressure_step: resolution of a valve [1]; 1 for on-off valves, 0 for continuous valves.
        release_lag: dead time of releasing minus dead time of applying, in steps; at least 0.
    """

    remainder: float
    mean_remainder: float
    demanded: FloatArray
    torque: FloatArray
    acting: FloatArray
    delayed: FloatArray
    oldest: IntArray
    open: FloatArray
    stuck: FloatArray
    pressure_step: float
    release_lag: int


def build_brake_pressure(
    brake: BrakeConfiguration, wheels: int, physics_step: float
) -> BrakePressure:
    """Return the constants and the initial state of brakes without pressure.

    Args:
        brake: brake of every wheel.
        wheels: number of wheels.
        physics_step: length of a step [s].
    """
    remainder = mean_remainder = 0.0
    if brake.time_constant > 0.0:
        ratio = physics_step / brake.time_constant
        remainder, mean_remainder = math.exp(-ratio), -math.expm1(-ratio) / ratio
    delay = round(max(brake.dead_time, brake.release_time) / physics_step)
    demanded, torque, acting, least, stuck = (np.zeros(wheels) for _ in range(5))
    delayed, oldest = np.zeros((delay, wheels)), np.zeros(1, dtype=np.int64)
    rows = demanded, torque, acting, delayed, oldest, least, stuck
    lag = delay - round(brake.dead_time / physics_step)
    return BrakePressure(remainder, mean_remainder, *rows, brake.pressure_step, lag)


def release(pressure: BrakePressure) -> None:
    """Release the pressure of all brakes."""
    pressure.torque[:] = 0.0
    pressure.delayed[:] = 0.0
    pressure.oldest[0] = 0


@lean
def passed(pressure: BrakePressure, share: float) -> float:
    """Return the share of the pressure that a valve passes when `share` is commanded [1]."""
    if pressure.pressure_step > 0.0:
        return min(math.floor(share / pressure.pressure_step + 0.5) * pressure.pressure_step, 1.0)
    return share


@lean_inline
def set_demand(pressure: BrakePressure, demand: float, enable: FloatArray) -> None:
    """Set the demanded torques from the pedal and the commanded valve positions.

    Args:
        pressure: pressure in the brakes, changed in place.
        demand: torque of a brake whose valve passes the whole pressure of the pedal [N m].
        enable: commanded share that each valve passes [1], shape (N,).
    """
    for i in range(enable.size):
        share = max(passed(pressure, enable[i]), pressure.open[i])
        pressure.demanded[i] = max(share * demand, pressure.stuck[i])


@lean_inline
def press(pressure: BrakePressure) -> None:
    """Advance the pressure by a physics step, and write the mean torques to `pressure.acting`."""
    delay = pressure.delayed.shape[0]
    row = pressure.oldest[0]
    for i in range(pressure.demanded.size):
        target = pressure.demanded[i]
        if delay > 0:
            target = pressure.delayed[row, i]
            for later in range(1, pressure.release_lag + 1):
                newer = pressure.demanded[i]
                if later < delay:
                    newer = pressure.delayed[(row + later) % delay, i]
                target = max(target, newer)
            pressure.delayed[row, i] = pressure.demanded[i]
        if pressure.remainder == 0.0:
            pressure.acting[i] = target
            continue
        missing = pressure.torque[i] - target
        pressure.acting[i] = target + missing * pressure.mean_remainder
        pressure.torque[i] = target + missing * pressure.remainder
    if delay > 0:
        pressure.oldest[0] = (row + 1) % delay
