"""Roller geometry compared with rotated bodies, and Eq. (16) with their velocities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from reference_equations import roller_centers, wheel_rate
from scipy.optimize import minimize_scalar

from omni_core.geometry import PlatformGeometry, WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray
from omni_sim.wheel.roller_contact import nearest_roller, roller_contact
from omni_sim.wheel.roller_geometry import AXIS, RollerGeometry

ANGLES_DEG = [-45.0, 20.0, 45.0, 60.0]


def wheel(roller_angle_deg: float, heading_deg: float = 0.0, rollers: int = 8) -> RollerGeometry:
    return RollerGeometry(
        alpha=math.radians(heading_deg + 90.0),
        delta=math.radians(90.0 + roller_angle_deg),
        distance=0.155,
        radius=0.2,
        rollers=rollers,
    )


def turned_roller(geometry: RollerGeometry, gamma: float) -> tuple[FloatArray, FloatArray]:
    """Return middle and direction of a roller's axis after rotation about the wheel axis."""
    a = geometry.wheel_axis
    up = np.array([0.0, 0.0, 1.0])

    def turn(v: FloatArray) -> FloatArray:  # Rodrigues
        rotated = v * math.cos(gamma) + np.cross(a, v) * math.sin(gamma)
        return np.asarray(rotated + a * (a @ v) * (1.0 - math.cos(gamma)), dtype=np.float64)

    lowest = -geometry.distance * up
    axis = math.cos(geometry.delta) * a + math.sin(geometry.delta) * np.cross(up, a)
    return turn(lowest), turn(axis)


def barrel_radius(geometry: RollerGeometry, along: float) -> float:
    """Return the radius of the largest body of revolution inside the wheel's cylinder."""
    middle, b = turned_roller(geometry, 0.0)
    a = geometry.wheel_axis
    point = middle + along * b
    side = np.cross(b, [0.0, 0.0, 1.0])
    phi = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 4001)
    ray = np.outer(np.sin(phi), side) - np.outer(np.cos(phi), np.cross(side, b))
    # |p + t ray|, seen along a, equals r
    p, q = point - a * (a @ point), ray - np.outer(ray @ a, a)
    half, square = q @ p, np.sum(q * q, axis=1)
    reach = (-half + np.sqrt(half**2 - square * (p @ p - geometry.radius**2))) / square
    return float(np.min(reach))


@pytest.mark.parametrize("roller_angle_deg", ANGLES_DEG)
@pytest.mark.parametrize("share", [-0.9, 0.0, 0.4, 0.9])
def test_roller_touches_the_ground_with_its_lowest_point(
    roller_angle_deg: float, share: float
) -> None:
    geometry = wheel(roller_angle_deg, heading_deg=25.0)
    gamma = share * geometry.half_pitch
    middle, b = turned_roller(geometry, gamma)
    np.testing.assert_allclose(geometry.roller_axis(gamma), b, atol=1e-12)  # Eq. (9)
    level = math.hypot(b[0], b[1])

    def height(along: float) -> float:
        return float(middle[2] + along * b[2] - level * barrel_radius(geometry, along))

    lowest = minimize_scalar(
        height, bounds=(-0.15, 0.15), method="bounded", options={"xatol": 1e-9}
    )
    assert lowest.success
    # The wheel's axis stays level, ...
    assert lowest.fun == pytest.approx(-geometry.radius, abs=1e-6)
    radius = barrel_radius(geometry, lowest.x)
    outward = np.array([b[0] * b[2], b[1] * b[2], -level * level]) / level
    touching = middle + lowest.x * b + radius * outward
    # ... the contact is that of Eq. (10), ...
    np.testing.assert_allclose(geometry.contact_point(gamma), touching[:2], atol=2e-5)
    # ... and the surface there turns about the roller's axis as on this lever.
    *_, length, depth = roller_contact(gamma, np.array(geometry.constants[0], AXIS))
    assert (geometry.radius - depth) * length == pytest.approx(radius, abs=1e-5)
    assert geometry.distance / math.cos(gamma) == pytest.approx(depth)


@pytest.mark.parametrize("roller_angle_deg", [*ANGLES_DEG, 0.0])
@pytest.mark.parametrize("heading_deg", [0.0, 140.0])
def test_kernel_has_the_directions_of_the_platform(
    roller_angle_deg: float, heading_deg: float
) -> None:
    geometry = wheel(roller_angle_deg, heading_deg)
    mount = WheelMount(x=0.0, y=0.0, heading_deg=heading_deg, roller_angle_deg=roller_angle_deg)
    platform = PlatformGeometry.from_wheels({"wheel": mount})
    n_x, n_y, x, y, rim, *_ = roller_contact(0.0, np.array(geometry.constants[0], AXIS))
    np.testing.assert_allclose([n_x, n_y], platform.active[0], atol=1e-12)
    assert rim == pytest.approx(-math.cos(math.radians(roller_angle_deg)))  # Eq. (30)
    np.testing.assert_allclose([x, y], 0.0, atol=1e-15)
    for gamma in (-0.3, 0.2):
        n_x, n_y, x, y, rim, *_ = roller_contact(gamma, np.array(geometry.constants[0], AXIS))
        np.testing.assert_allclose([x, y], geometry.contact_point(gamma), atol=1e-15)
        np.testing.assert_allclose(
            abs(geometry.active_direction(gamma) @ [n_x, n_y]), 1.0, atol=1e-12
        )
        assert n_x * platform.active[0, 0] + n_y * platform.active[0, 1] > 0.9
        assert rim == pytest.approx(n_x * platform.rolling[0, 0] + n_y * platform.rolling[0, 1])


@pytest.mark.parametrize("roller_angle_deg", ANGLES_DEG)
def test_wheel_rate_of_equation_16_leaves_no_velocity_in_the_contact(
    roller_angle_deg: float,
) -> None:
    geometry = wheel(roller_angle_deg, heading_deg=-30.0)
    twist = np.array([1.2, -0.7, 0.9])
    for gamma in (-0.3, 0.0, 0.15):
        rate = wheel_rate(geometry, gamma, twist)
        middle, b = turned_roller(geometry, gamma)
        contact = np.array([*geometry.contact_point(gamma), -geometry.radius])
        velocity = np.array([*twist[:2], 0.0]) + np.cross([0.0, 0.0, twist[2]], contact)
        velocity += np.cross(rate * geometry.wheel_axis, contact)
        turning = np.cross(b, contact - middle)  # a roller can only take away along this
        across = np.cross(velocity, turning)[2] / np.linalg.norm(turning)
        assert across == pytest.approx(0.0, abs=1e-12)
        assert turning[2] == pytest.approx(0.0, abs=1e-12)


def test_wheel_rate_under_the_center_is_that_of_equation_28() -> None:
    wheels = {
        "a": WheelMount(x=0.6, y=0.5, roller_angle_deg=-45.0),
        "b": WheelMount(x=0.6, y=-0.5, roller_angle_deg=45.0),
        "c": WheelMount(x=-0.6, y=0.5, roller_angle_deg=45.0),
        "d": WheelMount(x=-0.6, y=-0.5, heading_deg=20.0, roller_angle_deg=-30.0),
    }
    twist = np.array([1.0, 0.4, -0.6])
    rates = PlatformKinematics(wheels).wheel_speeds(twist)
    for mount, rate in zip(wheels.values(), rates, strict=True):
        geometry = RollerGeometry(
            alpha=math.radians(mount.heading_deg + 90.0),
            delta=math.radians(90.0 + mount.roller_angle_deg),
            distance=0.15,
            radius=mount.radius,
            rollers=9,
            center=(mount.x, mount.y),
        )
        assert wheel_rate(geometry, 0.0, twist) == pytest.approx(rate)


def test_contact_jumps_from_edge_to_edge_at_every_change_of_rollers() -> None:
    geometry = wheel(45.0, rollers=6)
    angle = np.linspace(0.0, 2.0 * np.pi, 6001)
    gamma = geometry.roller_angle(angle)
    contact = geometry.contact_point(gamma)
    step = np.linalg.norm(np.diff(contact, axis=0), axis=1)
    jumps = np.flatnonzero(step > 0.5 * geometry.jump)
    np.testing.assert_allclose(angle[jumps], np.pi / 6.0 * np.arange(1, 12, 2), atol=0.002)
    np.testing.assert_allclose(step[jumps], geometry.jump, rtol=0.01)
    edge = 2.0 * geometry.distance * math.tan(math.pi / 6.0)  # of rollers at 45 deg
    assert geometry.jump == pytest.approx(edge)
    pitch = 2.0 * geometry.half_pitch
    numbers = [nearest_roller(value, pitch) for value in angle]
    np.testing.assert_allclose(gamma, angle - pitch * np.array(numbers), atol=1e-12)


def test_roller_centers_are_those_of_equation_17() -> None:
    geometry = wheel(45.0, rollers=6)
    centers = roller_centers(geometry)
    np.testing.assert_allclose(np.linalg.norm(centers, axis=1), geometry.distance)
    np.testing.assert_allclose(centers[-1], [0.0, 0.0, geometry.distance], atol=1e-15)
    np.testing.assert_allclose(centers[2], [0.0, 0.0, -geometry.distance], atol=1e-15)


@pytest.mark.parametrize(
    ("changed", "problem"),
    [({"rollers": 2}, "at least 3"), ({"delta": math.pi}, "parallel"), ({"distance": 0.195}, "d")],
)
def test_wheels_that_cannot_be_built_are_refused(changed: dict[str, float], problem: str) -> None:
    values = {"alpha": 0.0, "delta": 0.8, "distance": 0.15, "radius": 0.2, "rollers": 8, **changed}
    with pytest.raises(ValueError, match=problem):
        RollerGeometry(**values)  # type: ignore[arg-type]
