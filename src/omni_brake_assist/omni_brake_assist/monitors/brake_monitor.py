"""Whether each brake acts: a wheel that rolls free though it should be braked has none.

A brake that acts makes its wheel slide: the rim falls behind what the ground drags it along with,
``R n_w . u_w w < n_w . v_i``. One that has been told to act and whose rim still keeps up, while
those of other brakes do not, is dead: with as much pressure, or with less of it where it is told
much. A law that does not know that lets go of others for its sake, so all brakes act from then on
until the pedal is released.

Brakes that all act gently make no wheel slide; then none is called dead.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_platform.geometry import PlatformGeometry, cross
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

NO_WHEEL = -1

_PRESSED = 0.2  # pedal from which a brake must show [1]
_PASSED = 0.9  # share of it, likewise: a law that gives a brake less knows why [1]
_HARD = 0.5  # share of the whole pressure from which on a slide under less speaks against it [1]
_LEAST = 0.05  # share of the pedal's demand below which a wheel slides for another reason [1]
_SLOW = 0.5  # speed along the active direction below which nothing shows [m/s]
_NOISE, _SCALE = 0.05, 0.015  # by which a rim that rolls may be off [m/s], [1]
_SLIDES = 3.0  # times that, from which a wheel slides for certain [1]
_LATELY = 0.5  # for how long a slide of another wheel counts [s]
_FORGIVEN = 4.0  # how much faster a slide speaks for a brake than rolling against it [1]


class BrakeConstants(NamedTuple):
    """What never changes.

    Attributes:
        n_x: active directions [1], shape (N,).
        n_y: likewise.
        lever: ``cross(r_i, n_wi)`` [m], shape (N,).
        roll: speed along the active direction per wheel speed [m], shape (N,).
        time: for which a held wheel must roll until its brake is dead [s].
    """

    n_x: FloatArray
    n_y: FloatArray
    lever: FloatArray
    roll: FloatArray
    time: float


class BrakedWheels(NamedTuple):
    """What is known of the wheels.

    Attributes:
        told: share of the pedal's demand that each brake was told to let pass [1], shape (N,).
        speeds: of the wheels now [rad/s], shape (N,); no number where it is not known.
        scale: by which share rims that roll are faster than the ground, learned before [1].
    """

    told: FloatArray
    speeds: FloatArray
    scale: float


def brake_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> BrakeConstants:
    """Lay out the constants for the kernel."""
    n_x, n_y = np.ascontiguousarray(geometry.active.T)
    brake = configuration.brake
    return BrakeConstants(
        n_x,
        n_y,
        cross(geometry.position, geometry.active),
        geometry.radius * np.sum(geometry.active * geometry.rolling, axis=1),
        0.1 + brake.dead_time + 2.0 * brake.time_constant,
    )


def brake_memory(wheels: int) -> FloatArray:
    """Return a memory in which no brake is suspected, shape (N + 1,).

    Entries: for how long each wheel has rolled though it should be braked [s]; time since some
    wheel has slid [s].
    """
    memory = np.zeros(wheels + 1)
    memory[wheels] = _LATELY
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
    """Look at the wheels after a step of braking; return one whose brake is dead, or NO_WHEEL.

    Args:
        constants: of the vehicle.
        memory: of `brake_memory`, changed in place.
        dt: length of the step [s].
        pedal: the driver's demand in it, 0 while there is none [1].
        wheels: after the step, told before it.
        twist: body twist now [m/s, m/s, rad/s].
    """
    speeds = wheels.speeds
    if pedal <= 0.0:
        memory[:] = 0.0
        memory[-1] = _LATELY
        return NO_WHEEL
    memory[-1] += dt
    for looks_for_slides in (True, False):
        for i in range(speeds.size):
            hub = constants.n_x[i] * twist[0] + constants.n_y[i] * twist[1]
            hub += constants.lever[i] * twist[2]
            told = wheels.told[i]
            least = _LEAST if looks_for_slides and pedal >= _HARD else _PASSED
            if pedal < _PRESSED or told < least or abs(hub) < _SLOW:
                continue
            rim = constants.roll[i] * speeds[i] / (1.0 + wheels.scale)
            behind = hub - rim if hub >= 0.0 else rim - hub
            rolling = _NOISE + _SCALE * abs(hub)
            if looks_for_slides:
                if behind > _SLIDES * rolling:
                    memory[-1] = 0.0
            elif abs(behind) > rolling:
                memory[i] = max(memory[i] - _FORGIVEN * dt, 0.0)
            elif abs(behind) <= rolling and memory[-1] < _LATELY:
                memory[i] += dt
    for i in range(speeds.size):
        if memory[i] > constants.time:
            return i
    return NO_WHEEL
