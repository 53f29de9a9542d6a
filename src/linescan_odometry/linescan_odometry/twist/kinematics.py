"""Kinematic constraint that replaces a missing sensor.

Source: dissertation, section 4.6 and Figure 70. A wheel that is not steered rolls along the body's
x axis and, as long as it grips, does not move sideways. The same is true for every point on the
line through its axle. For an axle at x = a, the constraint on the sideways velocity v_y and the yaw
rate Omega of the body is ``v_y + a Omega = 0``. It adds one row to the equations of the sensors.
The row equals that of a line camera at (a, 0) that measures zero along an axis to the left. The
constraint is valid for the driven axle of a differential drive and the rear axle of an Ackermann
drive, but not for omni-wheels.

When the vehicle skids, the constraint is wrong. Two cameras cannot detect the skid: the estimated
v_y then has an error as large as the skid velocity, while the covariance includes only the sideways
velocity of gripping wheels. The constraint is therefore used only if the sensors alone do not
determine the twist. Otherwise, it is only compared with the sensors to detect a skid.
"""

import math

from omni_platform.configuration import Configuration, parameter

NONE, UNSTEERED_AXLE = "none", "unsteered_axle"


class KinematicsConfiguration(Configuration):
    """Kinematic constraint of a vehicle while its wheels grip."""

    constraint: str = parameter(NONE, choices=(NONE, UNSTEERED_AXLE))
    """Constraint that is used if the sensors do not suffice: `none`, or `unsteered_axle` for an
    axle that does not slip sideways (differential and Ackermann drives)"""
    axle_x: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Position of the axle along x of base_link"""
    deviation: float = parameter(0.02, unit="m/s", above=0.0, maximum=100.0)
    """Standard deviation of the axle's sideways velocity while its wheels grip"""
    deviation_share: float = parameter(0.005, minimum=0.0, maximum=1.0)
    """Additional standard deviation of the axle's sideways velocity, divided by the largest
    velocity that any sensor measures"""

    @property
    def axle(self) -> float | None:
        """Position x of the axle without sideways slip [m], None without a constraint."""
        return self.axle_x if self.constraint == UNSTEERED_AXLE else None

    def variance(self, speed: float) -> float:
        """Return the variance of the axle's sideways velocity [m^2/s^2].

        Args:
            speed: magnitude of the largest velocity that a sensor measured [m/s].
        """
        return self.deviation**2 + math.pow(self.deviation_share * speed, 2)
