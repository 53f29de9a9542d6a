"""Kinematics of a platform on omni-wheels, Eqs. (23)-(35).

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 2.5.1, after G. Indiveri, IEEE Transactions on Robotics 25 (2009) 164-171. Equation (32)
contains a printing error; it is interpreted as ``omega_i = M_i (v_cx, v_cy, Omega)^T / (R_i cos
gamma_i)``.

A conventional wheel has no rollers, so a vehicle with such wheels cannot move in all directions:
its matrix may have a rank below 3, and its twist also meets the condition that these wheels do
not slip along their axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, lru_cache

import numpy as np

from omni_core.configuration import ConfigurationError
from omni_core.geometry import PlatformGeometry, WheelMount, cross
from omni_core.quantities import FloatArray

# A roller axis within 0.06 deg of the wheel axis cannot transmit a useful drive force.
_MINIMUM_COS_GAMMA = 1e-3
# Lower limit on the ratio of smallest to largest singular value of M, scaled as in
# `smallest_singular_value`.
_MINIMUM_CONDITION = 1e-6


class UnusablePlatformError(ConfigurationError):
    """The wheels do not allow motion in all three degrees of freedom."""


def require_omni_wheels(wheels: Mapping[str, WheelMount], what: str, remedy: str = "") -> None:
    """Raise an error unless all wheels are omni-wheels.

    Args:
        wheels: wheels of a platform, keyed by name.
        what: the law or tool that requires omni-wheels, for the message.
        remedy: what to do for other vehicles, as the end of the message.

    Raises:
        UnusablePlatformError: a wheel is conventional; the message names the wheel and `what`.
    """
    for name, mount in wheels.items():
        if mount.kind != "omni":
            raise UnusablePlatformError(
                f"wheels.{name}.kind",
                f"is {mount.kind}, but {what} requires a vehicle that can move in all three "
                "degrees of freedom, on omni-wheels only" + remedy,
            )


class PlatformKinematics:
    """Forward and inverse kinematics of N wheels with rollers at any angle, or without rollers.

    Attributes:
        geometry: positions and directions of the wheels.
        matrix: matrix ``M`` of Eq. (33), which maps the body twist to ``R_i cos gamma_i omega_i``
            [m/s], with columns in [1], [1] and [m], shape (N, 3).

    Raises:
        UnusablePlatformError: a wheel has ``cos gamma = 0``, or ``rank M < 3`` and no wheel is
            conventional.
    """

    def __init__(self, wheels: Mapping[str, WheelMount]) -> None:
        self.geometry = PlatformGeometry.from_wheels(wheels)
        geometry = self.geometry
        cos_gamma = np.cos(geometry.roller_angle)
        for name, value in zip(geometry.names, cos_gamma, strict=True):
            if abs(value) < _MINIMUM_COS_GAMMA:
                raise UnusablePlatformError(
                    f"wheels.{name}.roller_angle_deg",
                    "is required; at +/-90 deg the roller axis is parallel to the wheel axis "
                    "(cos gamma = 0), so the wheel cannot generate movement; choose another angle, "
                    "or kind: conventional for a wheel without rollers",
                )
        # Eq. (33)
        lever = np.sum(geometry.position * geometry.passive, axis=1)
        self.matrix: FloatArray = -np.column_stack((geometry.active, lever))
        if not geometry.conventional.any():
            _require_rank_three(self.matrix, geometry)
        self._inverse = self._inverse_with(geometry.radius)
        self._steered = next((name for name, mount in wheels.items() if mount.is_steered), "")

    @staticmethod
    def of(wheels: Mapping[str, WheelMount]) -> PlatformKinematics:
        """Return the kinematics of a set of wheels, from a cache if it was computed before."""
        return _laid_out(tuple(wheels.items()))

    def _inverse_with(self, radius: FloatArray) -> FloatArray:
        """Return the matrix from body twist to wheel speeds, Eqs. (30), (32), shape (N, 3).

        Args:
            radius: radii of the wheels [m], shape (N,).
        """
        cos_gamma = np.cos(self.geometry.roller_angle)
        inverse: FloatArray = self.matrix / (radius * cos_gamma)[:, np.newaxis]
        return inverse

    @cached_property
    def _forward(self) -> FloatArray:
        geometry = self.geometry
        gripping = geometry.conventional
        sideways = np.column_stack((geometry.passive, cross(geometry.position, geometry.passive)))
        rows = np.vstack((self._inverse, (sideways / geometry.radius[:, np.newaxis])[gripping]))
        forward = np.linalg.pinv(rows)[:, : len(gripping)]
        return np.ascontiguousarray(forward, dtype=np.float64)

    def wheel_speeds(self, twist: FloatArray, radius: FloatArray | None = None) -> FloatArray:
        """Return the wheel speeds for rolling without slip, Eqs. (28), (32).

        Args:
            twist: ``(v_cx, v_cy, Omega)`` in the body frame [m/s, m/s, rad/s], shape (..., 3).
            radius: effective rolling radii [m], shape (N,); by default the radii of the geometry.

        Returns:
            Wheel speeds [rad/s], shape (..., N).
        """
        return twist @ (self._inverse if radius is None else self._inverse_with(radius)).T

    def twist(self, wheel_speeds: FloatArray) -> FloatArray:
        """Return the body twist that fits the wheel speeds best (least squares).

        Conventional wheels do not slip along their axes in this fit.

        Args:
            wheel_speeds: speeds of the wheels [rad/s], shape (..., N).

        Returns:
            ``(v_cx, v_cy, Omega)`` in the body frame [m/s, m/s, rad/s], shape (..., 3).

        Raises:
            UnusablePlatformError: a wheel is steered.
        """
        if self._steered:
            raise UnusablePlatformError(
                f"wheels.{self._steered}",
                "is steered, so the wheel speeds alone do not determine the twist",
            )
        return wheel_speeds @ self._forward.T

    def wheel_velocities(self, twist: FloatArray) -> FloatArray:
        """Return the velocities of the wheel centers, Eqs. (23), (38).

        Args:
            twist: ``(v_cx, v_cy, Omega)`` in the body frame [m/s, m/s, rad/s], shape (3,).

        Returns:
            ``v_i = v_c + Omega k x r_i`` in the body frame [m/s], shape (N, 2).
        """
        r = self.geometry.position
        velocities: FloatArray = twist[:2] + twist[2] * np.column_stack((-r[:, 1], r[:, 0]))
        return velocities


@lru_cache(maxsize=64)
def _laid_out(wheels: tuple[tuple[str, WheelMount], ...]) -> PlatformKinematics:
    return PlatformKinematics(dict(wheels))


def smallest_singular_value(matrix: FloatArray, geometry: PlatformGeometry) -> float:
    """Return the smallest singular value of ``M``, made dimensionless [1].

    The third column of ``M`` is converted to the center of the wheels, so that the result does not
    depend on the position of base_link, and its lengths are divided by the largest distance between
    a wheel and this center.

    Args:
        matrix: matrix ``M`` of Eq. (33), with columns in [1], [1] and [m], shape (N, 3).
        geometry: positions of the wheels.
    """
    return float(_singular_values(matrix, geometry)[-1])


def _singular_values(matrix: FloatArray, geometry: PlatformGeometry) -> FloatArray:
    reach = float(np.max(np.linalg.norm(geometry.position - geometry.center, axis=1)))
    centered = matrix.copy()
    centered[:, 2] += geometry.passive @ geometry.center
    scale = np.array([1.0, 1.0, reach if reach > 0.0 else 1.0])
    values: FloatArray = np.linalg.svd(centered / scale, compute_uv=False)
    return values


def _require_rank_three(matrix: FloatArray, geometry: PlatformGeometry) -> None:
    singular_values = _singular_values(matrix, geometry)
    rank = int(np.sum(singular_values > _MINIMUM_CONDITION * singular_values[0]))
    if rank < 3:
        raise UnusablePlatformError(
            "wheels",
            f"the kinematic matrix M of {len(geometry.names)} wheels has rank {rank} and must have "
            "rank 3: some motion of the platform turns no wheel; move wheels apart or mirror "
            "the rollers of neighboring wheels",
        )
