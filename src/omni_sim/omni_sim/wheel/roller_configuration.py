"""Configuration of the rollers of a vehicle's wheels, and a check that they fit."""

import math
from collections.abc import Mapping

from omni_platform.configuration import Configuration, ConfigurationError, parameter
from omni_platform.geometry import WheelMount
from omni_sim.wheel.roller_geometry import RollerGeometry


class RollerConfiguration(Configuration):
    """The rollers of every wheel of a vehicle.

    A roller is undeflected when it reaches the ground. It develops its full force only if its
    relaxation length, the slope dF/ds at zero slip divided by the stiffness, is short compared with
    the distance that it rolls under the wheel. The default stiffness is that of solid rubber: with
    the slope at zero slip of Table 1, the relaxation length is 25 mm, about the length of a
    roller's contact patch. The relaxation length of the single-roller wheel's tire is 250 mm.
    """

    count: int = parameter(12, minimum=4, maximum=64)
    """Number of rollers of a wheel, n"""
    radius: float = parameter(0.045, unit="m", above=0.0, maximum=1.0)
    """Radius of a roller at its middle"""
    inertia: float = parameter(8.0e-4, unit="kg m^2", minimum=1.0e-7, maximum=10.0)
    """Moment of inertia of a roller about its axis"""
    stiffness: float = parameter(2.0e6, unit="N/m", minimum=1.0e3, maximum=1.0e8)
    """Stiffness of a roller's tread against horizontal deflection; in the wheel model 'rollers'
    it replaces the stiffness of the tire"""
    damping: float = parameter(5000.0, unit="N s/m", minimum=0.0, maximum=1.0e7)
    """Damping of a roller's tread against horizontal deflection"""
    overlap: float = parameter(0.1, minimum=0.01, maximum=0.5)
    """Share of half a pitch, before and after a change of rollers, in which both rollers carry
    load"""
    gap: float = parameter(0.0, unit="m", minimum=0.0, maximum=1.0)
    """Gap between the ends of two neighboring rollers, measured along the rim, into which the
    wheel sinks; requires a suspension. With 0, the rollers fill the wheel's circle"""


def roller_geometries(
    wheels: Mapping[str, WheelMount], rollers: RollerConfiguration, squeeze: float
) -> tuple[RollerGeometry, ...]:
    """Return the geometry of the rollers of each wheel, in the order of the wheels.

    Args:
        wheels: mounts by wheel name.
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
        distance = mount.radius - rollers.radius
        if distance <= 0.0 or mount.radius - distance / reach <= squeeze:
            least = mount.radius - (mount.radius - squeeze) * reach
            raise ConfigurationError(
                "rollers.radius",
                f"{rollers.radius:g} m is too large for the ends of the {rollers.count} rollers "
                f"of wheel {name}; more than {least:.3g} m and less than "
                f"{mount.radius:g} m fit",
            )
        alpha = math.radians(mount.heading_deg + 90.0)
        delta = math.radians(90.0 + mount.roller_angle_deg)
        size = distance, mount.radius, rollers.count
        geometries.append(RollerGeometry(alpha, delta, *size, center=(mount.x, mount.y)))
    return tuple(geometries)
