"""Positions and directions of the wheels.

Figures and equations are those of the dissertation; Figures 13 and 14 show the symbols. Frames
follow REP-103: the body frame `base_link` has x forward, y left, z up. Its origin may be anywhere
on the platform; the center of the wheels is derived. `k` is the unit ground normal, so that for
vectors in the ground plane ``a x k = (a_y, -a_x)`` and ``cross(a, b) = a_x b_y - a_y b_x``.

The roller angle gamma is the angle from the rolling direction to the axis of the roller on the
ground: 0 for the kiwi drive, +45 or -45 deg for a Mecanum wheel. The sign of the active direction
follows Eq. (30), ``u_i . n_wi = -cos(gamma)``; it has no physical effect.

A conventional wheel has no rollers. It rolls like a wheel with gamma = 0, but also exerts a force
along its passive direction, which is its axis.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import cached_property

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.quantities import LARGEST_OFFSET, BoolArray, FloatArray

TYPICAL_WIDTH = 0.4
"""Ratio of a wheel's width to its diameter where the width is unknown [1], such as 80 mm for a
Mecanum wheel of 203 mm"""

_ROUNDING = 1e-6
"""Limit on the error of a center due to positions that are rounded in a file [m]"""


NO_ROLLERS = 90.0
"""Roller angle of a wheel without rollers [deg]; an omni-wheel cannot have this angle"""


class WheelMount(Configuration):
    """One wheel on the platform, in the body frame."""

    kind: str = parameter("omni", choices=("omni", "conventional"))
    """Kind of wheel: `omni` has rollers, `conventional` has none, so that it resists sideways
    motion"""
    x: float = parameter(unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the wheel contact, forward of base_link"""
    y: float = parameter(unit="m", minimum=-LARGEST_OFFSET, maximum=LARGEST_OFFSET)
    """Position of the wheel contact, left of base_link"""
    heading_deg: float = parameter(0.0, unit="deg", minimum=-360.0, maximum=360.0)
    """Rolling direction u of the wheel, counter-clockwise from the forward direction"""
    roller_angle_deg: float = parameter(NO_ROLLERS, unit="deg", minimum=-180.0, maximum=180.0)
    """Axis of the roller on the ground, counter-clockwise from the rolling direction (gamma: 0 for
    a kiwi drive, +/-45 for Mecanum wheels); required for an omni-wheel"""
    radius: float = parameter(0.2, unit="m", minimum=1e-3, maximum=10.0)
    """Radius of the unloaded wheel including its rollers"""
    width: float = parameter(0.0, unit="m", minimum=0.0, maximum=10.0)
    """Width of the wheel, for stopping areas and pictures; 0 if unknown, which stands for 0.4 times
    the diameter"""
    steering_limit_deg: float = parameter(0.0, unit="deg", minimum=0.0, maximum=360.0)
    """Largest steering angle of a conventional wheel to either side of its heading; 0 if the wheel
    is not steered"""
    steering_rate_deg: float = parameter(90.0, unit="deg/s", above=0.0, maximum=3600.0)
    """Largest rate of the steering angle"""

    def check_consistency(self) -> None:
        """Check that only an omni-wheel has a roller angle, and only another wheel is steered.

        Raises:
            ConfigurationError: a value does not belong to this kind of wheel.
        """
        if self.kind == "omni" and self.steering_limit_deg > 0.0:
            raise ConfigurationError(
                "steering_limit_deg", "only a wheel with kind: conventional can be steered"
            )
        if self.kind == "conventional" and self.roller_angle_deg != NO_ROLLERS:
            raise ConfigurationError(
                "roller_angle_deg", "a wheel with kind: conventional has no rollers; omit the angle"
            )

    @property
    def is_steered(self) -> bool:
        """Whether the wheel is steered."""
        return self.steering_limit_deg > 0.0

    @property
    def assumed_width(self) -> float:
        """Width of the wheel, typical if it is unknown [m]."""
        return self.width or TYPICAL_WIDTH * 2.0 * self.radius


@dataclasses.dataclass(frozen=True, eq=False)
class PlatformGeometry:
    """Positions and directions of N wheels as arrays in the body frame.

    Attributes:
        names: wheel names, in the order of the rows below.
        position: ``r_i``, wheel contact points [m], in the body frame, shape (N, 2).
        axis: ``n_i``, unit vectors along the wheel axes, shape (N, 2).
        rolling: ``u_i = n_i x k``, unit rolling directions, shape (N, 2).
        active: ``n_wi``, unit roller axes (active directions), shape (N, 2).
        passive: ``u_wi = n_wi x k``, unit free-rolling directions, shape (N, 2).
        roller_angle: roller angles gamma [rad], 0 for conventional wheels, shape (N,).
        radius: radii R of the unloaded wheels [m], shape (N,).
        conventional: whether each wheel has no rollers, shape (N,).
    """

    names: tuple[str, ...]
    position: FloatArray
    axis: FloatArray
    rolling: FloatArray
    active: FloatArray
    passive: FloatArray
    roller_angle: FloatArray
    radius: FloatArray
    conventional: BoolArray

    @classmethod
    def from_wheels(cls, wheels: Mapping[str, WheelMount]) -> PlatformGeometry:
        """Return the geometry of the wheels of a platform.

        Args:
            wheels: mounting of each wheel, keyed by name; all arrays have a row for each wheel in
                this order.

        Raises:
            ConfigurationError: no wheel is given.
        """
        if not wheels:
            raise ConfigurationError("wheels", "a platform needs at least one wheel")
        mounts = list(wheels.values())
        heading = np.array([math.radians(mount.heading_deg) for mount in mounts])
        conventional = np.array([mount.kind == "conventional" for mount in mounts])
        gamma = np.array([math.radians(mount.roller_angle_deg) for mount in mounts])
        gamma[conventional] = 0.0
        rolling = _directions(heading)
        active = -_directions(heading + gamma)  # Eq. (30): u . n_w = -cos(gamma)
        return cls(
            names=tuple(wheels),
            position=np.array([[mount.x, mount.y] for mount in mounts]),
            axis=np.column_stack((-rolling[:, 1], rolling[:, 0])),
            rolling=rolling,
            active=active,
            passive=np.column_stack((active[:, 1], -active[:, 0])),
            roller_angle=gamma,
            radius=np.array([mount.radius for mount in mounts]),
            conventional=conventional,
        )

    @cached_property
    def center(self) -> FloatArray:
        """Return the center of the wheels: the mean of their contact points [m], shape (2,).

        A coordinate that differs from 0 only by the rounding of positions is exactly 0.
        """
        center: FloatArray = np.mean(self.position, axis=0)
        center[np.abs(center) < _ROUNDING] = 0.0
        return center

    def seen_from(self, point: FloatArray) -> PlatformGeometry:
        """Return the wheels with positions relative to a point in the body frame [m]."""
        return dataclasses.replace(self, position=self.position - point)

    @cached_property
    def lever(self) -> FloatArray:
        """Return the lever arms ``n_wi . (k x r_i)`` of the active directions [m], shape (N,)."""
        return cross(self.position, self.active)

    @cached_property
    def rim(self) -> FloatArray:
        """Return the rim speed along each active direction divided by the wheel speed [m].

        This is ``R_i u_i . n_wi``, shape (N,).
        """
        return np.asarray(self.radius * np.sum(self.active * self.rolling, axis=1))


def _directions(angle: FloatArray) -> FloatArray:
    """Return unit vectors, shape (N, 2), at angles from the x axis [rad], shape (N,).

    For a direction along an axis, the other component is exactly 0.
    """
    vectors = np.column_stack((np.cos(angle), np.sin(angle)))
    vectors[np.abs(vectors) < 1e-15] = 0.0
    return vectors


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return ``a_x b_y - a_y b_x`` for planar vectors of shape (..., 2)."""
    product: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def turned(vectors: FloatArray, angle: FloatArray | float) -> FloatArray:
    """Return planar vectors, shape (..., 2), rotated counter-clockwise by angles [rad]."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.asarray(np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1))
