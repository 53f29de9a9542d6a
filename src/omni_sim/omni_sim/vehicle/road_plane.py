"""Contact of a wheel with uneven ground: road plane, contact points and camber, Eqs. (5)-(7).

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 2.3.2, after the contact model of TMeasy (Figure 8). The ground ``z(x, y)`` is replaced
under each wheel by the plane of four points before, behind, left and right of its projection.

The radial direction is ``e_zR = e_x x e_yR``, as printed in Eq. (6). It points from the contact to
the center of the wheel. All frames have their axes parallel to the world's, with z up.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray
from omni_sim.ground.elevation import Terrain, elevation_at


@lean
def plane_of_points(
    front: float, back: float, left: float, right: float, distance: float
) -> tuple[float, float, float, float]:
    """Return the plane through four points at ``distance`` around a projection, Eq. (5).

    With ``r_21`` from back to front and ``r_43`` from right to left, both of horizontal length
    ``2 distance``, ``e_n = r_21 x r_43 / |r_21 x r_43|``.

    Args:
        front: height of the point before the projection [m].
        back: height of the point behind the projection [m].
        left: height of the point on the left of the projection [m].
        right: height of the point on the right of the projection [m].
        distance: distance of the points from the projection [m].

    Returns:
        Height of the plane at the projection [m], then ``e_n`` along forward, left and up [1].
    """
    along = (front - back) / (2.0 * distance)
    across = (left - right) / (2.0 * distance)
    up = 1.0 / math.sqrt(1.0 + along * along + across * across)
    return 0.25 * (front + back + left + right), -along * up, -across * up, up


@lean
def road_plane_at(
    terrain: Terrain, x: float, y: float, cos: float, sin: float
) -> tuple[float, float, float, float]:
    """Return the local road plane of an analytic ground, Eq. (5), for the kernels.

    Args:
        terrain: height of the ground.
        x: x of the wheel center in the world [m].
        y: y of the wheel center in the world [m].
        cos: cosine of the direction that counts as forward [1].
        sin: sine of the direction that counts as forward [1].

    Returns:
        Height of the plane [m] and the three components of ``e_n`` in the world frame [1].
    """
    parts, distance = terrain.parts, terrain.sampling
    d_x, d_y = distance * cos, distance * sin
    z, forward, left, up = plane_of_points(
        elevation_at(parts, x + d_x, y + d_y),
        elevation_at(parts, x - d_x, y - d_y),
        elevation_at(parts, x - d_y, y + d_x),
        elevation_at(parts, x + d_y, y - d_x),
        distance,
    )
    return z, cos * forward - sin * left, sin * forward + cos * left, up


@dataclasses.dataclass(frozen=True)
class RoadPlane:
    """The plane that approximates the ground under a wheel.

    Attributes:
        point: point of the plane vertically above or below the wheel's center [m], shape (3,).
        normal: ``e_n``, upwards [1], shape (3,).
    """

    point: FloatArray
    normal: FloatArray


@dataclasses.dataclass(frozen=True)
class WheelContact:
    """Contact of a wheel with its road plane.

    Attributes:
        point: geometric contact point P, Eq. (6), world frame [m], shape (3,).
        longitudinal: ``e_x``, along the intersection of road plane and wheel plane [1], shape (3,).
        lateral: ``e_y`` in the road plane, to the left of ``e_x`` [1], shape (3,).
        normal: ``e_n`` of the road plane [1], shape (3,).
        radial: ``e_zR`` from P to the wheel center [1], shape (3,).
        camber: angle ``beta`` between wheel axis and road plane [rad].
        static_radius: ``r_S``, distance from the wheel center to P [m].
    """

    point: FloatArray
    longitudinal: FloatArray
    lateral: FloatArray
    normal: FloatArray
    radial: FloatArray
    camber: float
    static_radius: float


def wheel_contact(center: ArrayLike, axis: ArrayLike, plane: RoadPlane) -> WheelContact:
    """Return the geometric contact of a wheel, Eq. (6), and its camber.

    Args:
        center: wheel center ``r_0M`` in the world [m], shape (3,), above the plane.
        axis: unit vector ``e_yR`` along the wheel axis, to the left, shape (3,).
        plane: local road plane.

    Raises:
        ValueError: the wheel axis is parallel to the road normal, so the wheel is on its side, or
            the wheel center is not above the plane.
    """
    middle = np.asarray(center, dtype=np.float64)
    e_yr = np.asarray(axis, dtype=np.float64)
    e_n = plane.normal
    along = np.cross(e_yr, e_n)
    size = float(np.linalg.norm(along))
    if size < 1e-9:
        raise ValueError("the wheel axis is along the road's normal: the wheel is on its side")
    e_x = along / size
    e_zr = np.cross(e_x, e_yr)
    clearance = float(e_n @ (middle - plane.point))
    if clearance <= 0.0:
        raise ValueError("the wheel center must be above its road plane")
    static_radius = clearance / float(e_n @ e_zr)
    return WheelContact(
        point=middle - static_radius * e_zr,  # Eq. (6)
        longitudinal=e_x,
        lateral=np.cross(e_n, e_x),
        normal=e_n,
        radial=e_zr,
        camber=camber_angle(e_yr, e_n),
        static_radius=static_radius,
    )


def camber_angle(axis: ArrayLike, normal: ArrayLike) -> float:
    """Return ``beta = arcsin(e_yR . e_n)`` [rad] for a wheel axis and a road normal."""
    product = float(np.dot(np.asarray(axis), np.asarray(normal)))
    return math.asin(min(max(product, -1.0), 1.0))
