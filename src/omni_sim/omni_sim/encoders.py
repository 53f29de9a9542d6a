"""Wheel encoders: mean speed of each wheel over a control period, from integer counts.

A reading is ``(floor(theta / q) - floor(theta_before / q)) q / T`` plus white noise. ``theta`` is
the angle of the wheel at the stamp, ``theta_before`` the angle at the previous stamp, ``T`` the
time between both stamps, and ``q`` the angle of one count. With infinite resolution, a reading is
the true speed at the stamp plus noise.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_core.kernels import lean
from omni_core.quantities import FloatArray
from omni_sim.sensor_configuration import EncoderConfiguration
from omni_sim.vehicle.state import Structured


class Encoders(NamedTuple):
    """Constants and state of the wheel encoders, in the form that the kernel uses.

    Attributes:
        angle_step: angle of a count [rad], 0 for infinite resolution.
        noise: standard deviation of a reading [rad/s].
        angle: wheel angle at the last stamp, rounded down to counts [rad], shape (N,).
    """

    angle_step: float
    noise: float
    angle: FloatArray


def build_encoders(configuration: EncoderConfiguration, wheels: int) -> Encoders:
    """Return the constants and the initial state of the encoders for the kernel."""
    resolution = configuration.resolution
    count = 2.0 * math.pi / resolution if resolution else 0.0
    return Encoders(count, configuration.noise, np.zeros(wheels))


@lean
def read_encoders(
    encoders: Encoders,
    step: int,
    period: float,
    wheels: Structured,
    draw: FloatArray,
    reading: FloatArray,
) -> None:
    """Write the readings of the encoders; this function must be called once per stamp.

    Args:
        encoders: encoders, changed in place.
        step: number of the stamp. At the first stamp, no previous angle exists, so the reading is
            the true speed.
        period: time between two stamps [s].
        wheels: true states of the wheels, records `state.WHEEL`, shape (N,).
        draw: standard normal noise, shape (N,).
        reading: output, the wheel speeds [rad/s], shape (N,).
    """
    for i in range(wheels.size):
        reading[i] = wheels[i].speed
        if encoders.angle_step > 0.0:
            whole = math.floor(wheels[i].angle / encoders.angle_step) * encoders.angle_step
            if step > 0:
                reading[i] = (whole - encoders.angle[i]) / period
            encoders.angle[i] = whole
        reading[i] += encoders.noise * draw[i]
