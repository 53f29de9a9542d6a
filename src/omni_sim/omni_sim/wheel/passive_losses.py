"""Losses along the passive direction: rolling resistance (19), bearing friction, roller inertia.

Section 2.4.2 of the dissertation lists and neglects them; here they are off by default.
The roller in contact rolls along the passive direction ``u_w`` with the rim's velocity there,

    w = u_w . v_i - omega r_D (u_w . u_i).

So a wheel with rollers at 0 deg that rolls in its own direction, or a Mecanum wheel that rolls
straight ahead, turns no roller and has no losses. The force ``f`` along ``u_w`` acts on the vehicle
at the wheel, and with the torque ``-r_D (u_w . u_i) f`` on the wheel's spin:

    f = -(f_r + f_b + C F_z / D sqrt(h_t / w_t)) F_z sign(w) - m_r / 2 dw/dt.

Rolling resistance and bearing friction hold a roller at rest up to the same force. The
roller is a solid cylinder, ``I = m_r r^2 / 2``, so its radius does not matter. Neglected are the
acceleration of a roller that comes into contact, and the rolling resistance of the wheel as a
whole. Individual rollers (`vehicle.roller_dynamics`) have an inertia of their own; each roller that
carries load has the same resistance.
"""

import math

from omni_platform.configuration import Configuration, parameter
from omni_platform.kernels import lean


class PassiveLossConfiguration(Configuration):
    """Resistance of the rollers of every wheel; none by default."""

    rolling_resistance: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Rolling resistance of the rollers per load, the part independent of the load; about
    0.015 for car tires on concrete"""
    elasticity: float = parameter(0.0, unit="m/N", minimum=0.0, maximum=1.0e-3)
    """C of Eq. (19), the resistance that grows with the load"""
    roller_diameter: float = parameter(0.08, unit="m", minimum=1.0e-3, maximum=10.0)
    """D of Eq. (19)"""
    section_ratio: float = parameter(1.0, minimum=0.0, maximum=10.0)
    """h_t / w of Eq. (19), height over width of the rollers' tread"""
    bearing_friction: float = parameter(0.0, minimum=0.0, maximum=1.0)
    """Friction of the rollers' bearings per load, at the rollers' surface"""
    roller_mass: float = parameter(0.0, unit="kg", minimum=0.0, maximum=1.0e3)
    """Mass of the roller in contact, a solid cylinder"""

    @property
    def constant_share(self) -> float:
        """Friction per load that does not depend on the load [1]."""
        return self.rolling_resistance + self.bearing_friction

    @property
    def growing_share(self) -> float:
        """Friction per load and load, Eq. (19) [1/N]."""
        return self.elasticity / self.roller_diameter * math.sqrt(self.section_ratio)

    @property
    def inertia(self) -> float:
        """Inertia ``I / r^2 = m_r / 2`` of a roller against its surface speed [kg]."""
        return 0.5 * self.roller_mass

    @property
    def active(self) -> bool:
        """Whether there are any losses."""
        return max(self.constant_share, self.growing_share, self.inertia) > 0.0


@lean
def passive_force(
    coming: float,
    now: float,
    before: float,
    mobility: float,
    capacity: float,
    inertia: float,
    dt: float,
) -> float:
    """Return the force of one roller on the vehicle along the passive direction [N].

    The force is implicit in the roller's speed at the end of the step, so that friction can hold
    the roller at rest.

    Args:
        coming: roller's surface speed at the end of the step with unchanged forces [m/s].
        now: surface speed at the start of the step [m/s].
        before: force of the last step [N].
        mobility: change of the surface speed per force [m/s per N].
        capacity: largest friction, rolling resistance and bearing [N].
        inertia: inertia of the roller against its surface speed [kg].
        dt: step [s].
    """
    rate = inertia / dt
    gain = 1.0 + mobility * rate
    free = (coming - mobility * before + mobility * rate * now) / gain
    friction = min(max(-free * gain / mobility, -capacity), capacity)
    speed = free + mobility * friction / gain
    return friction - rate * (speed - now)
