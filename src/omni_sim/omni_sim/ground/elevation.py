"""Height of the ground in the world: the sum of a slope, waves and bumps.

Each part is an analytic function ``z(x, y)``:

    slope   z = g (x cos a + y sin a)
    wave    z = A sin(2 pi (x cos a + y sin a) / L + p)
    bump    z = h (1 - r^2 / R^2)^3 within the radius R, else 0

A slope has the grade ``g`` and rises in the direction ``a``. A wave has the amplitude ``A``, the
length ``L`` and the phase ``p``; its crests are perpendicular to the direction ``a``. A bump has
the height ``h``, and ``r`` is the distance from its center; a bump with ``h < 0`` is a hollow.

The curvature is continuous, even at the rim of a bump. The ground is therefore smooth enough for
the local road plane of `vehicle.uneven_ground`. Without any part the ground is flat.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter, section
from omni_core.kernels import lean
from omni_core.quantities import FloatArray

STEEPEST = 0.5
"""Limit on the slope of the ground [1]. On steeper ground the model would be inaccurate, because it
neglects that the horizontal projection of a tilted vehicle is shorter than the vehicle."""

_SLOPE, _WAVE, _BUMP = 0.0, 1.0, 2.0
_STEEPEST_OF_BUMP = 6.0 * 16.0 / 25.0 / math.sqrt(5.0)  # largest slope of a bump, times R / h


class Terrain(NamedTuple):
    """Height of the ground, in the form that the kernels use.

    Attributes:
        parts: parts from `ElevationConfiguration.table`, shape (K, 5); flat if K = 0.
        sampling: distance between a wheel and each of the four points that define its road plane,
            Eq. (5) [m].
    """

    parts: FloatArray
    sampling: float


class WaveConfiguration(Configuration):
    """A straight, infinite wave of the ground."""

    amplitude: float = parameter(unit="m", minimum=0.0, maximum=10.0)
    """Amplitude: half of the height from trough to crest"""
    length: float = parameter(unit="m", minimum=0.2, maximum=1.0e4)
    """Distance from crest to crest"""
    direction_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Direction perpendicular to the crests, counter-clockwise from the x axis"""
    phase_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Phase at the origin; with 90 deg, a crest is at the origin"""


class BumpConfiguration(Configuration):
    """A round bump or hollow of the ground."""

    x: float = parameter(unit="m", minimum=-1.0e4, maximum=1.0e4)
    """x coordinate of the center in the world frame"""
    y: float = parameter(unit="m", minimum=-1.0e4, maximum=1.0e4)
    """y coordinate of the center in the world frame"""
    height: float = parameter(unit="m", minimum=-10.0, maximum=10.0)
    """Height at the center, negative for a hollow"""
    radius: float = parameter(unit="m", minimum=0.1, maximum=1.0e4)
    """Radius of the bump"""


class ElevationConfiguration(Configuration):
    """Height of the ground; the parts add up, and the default is flat."""

    grade: float = parameter(0.0, minimum=0.0, maximum=STEEPEST)
    """Grade of an even slope, 0.05 for 5 %"""
    uphill_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Direction in which the slope rises, counter-clockwise from the x axis"""
    waves: Mapping[str, WaveConfiguration] = section(dict)
    """Waves, keyed by name"""
    bumps: Mapping[str, BumpConfiguration] = section(dict)
    """Bumps and hollows, keyed by name"""
    sampling_distance: float = parameter(0.05, unit="m", minimum=1.0e-3, maximum=1.0)
    """Distance between a wheel and each of the four points that define its road plane, Eq. (5)"""

    def check_consistency(self) -> None:
        """Check that the ground is not steeper than the model permits.

        Raises:
            ConfigurationError: the ground is too steep; the message names the steepest part.
        """
        steepness = {"grade": self.grade}
        for name, wave in self.waves.items():
            steepness[f"waves.{name}"] = 2.0 * math.pi * wave.amplitude / wave.length
        for name, bump in self.bumps.items():
            steepness[f"bumps.{name}"] = _STEEPEST_OF_BUMP * abs(bump.height) / bump.radius
        total = sum(steepness.values())
        if total > STEEPEST:
            worst = max(steepness, key=lambda key: steepness[key])
            raise ConfigurationError(
                worst,
                f"its steepness of up to {steepness[worst]:.3g} gives a ground with a steepness of "
                f"up to {total:.3g}, which must be at most {STEEPEST:g}",
            )

    @property
    def terrain(self) -> Terrain:
        """Height of the ground in the form that the kernels use."""
        return Terrain(self.table(), self.sampling_distance)

    def table(self) -> FloatArray:
        """Return the parts of the elevation as a table for the kernels.

        Returns:
            One row ``(kind, a, b, c, d)`` per part, shape (K, 5). For a slope, ``a, b`` are the
            grades along x and y [1], and ``c, d`` are 0. For a wave, ``a, b`` are the wave
            numbers along x and y [rad/m], ``c`` the phase [rad] and ``d`` the amplitude [m]. For
            a bump, ``a, b`` are x and y of the center, ``c`` the radius and ``d`` the height [m].
        """
        rows: list[tuple[float, ...]] = []
        if self.grade > 0.0:
            uphill = math.radians(self.uphill_deg)
            rows.append(
                (_SLOPE, self.grade * math.cos(uphill), self.grade * math.sin(uphill), 0.0, 0.0)
            )
        for wave in self.waves.values():
            number, angle = 2.0 * math.pi / wave.length, math.radians(wave.direction_deg)
            along = number * math.cos(angle), number * math.sin(angle)
            rows.append((_WAVE, *along, math.radians(wave.phase_deg), wave.amplitude))
        rows += [(_BUMP, b.x, b.y, b.radius, b.height) for b in self.bumps.values()]
        return np.array(rows, dtype=np.float64).reshape(len(rows), 5)


@lean
def elevation_at(table: FloatArray, x: float, y: float) -> float:
    """Return the height of the ground ``z(x, y)`` [m].

    Args:
        table: table from `ElevationConfiguration.table`, shape (K, 5).
        x: coordinate x in the world [m].
        y: coordinate y in the world [m].
    """
    z = 0.0
    for k in range(table.shape[0]):
        kind, a, b, c, d = table[k, 0], table[k, 1], table[k, 2], table[k, 3], table[k, 4]
        if kind == _SLOPE:
            z += a * x + b * y
        elif kind == _WAVE:
            z += d * math.sin(a * x + b * y + c)
        else:
            inside = 1.0 - ((x - a) * (x - a) + (y - b) * (y - b)) / (c * c)
            if inside > 0.0:
                z += d * inside * inside * inside
    return z
