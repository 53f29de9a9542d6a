"""Parameters of the losses of rollers, and constants of the motor of a drive."""

import math
from typing import NamedTuple

from omni_core.configuration import Configuration, parameter


class Motor(NamedTuple):
    """Limits and lag of the motor of each drive, with all quantities at the wheel.

    Attributes:
        limit: limit on the torque [N m].
        slope: torque at the largest voltage per difference from the speed of idling,
            ``tau_0 / omega_0`` [N m s/rad]; infinite if the voltage is not limited.
        idling: speed at the largest voltage without torque, ``omega_0`` [rad/s]; infinite if the
            voltage is not limited.
        response: share of a change of the torque that the current loop completes in a step [1].
    """

    limit: float
    slope: float
    idling: float
    response: float


class PassiveLossConfiguration(Configuration):
    """Resistance of the rollers of every wheel; none by default."""

    rolling_resistance: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Ratio of the rollers' rolling resistance to the load, at a small load; about 0.015 for car
    tires on concrete"""
    speed_growth: float = parameter(0.0, unit="s^2/m^2", minimum=0.0, maximum=1.0)
    """Growth of the ratio of rolling resistance to load with the square of the speed of the
    roller's surface"""
    elasticity: float = parameter(0.0, unit="m/N", minimum=0.0, maximum=1.0e-3)
    """C of Eq. (19), elasticity of the tread; the ratio of resistance to load grows in proportion
    to C and to the load"""
    roller_diameter: float = parameter(0.08, unit="m", minimum=1.0e-3, maximum=10.0)
    """D of Eq. (19), diameter of the rollers"""
    section_ratio: float = parameter(1.0, minimum=0.0, maximum=10.0)
    """h_t / w_t of Eq. (19), height divided by width of the rollers' tread"""
    bearing_friction: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Friction force of the rollers' bearings at the rollers' surface, divided by the load"""
    roller_mass: float = parameter(0.0, unit="kg", minimum=0.0, maximum=1.0e3)
    """Mass of the roller in contact, which is a solid cylinder"""

    @property
    def constant_share(self) -> float:
        """Ratio of friction to load at a small load [1]."""
        return self.rolling_resistance + self.bearing_friction

    @property
    def growing_share(self) -> float:
        """Increase of the ratio of friction to load per unit of load, Eq. (19) [1/N]."""
        return self.elasticity / self.roller_diameter * math.sqrt(self.section_ratio)

    @property
    def inertia(self) -> float:
        """Moment of inertia of a roller divided by its squared radius, ``m_r / 2`` [kg]."""
        return 0.5 * self.roller_mass

    @property
    def active(self) -> bool:
        """Whether any loss is configured."""
        shares = self.constant_share, self.speed_growth, self.growing_share
        return max(*shares, self.inertia) > 0.0
