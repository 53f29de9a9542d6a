"""Wheel encoders: mean speed of each wheel over a control period, from integer counts.

A reading is ``omega = (floor(theta / q) - floor(theta_before / q)) q / T`` plus white noise, with
the angle ``q`` of a count. With infinite resolution it is the true speed at the stamp plus noise.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_platform.configuration import Configuration, parameter
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray


class EncoderConfiguration(Configuration):
    """Resolution and noise of the wheel encoders; perfect ones by default."""

    resolution: int = parameter(0, minimum=0, maximum=100_000_000)
    """Counts per turn of a wheel (0: infinite resolution)"""
    noise: float = parameter(0.0, unit="rad/s", minimum=0.0)
    """Standard deviation of a speed"""


class Encoders(NamedTuple):
    """Encoders in the layout of the kernel.

    Attributes:
        angle_step: angle of a count [rad], 0 for infinite resolution.
        noise: standard deviation [rad/s].
        angle: angle at the last stamp, rounded down to counts [rad], shape (N,).
    """

    angle_step: float
    noise: float
    angle: FloatArray


def build_encoders(configuration: EncoderConfiguration, wheels: int) -> Encoders:
    """Return the encoders in the layout of the kernel, before their first reading."""
    resolution = configuration.resolution
    count = 2.0 * math.pi / resolution if resolution else 0.0
    return Encoders(count, configuration.noise, np.zeros(wheels))


@lean
def read_encoders(
    encoders: Encoders,
    step: int,
    period: float,
    angle: FloatArray,
    speed: FloatArray,
    draw: FloatArray,
    reading: FloatArray,
) -> None:
    """Read the encoders; once per stamp.

    Args:
        encoders: changed in place.
        step: number of the stamp; at the first stamp there is no difference of angles, so the true
            speed is read.
        period: time between two stamps [s].
        angle: true wheel angles [rad], shape (N,).
        speed: true wheel speeds [rad/s], shape (N,).
        draw: standard normal noise, shape (N,).
        reading: receives the speeds [rad/s], shape (N,).
    """
    for i in range(speed.size):
        reading[i] = speed[i]
        if encoders.angle_step > 0.0:
            whole = math.floor(angle[i] / encoders.angle_step) * encoders.angle_step
            if step > 0:
                reading[i] = (whole - encoders.angle[i]) / period
            encoders.angle[i] = whole
        reading[i] += encoders.noise * draw[i]
