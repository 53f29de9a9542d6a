"""Masses of the vehicle: body and load are separate rigid masses."""

from __future__ import annotations

import dataclasses

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.quantities import LARGEST_OFFSET, FloatArray, IntArray

MAXIMUM_WHEELS = 32
"""Limit on the number of wheels of a vehicle; `lifted_wheels` stores sets of wheels as bits."""


class MassConfiguration(Configuration):
    """A rigid mass on the platform, described in the body frame."""

    mass: float = parameter(unit="kg", minimum=0.0, maximum=1.0e5)
    """Mass"""
    x: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the center of gravity, forward of base_link"""
    y: float = parameter(0.0, unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the center of gravity, left of base_link"""
    height: float = parameter(unit="m", minimum=0.0, maximum=20.0)
    """Height of the center of gravity above the ground"""
    yaw_inertia: float = parameter(0.0, unit="kg m^2", minimum=0.0, maximum=1.0e9)
    """Moment of inertia about the vertical axis through the mass's own center of gravity"""


class ForkConfiguration(Configuration):
    """Height of the load over time on a fork that lifts (Appendix A), interpolated linearly.

    A lift is slow, so the inertial force of the vertical motion is neglected, as is the change of
    pitch and roll inertia.
    """

    time: tuple[float, ...] = parameter((), unit="s", minimum=0.0, maximum=3600.0)
    """Times of the rows, in increasing order"""
    height: tuple[float, ...] = parameter((), unit="m", minimum=0.0, maximum=20.0)
    """Height of the load's center of gravity above the ground, which replaces `load.height`"""

    def check_consistency(self) -> None:
        """Check that the table is valid.

        Raises:
            ConfigurationError: the columns differ in length, or the times do not increase.
        """
        if len(self.time) != len(self.height):
            rows = f"has {len(self.height)} rows but must have {len(self.time)}, like time"
            raise ConfigurationError("height", rows)
        if np.any(np.diff(self.time) <= 0.0):
            raise ConfigurationError("time", "must increase from row to row")


@dataclasses.dataclass(frozen=True)
class MassProperties:
    """Mass, center of gravity and inertia of the vehicle with its load, for the planar dynamics.

    Attributes:
        mass: mass m [kg].
        center: ``r_g``, center of gravity in the body frame [m], shape (2,).
        height: height of the center of gravity above the ground [m].
        yaw_inertia: moment of inertia J about the vertical through the center of gravity [kg m^2].
    """

    mass: float
    center: FloatArray
    height: float
    yaw_inertia: float

    @classmethod
    def of(cls, *masses: MassConfiguration) -> MassProperties:
        """Return the properties of several masses together (parallel-axis theorem).

        The total mass must not be zero.
        """
        mass = np.array([part.mass for part in masses])
        position = np.array([[part.x, part.y] for part in masses])
        total = float(mass.sum())
        center = mass @ position / total
        offset = np.sum((position - center) ** 2, axis=1)
        inertia = sum(part.yaw_inertia for part in masses) + float(mass @ offset)
        height = float(mass @ np.array([part.height for part in masses])) / total
        return cls(total, center, height, inertia)


def support_polygon(position: FloatArray) -> IntArray:
    """Return the indices of the wheels on the convex hull, counter-clockwise.

    Args:
        position: wheel contacts [m], shape (N, 2).
    """
    order = np.lexsort((position[:, 1], position[:, 0]))
    points = position.tolist()
    chains = []
    for indices in (order.tolist(), order[::-1].tolist()):
        chain: list[int] = []
        for index in indices:
            while len(chain) >= 2:
                (a_x, a_y), (b_x, b_y), (c_x, c_y) = (points[i] for i in (*chain[-2:], index))
                if (b_x - a_x) * (c_y - b_y) - (b_y - a_y) * (c_x - b_x) > 0.0:
                    break
                chain.pop()
            chain.append(index)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1], dtype=np.int64)
