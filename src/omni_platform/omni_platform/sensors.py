"""Where the line cameras sit and what they see of the ground.

A line camera measures the velocity of its own position along its own axis. Its footprint is a
rectangle: `length` along the axis, divided into `pixels`, and `width` across it, over which each
pixel integrates (section 4.3.2).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from omni_platform.configuration import Configuration, parameter

FloatArray = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class LineSensor(Configuration):
    """One line camera on the platform, in the body frame."""

    x: float = parameter(description="Centre of the footprint, forward of base_link", unit="m")
    y: float = parameter(description="Centre of the footprint, left of base_link", unit="m")
    heading_deg: float = parameter(
        description="Sensor axis (measuring direction), counter-clockwise from forward",
        unit="deg",
        minimum=-360.0,
        maximum=360.0,
    )
    pixels: int = parameter(
        1024, description="Pixels of a line", unit="px", minimum=16, maximum=16384
    )
    length: float = parameter(
        0.05,
        description="Field of view along the axis",
        unit="m",
        above=0.0,
        maximum=1.0,
    )
    width: float = parameter(
        0.02,
        description="Field of view across the axis",
        unit="m",
        above=0.0,
        maximum=1.0,
    )
    line_rate: float = parameter(
        2500.0, description="Lines per second", unit="1/s", above=0.0, maximum=1e6
    )

    @property
    def pixel_pitch(self) -> float:
        """Length of a pixel's footprint along the axis [m]."""
        return self.length / self.pixels

    @property
    def heading(self) -> float:
        """Direction of the sensor axis in the body frame [rad]."""
        return math.radians(self.heading_deg)


def sensor_matrix(sensors: Mapping[str, LineSensor]) -> FloatArray:
    """Return the linear map from body twist to the velocities along the sensor axes.

    Each row is ``(cos h, sin h, cross(r, a))`` with the unit axis ``a = (cos h, sin h)`` and the
    position ``r``: the component along `a` of ``v_c + Omega k x r``, Eq. (23).

    Args:
        sensors: S sensors by name.

    Returns:
        Matrix of shape (S, 3): [1], [1], [m].
    """
    rows = []
    for sensor in sensors.values():
        a_x, a_y = math.cos(sensor.heading), math.sin(sensor.heading)
        rows.append((a_x, a_y, sensor.x * a_y - sensor.y * a_x))
    return np.array(rows, dtype=np.float64).reshape(len(rows), 3)
