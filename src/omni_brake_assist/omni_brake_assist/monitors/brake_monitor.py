"""Detection of a failed brake, whose wheel rolls freely although the brake should act.

A working brake makes its wheel slide: along the active direction, the rim is slower than the center
of the wheel. A brake counts as failed if its wheel rolls without slip while another wheel slides
under the same or less pressure. A law that assumes that the failed brake works would release the
wrong brakes. After a failure, until the pedal is released, the reaction depends on the brakes. If
they are on-off, `allocation` controls the other brakes (`LawConstants.replans` gives exceptions).
If they are proportional, all brakes act.

Free rolling is tested by a cumulative sum (Page, Biometrika 41, 1954) of the log-likelihood ratio
of two hypotheses: the wheel rolls with a normally distributed deviation, or the wheel has an
arbitrary slip. The small, constant slip of a heavily loaded wheel, which its brake cannot lock,
therefore does not count as free rolling. With little pressure, this slip is as small as the error
of a rolling rim's speed. The deviation at which both hypotheses are equally likely is therefore at
most half of the deviation that the torque causes on a wheel with twice the nominal load, and a
brake whose torque would hardly change the speed gives hardly any evidence. The sum continues over
several commands of the law to the same brake. It restarts after the brake has been released for
longer than it was commanded to act. With such short commands, a brake with a lag does not reach the
pressure at which its wheel slides.

If all brakes act so weakly that no wheel slides, no failure is detected.
"""

from typing import NamedTuple

import numpy as np

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.filter_bank.state import RELEASED, SHARE, WHEEL
from omni_brake_assist.laws.brake_observer import ROLLS, SLOW
from omni_brake_assist.laws.law import NO_WHEEL
from omni_core.geometry import PlatformGeometry
from omni_core.kernels import by_reference, lean
from omni_core.quantities import GRAVITY, FloatArray

_LEAST = 0.15  # smallest share of the full pressure that can cause sliding [1]
_SLIDES = 9.0  # deviation from rolling above which a wheel slides, in the unit of `ROLLS` [1]
_SLIDE_VALIDITY = 0.5  # time for which detected sliding of any wheel remains valid [s]


@by_reference
class BrakeConstants(NamedTuple):
    """Constants of the brake monitor.

    Attributes:
        n_x: active directions, x component [1], shape (N,).
        n_y: active directions, y component [1], shape (N,).
        lever: levers of the active directions about the center of the wheels [m], shape (N,).
        roll: speed of the rim along the active direction per wheel speed [m], shape (N,).
        peak: share of the full pressure that locks a wheel with twice the mean nominal load, less
            than 1 [1], shape (N,).
        slip: slip of this wheel divided by smaller shares of `peak`; from the slope of the friction
            curve of `wheel_model` at rolling [1], shape (N,).
        time: duration of free rolling after which a brake counts as failed [s]; inf for drives that
            follow a speed, because a wheel that follows it may roll.
    """

    n_x: FloatArray
    n_y: FloatArray
    lever: FloatArray
    roll: FloatArray
    peak: FloatArray
    slip: FloatArray
    time: float


class BrakedWheels(NamedTuple):
    """Commands to the brakes, and speeds of the wheels, in one step.

    Attributes:
        commanded: share of the pedal's pressure that each brake was commanded to pass [1],
            shape (N,).
        speeds: wheel speeds [rad/s], shape (N,); NaN where unknown.
        scale: estimated relative error of the wheel radii, positive if the configured radii are
            too large [1].
    """

    commanded: FloatArray
    speeds: FloatArray
    scale: float


def brake_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> BrakeConstants:
    """Return the constants of the brake monitor for a configuration and wheel geometry."""
    n_x, n_y = np.ascontiguousarray(geometry.active.T)
    time = np.inf if configuration.brake.is_ramped else 0.1 + configuration.brake.settling_time
    force, rim = configuration.brake.max_torque / np.abs(geometry.rim), geometry.rim
    load = 2.0 / rim.size * configuration.nominal_mass * GRAVITY
    # With full pressure a brake counts as able to lock this wheel, even if the mass is unknown.
    peak = np.minimum(load / np.maximum(force, 1e-9), 1.0 - RELEASED)
    slip = 0.5 * configuration.allocation.target_slip * geometry.radius / np.abs(rim)
    return BrakeConstants(n_x, n_y, geometry.lever, rim, peak, slip, time)


def brake_memory(wheels: int) -> FloatArray:
    """Return the initial memory of the brake monitor, shape (2 N + 1,).

    The first N entries are the cumulative sums of the wheels [s]. The sum of a braked wheel rises
    by the duration of each step in which it rolls without slip, and falls if it slips. The next N
    entries are the net times for which the brakes were commanded to act [s]. Each rises by the
    duration of a step in which its brake is commanded to act. In other steps it falls by the
    duration of the step, but not below 0. The last entry is the time since any wheel slid [s].
    """
    memory = np.zeros(2 * wheels + 1)
    memory[-1] = _SLIDE_VALIDITY
    return memory


@lean
def watch_brakes(
    constants: BrakeConstants,
    memory: FloatArray,
    dt: float,
    pedal: float,
    wheels: BrakedWheels,
    twist: tuple[float, float, float],
) -> int:
    """Update the memory by one step; return the index of the wheel whose brake failed, or NO_WHEEL.

    Args:
        constants: constants of the vehicle.
        memory: from `brake_memory`, changed in place.
        dt: length of the step [s].
        pedal: the driver's brake demand in the step, 0 while the pedal is up [1].
        wheels: wheel speeds after the step and brake commands before it.
        twist: body twist [m/s, m/s, rad/s].
    """
    speeds = wheels.speeds
    if pedal <= 0.0:
        memory[:] = 0.0
        memory[-1] = _SLIDE_VALIDITY
        return NO_WHEEL
    memory[-1] += dt
    for i in range(speeds.size):
        hub = constants.n_x[i] * twist[0] + constants.n_y[i] * twist[1]
        hub += constants.lever[i] * twist[2]
        rim = constants.roll[i] * speeds[i] / (1.0 + wheels.scale)
        behind = hub - rim if hub >= 0.0 else rim - hub
        error = WHEEL + SHARE * abs(hub)
        deviation, pressure = behind / error, pedal * wheels.commanded[i]
        command, net, fast = wheels.commanded[i], speeds.size + i, abs(hub) >= SLOW
        if fast and pressure >= _LEAST and deviation > _SLIDES:
            memory[-1] = 0.0
        acts = command >= 1.0 - RELEASED
        if not acts and memory[net] == 0.0:
            memory[i] = 0.0
        memory[net] = max(memory[net] + (dt if acts else -dt), 0.0)
        if acts and fast and (memory[-1] < _SLIDE_VALIDITY or abs(deviation) > ROLLS):
            peak = constants.peak[i]
            slip = constants.slip[i] * pressure / peak if pressure < peak else 1.0
            equal = min(ROLLS, 0.5 * slip * abs(hub) / error)
            memory[i] = max(memory[i] + (equal**2 - deviation**2) / ROLLS**2 * dt, 0.0)
        if memory[i] > constants.time:
            return i
    return NO_WHEEL
