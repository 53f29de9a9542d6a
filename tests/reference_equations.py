"""Equations of the dissertation that only tests use: (6), (16), (17) and (52).

They are written as printed, and independently of the kernels that the simulator and the law use.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from omni_core.geometry import PlatformGeometry
from omni_core.quantities import FloatArray
from omni_sim.vehicle import uneven_ground
from omni_sim.vehicle.placing import rolling_radius
from omni_sim.vehicle.uneven_ground import road_plane_at
from omni_sim.vehicle.vehicle import Vehicle
from omni_sim.wheel.roller_geometry import RollerGeometry


def force_directions(geometry: PlatformGeometry, twist: FloatArray) -> FloatArray:
    """Return ``f_hat_i = -sign(n_wi . v_i) n_wi``, shape (N, 2), Eq. (52).

    Args:
        geometry: the platform.
        twist: ``(v_cx, v_cy, Omega)`` in the body frame [m/s, m/s, rad/s], shape (3,).
    """
    sign = np.sign(sliding_velocities(geometry, twist))
    return np.asarray(-sign[:, np.newaxis] * geometry.active)


def sliding_velocities(geometry: PlatformGeometry, twist: FloatArray) -> FloatArray:
    """Return ``n_wi . v_i`` [m/s], shape (N,), with ``v_i`` of Eq. (38)."""
    return np.asarray(geometry.active @ twist[:2] + geometry.lever * twist[2])


def roller_centers(geometry: RollerGeometry) -> FloatArray:
    """Return ``d_i`` around the wheel: forward, along the axis, up [m], Eq. (17), shape (n, 3)."""
    angle = 2.0 * np.pi * np.arange(1, geometry.rollers + 1) / geometry.rollers
    directions = np.column_stack((np.sin(angle), np.zeros_like(angle), np.cos(angle)))
    return geometry.distance * directions


def wheel_rate(geometry: RollerGeometry, gamma: float, twist: ArrayLike) -> float:
    """Return the wheel speed ``gamma_dot`` for rolling without slip [rad/s], Eq. (16).

    Args:
        geometry: the wheel.
        gamma: wheel angle from the lowest position of the roller [rad].
        twist: ``(v_x, v_y, Omega)`` of the vehicle [m/s, m/s, rad/s], shape (3,).
    """
    v_x, v_y, omega = np.asarray(twist, dtype=np.float64)
    b, c = geometry.roller_axis(gamma), geometry.contact_point(gamma)
    driven = b[0] * (v_x - omega * c[1]) + b[1] * (v_y + omega * c[0])
    lever = b[0] * math.sin(geometry.alpha) - b[1] * math.cos(geometry.alpha)
    return float(driven / (geometry.radius * lever))


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


def wheel_contacts(vehicle: Vehicle) -> list[WheelContact]:
    """Return the contact of each wheel with its road plane, Eqs. (5), (6)."""
    height, forward, left, _, _, _ = uneven_ground.standing(vehicle.state, 0.0)
    body = vehicle.state.body[0]
    yaw = float(body["yaw"])
    turn = uneven_ground.orientation(yaw, forward, left)
    base = np.array([body["x"], body["y"], height])
    levers, directions = vehicle.state.plant.position, vehicle.kinematics.geometry.rolling
    contacts = []
    for lever, rolling, r_s in zip(levers, directions, rolling_radius(vehicle.state), strict=True):
        center = base + turn @ [*lever, r_s]
        c_x, c_y = float(center[0]), float(center[1])
        z, *normal = road_plane_at(vehicle.state.terrain, c_x, c_y, math.cos(yaw), math.sin(yaw))
        plane = RoadPlane(np.array([c_x, c_y, z]), np.array(normal))
        contacts.append(wheel_contact(center, turn @ [-rolling[1], rolling[0], 0.0], plane))
    return contacts
