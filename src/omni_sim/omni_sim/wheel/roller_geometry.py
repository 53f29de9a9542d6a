"""Rollers of a wheel: configuration, contact point and axis direction, Eqs. (8)-(17).

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 2.3.2, after A. Gfrerrer, "Geometry and kinematics of the Mecanum wheel", Computer Aided
Geometric Design 25 (2008) 784-791.

The wheel axis ``a`` is horizontal and has the direction ``alpha``. The axis ``b`` of a roller is at
the angle ``delta`` and the distance ``d`` from ``a``. The wheel angle ``gamma`` is zero when the
roller is lowest. The roller touches the ground below the point at which ``b`` crosses the vertical
plane through ``a``. While the wheel turns, this point moves along ``a`` from one edge of the wheel
to the other, and jumps back when the next roller takes over the load. In a wheel with two rows,
every second roller is in the other row, and the contact alternates between the rows; large and
small rollers may alternate, too (Figure 2 of the dissertation). The rollers are barrels that
fill the wheel's envelope, a circle of radius ``r``, so the wheel axis keeps its height. The
dissertation uses ``a_x`` for two quantities; in Eq. (10) it is the x coordinate of the wheel
center.

With the roller angle of `omni_core.geometry`, ``delta = 90 deg + roller_angle``.
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.geometry import WheelMount
from omni_core.quantities import FloatArray

_FIELDS = ("u_x", "u_y", "cos", "sin", "distance", "shift")
AXIS = np.dtype([(name, np.float64) for name in _FIELDS])
"""Constants of every second roller of a wheel.

    u_x, u_y   rolling direction ``u`` of the wheel in the body frame [1]
    cos, sin   cosine and sine of the roller angle on the ground, ``(sin delta, -cos delta)`` [1]
    distance   distance ``d`` between the axes of wheel and roller [m]
    shift      distance of the row of the rollers from the middle of the wheel, along ``a`` [m]
"""


@dataclasses.dataclass(frozen=True)
class RollerGeometry:
    """Geometry of an omni-wheel with n rollers, in the vehicle's frame ``S_1``.

    Attributes:
        alpha: direction of the wheel axis ``a``, Eq. (8) [rad].
        delta: angle between the axes of wheel and roller [rad], not a multiple of 180 deg.
        distance: distance ``d`` between the axes, ``R_0`` of Eq. (17) [m].
        radius: radius ``r`` of the wheel over its rollers [m].
        rollers: number n of rollers.
        center: ``(a_x, a_y)``, wheel center in ``S_1`` [m].
        rows_apart: distance between the rows of even and odd rollers [m]; 0 for one row.
        odd_distance: ``d`` of the odd rollers [m]; None if all rollers are equal.
    """

    alpha: float
    delta: float
    distance: float
    radius: float
    rollers: int
    center: tuple[float, float] = (0.0, 0.0)
    rows_apart: float = 0.0
    odd_distance: float | None = None

    def __post_init__(self) -> None:
        """Check that the wheel can be built.

        Raises:
            ValueError: too few rollers, parallel axes, or a roller's axis below the ground.
        """
        if self.rollers < 3:
            raise ValueError(f"{self.rollers} rollers: a wheel needs at least 3")
        if abs(math.sin(self.delta)) < 1e-9:
            raise ValueError("the roller axes are parallel to the wheel axis")
        if not 0.0 < self.distance < self.radius * math.cos(self.half_pitch):
            raise ValueError(
                f"distance {self.distance:g} m: the rollers' axes must stay above the ground, "
                f"so d must be below {self.radius * math.cos(self.half_pitch):g} m"
            )

    @property
    def half_pitch(self) -> float:
        """Wheel angle between the middle of a roller and the change to the next roller [rad]."""
        return math.pi / self.rollers

    @property
    def wheel_axis(self) -> FloatArray:
        """Unit vector ``a`` of the wheel's axis, Eq. (8), shape (3,)."""
        return np.array([math.cos(self.alpha), math.sin(self.alpha), 0.0])

    def roller_angle(self, wheel_angle: ArrayLike) -> FloatArray:
        """Return the wheel angle ``gamma`` from the lowest position of the roller on the ground.

        The angle is in [-pi/n, pi/n) for n rollers [rad].

        Args:
            wheel_angle: angle of the wheel, zero with roller 0 at the ground [rad], any shape.
        """
        angle = np.asarray(wheel_angle, dtype=np.float64)
        pitch = 2.0 * self.half_pitch
        return np.asarray(angle - pitch * np.floor(angle / pitch + 0.5), dtype=np.float64)

    def roller_axis(self, gamma: ArrayLike) -> FloatArray:
        """Return the unit vector ``b`` of the roller's axis, Eq. (9), shape (..., 3).

        Args:
            gamma: wheel angle from the lowest position of the roller [rad], shape (...).
        """
        g = np.asarray(gamma, dtype=np.float64)
        cos_a, sin_a = math.cos(self.alpha), math.sin(self.alpha)
        cos_d, sin_d = math.cos(self.delta), math.sin(self.delta)
        return np.stack(  # Eq. (9)
            (
                cos_a * cos_d - sin_a * sin_d * np.cos(g),
                sin_a * cos_d + cos_a * sin_d * np.cos(g),
                sin_d * np.sin(g),
            ),
            axis=-1,
        )

    def active_direction(self, gamma: ArrayLike) -> FloatArray:
        """Return the unit vector along the projection of the roller's axis on the ground.

        Args:
            gamma: wheel angle from the lowest position of the roller [rad], shape (...).

        Returns:
            Unit vector in the vehicle's frame [1], shape (..., 2).
        """
        b = self.roller_axis(gamma)[..., :2]
        return np.asarray(b / np.linalg.norm(b, axis=-1, keepdims=True))

    def contact_point(self, gamma: ArrayLike) -> FloatArray:
        """Return the contact point ``c`` on the ground [m], Eq. (10), shape (..., 2).

        Args:
            gamma: wheel angle from the lowest position of the roller [rad], shape (...).
        """
        reach = self.distance * np.tan(np.asarray(gamma, dtype=np.float64))
        along = reach * math.cos(self.delta) / math.sin(self.delta)
        a_x, a_y = self.center
        return np.stack(
            (a_x - along * math.cos(self.alpha), a_y - along * math.sin(self.alpha)), axis=-1
        )

    @property
    def constants(self) -> list[tuple[float, ...]]:
        """Constants of even and odd rollers for `roller_contact`, in the order of `AXIS`."""
        # u = a x k
        u_x, u_y = math.sin(self.alpha), -math.cos(self.alpha)
        common, odd = (u_x, u_y, math.sin(self.delta), -math.cos(self.delta)), self.odd_distance
        row, other = 0.5 * self.rows_apart, self.distance if odd is None else odd
        return [(*common, self.distance, row), (*common, other, -row)]

    @property
    def jump(self) -> float:
        """Largest distance by which the contact point jumps at a change of rollers [m]."""
        tangent = max(self.distance, self.odd_distance or 0.0) * math.tan(self.half_pitch)
        oblique = abs(2.0 * tangent * math.cos(self.delta) / math.sin(self.delta))
        return oblique + self.rows_apart


class RollerConfiguration(Configuration):
    """Parameters of the rollers of every wheel of a vehicle.

    A roller is undeflected when it reaches the ground. It develops its full force only if its
    relaxation length is short compared with the distance over which it rolls under the wheel. The
    relaxation length is the slope dF/ds at zero slip, divided by the stiffness. The default
    stiffness is typical of solid rubber. With the slope of Table 1 it gives a relaxation length of
    25 mm, about the length of a roller's contact patch. For comparison, the relaxation length of
    the single-roller wheel's tire is 250 mm.
    """

    count: int = parameter(12, minimum=4, maximum=64)
    """Number of rollers of a wheel, n"""
    radius: float = parameter(0.045, unit="m", above=0.0, maximum=1.0)
    """Radius of a roller at its middle"""
    rows_apart: float = parameter(0.0, unit="m", minimum=0.0, maximum=1.0)
    """Distance between two rows of rollers, in which the rollers alternate; 0 for one row"""
    small_radius: float = parameter(0.0, unit="m", minimum=0.0, maximum=1.0)
    """Radius of every second roller at its middle, if large and small rollers alternate; 0 if all
    rollers are equal"""
    inertia: float = parameter(8.0e-4, unit="kg m^2", minimum=1.0e-7, maximum=10.0)
    """Moment of inertia of a roller about its axis; that of a small roller is less in proportion to
    the fourth power of its radius (cylinders of equal length)"""
    stiffness: float = parameter(2.0e6, unit="N/m", minimum=1.0e3, maximum=1.0e8)
    """Stiffness of a roller's tread against horizontal deflection; in the wheel model `rollers`
    it replaces the stiffness of the tire"""
    damping: float = parameter(5000.0, unit="N s/m", minimum=0.0, maximum=1.0e7)
    """Damping of a roller's tread against horizontal deflection"""
    overlap: float = parameter(0.1, minimum=0.01, maximum=0.5)
    """Range of the wheel angle, before and after each change of rollers, in which both rollers
    carry load, divided by half the angle between two rollers"""
    gap: float = parameter(0.0, unit="m", minimum=0.0, maximum=1.0)
    """Gap between the ends of two neighboring rollers along the rim, into which the wheel sinks;
    requires a suspension; 0 if the rollers fill the circle"""

    def check_consistency(self) -> None:
        """Check that rollers that alternate have an even number.

        Raises:
            ConfigurationError: the number is odd.
        """
        if self.count % 2 and max(self.rows_apart, self.small_radius) > 0.0:
            raise ConfigurationError(
                "count", f"is {self.count}, must be even for rollers that alternate"
            )

    @property
    def radii(self) -> tuple[float, float]:
        """Radii of even and of odd rollers [m]."""
        return self.radius, self.small_radius or self.radius

    @property
    def inertias(self) -> FloatArray:
        """Moments of inertia of even and of odd rollers [kg m^2], shape (2,)."""
        even, odd = self.radii
        return self.inertia * np.array([1.0, (odd / even) ** 4])


def roller_geometries(
    wheels: Mapping[str, WheelMount], rollers: RollerConfiguration, squeeze: float
) -> tuple[RollerGeometry, ...]:
    """Return the geometry of the rollers of each wheel, in the order of the wheels.

    Args:
        wheels: position and orientation of each wheel, keyed by wheel name.
        rollers: rollers of every wheel.
        squeeze: deflection of a tire under the largest load [m].

    Raises:
        ConfigurationError: the rollers do not fit on a wheel; the message names the wheel and radii
            that fit.
    """
    reach = math.cos(math.pi / rollers.count * (1.0 + rollers.overlap))
    geometries = []
    for name, mount in wheels.items():
        if rollers.gap >= math.pi * mount.radius / rollers.count:
            raise ConfigurationError(
                "rollers.gap",
                f"{rollers.gap:g} m is more than half of a roller's share of the rim of wheel "
                f"{name}, {2.0 * math.pi * mount.radius / rollers.count:.3g} m",
            )
        even, odd = (mount.radius - radius for radius in rollers.radii)
        for key, distance in (("radius", even), ("small_radius", odd)):
            if distance <= 0.0 or mount.radius - distance / reach <= squeeze:
                least = mount.radius - (mount.radius - squeeze) * reach
                raise ConfigurationError(
                    f"rollers.{key}",
                    f"{mount.radius - distance:g} m does not fit the ends of the {rollers.count} "
                    f"rollers of wheel {name}; more than {least:.3g} m and less than "
                    f"{mount.radius:g} m fit",
                )
        alpha = math.radians(mount.heading_deg + 90.0)
        delta = math.radians(90.0 + mount.roller_angle_deg)
        size, center = (even, mount.radius, rollers.count), (mount.x, mount.y)
        geometries.append(RollerGeometry(alpha, delta, *size, center, rollers.rows_apart, odd))
    return tuple(geometries)
