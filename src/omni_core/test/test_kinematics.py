"""Kinematics compared with the printed matrices (34), (35) and rigid-body motion."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_core.geometry import WheelMount, cross
from omni_core.kinematics import (
    PlatformKinematics,
    UnusablePlatformError,
    smallest_singular_value,
)

L, W, R = 1.2, 0.9, 0.2
# Eq. (35): its rows are rear-left, front-left, front-right, rear-right.
MECANUM = {
    "rear_left": WheelMount(x=-L / 2, y=W / 2, roller_angle_deg=45.0, radius=R),
    "front_left": WheelMount(x=L / 2, y=W / 2, roller_angle_deg=-45.0, radius=R),
    "front_right": WheelMount(x=L / 2, y=-W / 2, roller_angle_deg=45.0, radius=R),
    "rear_right": WheelMount(x=-L / 2, y=-W / 2, roller_angle_deg=-45.0, radius=R),
}
KIWI_RADIUS = 0.5


def kiwi_wheel(position_deg: float) -> WheelMount:
    """A wheel whose axis points outward at an angle and that rolls clockwise, Eq. (34)."""
    angle = math.radians(position_deg)
    return WheelMount(
        x=KIWI_RADIUS * math.cos(angle),
        y=KIWI_RADIUS * math.sin(angle),
        heading_deg=position_deg - 90.0,
        roller_angle_deg=0.0,
        radius=R,
    )


KIWI = {"first": kiwi_wheel(30.0), "second": kiwi_wheel(150.0), "third": kiwi_wheel(270.0)}


def test_mecanum_rows_are_equation_35() -> None:
    lever = (L + W) / 2
    printed = np.array([[1, 1, -lever], [1, -1, -lever], [1, 1, lever], [1, -1, lever]]) / R
    kinematics = PlatformKinematics(MECANUM)
    np.testing.assert_allclose(kinematics.wheel_speeds(np.eye(3)).T, printed, atol=1e-12)


def test_kiwi_rows_are_equation_34() -> None:
    root = math.sqrt(3.0) / 2.0
    r = KIWI_RADIUS
    printed = np.array([[0.5, -root, -r], [0.5, root, -r], [-1.0, 0.0, -r]]) / R
    kinematics = PlatformKinematics(KIWI)
    np.testing.assert_allclose(kinematics.wheel_speeds(np.eye(3)).T, printed, atol=1e-12)


def test_directions_follow_the_definitions() -> None:
    g = PlatformKinematics(MECANUM).geometry
    np.testing.assert_allclose(g.rolling, np.column_stack((g.axis[:, 1], -g.axis[:, 0])))
    np.testing.assert_allclose(g.passive, np.column_stack((g.active[:, 1], -g.active[:, 0])))
    np.testing.assert_allclose(
        np.sum(g.rolling * g.active, axis=1), -np.cos(g.roller_angle), atol=1e-15
    )


@pytest.mark.parametrize("wheels", [MECANUM, KIWI])
def test_base_link_may_be_anywhere(wheels: dict[str, WheelMount]) -> None:
    moved = {
        name: dataclasses.replace(wheel, x=wheel.x + 30.0, y=wheel.y - 20.0)
        for name, wheel in wheels.items()
    }
    own, other = PlatformKinematics(wheels), PlatformKinematics(moved)
    assert not own.geometry.center.any()
    np.testing.assert_allclose(other.geometry.center, [30.0, -20.0])
    np.testing.assert_allclose(
        smallest_singular_value(other.matrix, other.geometry),
        smallest_singular_value(own.matrix, own.geometry),
    )
    # A turn about the old base_link turns the wheels as before.
    twist = np.array([0.0, 0.0, 0.7])
    about_old = np.array([0.7 * -20.0, 0.7 * -30.0, 0.7])  # v = Omega k x (r_new - r_old), Eq. (23)
    np.testing.assert_allclose(other.wheel_speeds(about_old), own.wheel_speeds(twist), atol=1e-9)


angles = st.floats(-80.0, 80.0)
speeds = st.floats(-10.0, 10.0)


@given(st.lists(st.tuples(angles, angles), min_size=3, max_size=8), speeds, speeds, speeds)
def test_inverse_then_forward_returns_the_twist(
    wheels: list[tuple[float, float]], v_x: float, v_y: float, omega: float
) -> None:
    mounts = {
        f"w{i}": WheelMount(
            x=math.cos(2.1 * i),
            y=math.sin(2.1 * i),
            heading_deg=heading,
            roller_angle_deg=roller,
            radius=0.1 + 0.02 * i,
        )
        for i, (heading, roller) in enumerate(wheels)
    }
    try:
        kinematics = PlatformKinematics(mounts)
    except UnusablePlatformError:
        return
    if np.linalg.cond(kinematics.matrix) > 1e3:
        return
    twist = np.array([v_x, v_y, omega])
    speeds_rolling = kinematics.wheel_speeds(twist)
    np.testing.assert_allclose(kinematics.twist(speeds_rolling), twist, atol=1e-7)
    # Perfect rolling (28) means that no contact point slides along its active direction.
    g = kinematics.geometry
    hub = np.sum(g.active * kinematics.wheel_velocities(twist), axis=1)
    rim = speeds_rolling * g.radius * np.sum(g.active * g.rolling, axis=1)
    np.testing.assert_allclose(hub, rim, atol=1e-9)


def test_wheel_velocity_is_that_of_a_rigid_body() -> None:
    kinematics = PlatformKinematics(MECANUM)
    twist = np.array([1.0, -2.0, 0.7])
    dt = 1e-6
    angle = twist[2] * dt
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    r = kinematics.geometry.position
    moved = r @ turn.T + twist[:2] * dt
    np.testing.assert_allclose(kinematics.wheel_velocities(twist), (moved - r) / dt, atol=1e-5)


def test_roller_parallel_to_the_axis_is_refused_by_wheel() -> None:
    wheels = dict(MECANUM)
    wheels["front_left"] = WheelMount(x=L / 2, y=W / 2, roller_angle_deg=90.0)
    with pytest.raises(UnusablePlatformError, match=r"wheels\.front_left\.roller_angle_deg"):
        PlatformKinematics(wheels)


def test_unmirrored_rollers_are_refused_by_rank() -> None:
    wheels = {
        name: WheelMount(x=mount.x, y=mount.y, roller_angle_deg=45.0)
        for name, mount in MECANUM.items()
    }
    with pytest.raises(UnusablePlatformError, match="rank 2"):
        PlatformKinematics(wheels)


def test_two_wheels_are_refused_by_rank() -> None:
    wheels = {name: MECANUM[name] for name in ("rear_left", "front_left")}
    with pytest.raises(UnusablePlatformError, match="rank 2"):
        PlatformKinematics(wheels)


def test_cross_is_the_planar_cross_product() -> None:
    assert cross(np.array([1.0, 0.0]), np.array([0.0, 2.0])) == 2.0
