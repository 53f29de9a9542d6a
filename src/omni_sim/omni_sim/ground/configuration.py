"""Parameters of the ground: patches with a friction of their own, and the height."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter, section
from omni_core.quantities import FloatArray


class FrictionPatch(Configuration):
    """Rectangle or ellipse of ground with a friction of its own, in the world frame `odom`."""

    shape: str = parameter("rectangle", choices=("rectangle", "ellipse"))
    """Shape of the patch; `length` and `width` are the axes of an ellipse"""

    x: float = parameter(unit="m", minimum=-1.0e4, maximum=1.0e4)
    """x coordinate of the center in the world frame"""
    y: float = parameter(unit="m", minimum=-1.0e4, maximum=1.0e4)
    """y coordinate of the center in the world frame"""
    length: float = parameter(unit="m", above=0.0, maximum=2.0e4)
    """Extent along the direction `heading_deg`"""
    width: float = parameter(unit="m", above=0.0, maximum=2.0e4)
    """Extent across the direction `heading_deg`"""
    heading_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Direction of `length`, counter-clockwise from the x axis of the world"""
    friction: float = parameter(minimum=0.0, maximum=2.0)
    """Friction factor mu/mu_0 on the patch, relative to the friction in the tire data"""


STEEPEST = 0.5
"""Limit on the slope of the ground [1]. On steeper ground the model would be inaccurate, because it
neglects that the horizontal projection of a tilted vehicle is shorter than the vehicle."""


SLOPE, WAVE, BUMP = 0.0, 1.0, 2.0
"""Kinds of the parts of an elevation in a table for the kernels."""


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
                (SLOPE, self.grade * math.cos(uphill), self.grade * math.sin(uphill), 0.0, 0.0)
            )
        for wave in self.waves.values():
            number, angle = 2.0 * math.pi / wave.length, math.radians(wave.direction_deg)
            along = number * math.cos(angle), number * math.sin(angle)
            rows.append((WAVE, *along, math.radians(wave.phase_deg), wave.amplitude))
        rows += [(BUMP, b.x, b.y, b.radius, b.height) for b in self.bumps.values()]
        return np.array(rows, dtype=np.float64).reshape(len(rows), 5)
