"""The error functions compared with hand calculations, physics and symmetry."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_equations import force_directions, sliding_velocities

from omni_brake_assist.assist_step import fastest_wheel
from omni_brake_assist.configuration import WEIGHTINGS
from omni_brake_assist.laws.sliding_mode import SlidingManifold
from omni_brake_assist.weighting import weighting_function
from omni_core.geometry import PlatformGeometry, WheelMount, cross
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray

Wheels = dict[str, WheelMount]
ROOT = math.sqrt(0.5)
LEFT = np.array([0.0, 1.0])

speeds = st.floats(-12.0, 12.0, allow_subnormal=False)
# Products of smaller yaw rates than 1e-9 rad/s can vanish in floating point.
yaw_rates = st.floats(-4.0, 4.0).map(lambda rate: rate if abs(rate) > 1e-9 else 0.0)
directions = st.floats(-math.pi, math.pi)


def manifold(wheels: Wheels, weighting: str, k: int = 7) -> SlidingManifold:
    return SlidingManifold(PlatformGeometry.from_wheels(wheels), weighting_function(weighting, k))


def unit(angle: float) -> FloatArray:
    return np.array([math.cos(angle), math.sin(angle)])


def rotated(wheels: Wheels, degrees: float) -> Wheels:
    """Return the same platform in axes rotated clockwise by an angle."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return {
        name: dataclasses.replace(
            mount,
            x=c * mount.x - s * mount.y,
            y=s * mount.x + c * mount.y,
            heading_deg=mount.heading_deg + degrees,
        )
        for name, mount in wheels.items()
    }


def mirrored(wheels: Wheels) -> Wheels:
    return {
        name: dataclasses.replace(
            mount,
            y=-mount.y,
            heading_deg=-mount.heading_deg,
            roller_angle_deg=-mount.roller_angle_deg,
        )
        for name, mount in wheels.items()
    }


# Hand calculations, wheels in the order rear left, front left, front right, rear right.


def test_forces_of_straight_motion_point_backward_along_the_rollers(mecanum: Wheels) -> None:
    forces = force_directions(PlatformGeometry.from_wheels(mecanum), np.array([10.0, 0.0, 0.0]))
    expected = ROOT * np.array([[-1, -1], [-1, 1], [-1, -1], [-1, 1]])
    np.testing.assert_allclose(forces, expected, atol=1e-12)


def test_straight_motion_without_error_has_no_error_under_zero(mecanum: Wheels) -> None:
    errors = manifold(mecanum, "zero").errors(np.array([10.0, 0.0, 0.0]), LEFT)
    np.testing.assert_array_equal(errors.total, 0.0)


def test_parallel_component_of_straight_motion(mecanum: Wheels) -> None:
    # Every roller axis is at 45 deg: f_hat . v = -2 / sqrt(2).
    twist = np.array([2.0, 0.0, 0.0])
    for weighting, k, psi in (
        ("cosine", 1, ROOT),
        ("enhanced", 1, 1.0 - ROOT),
        ("enhanced", 7, (1.0 - ROOT) ** 7),
    ):
        errors = manifold(mecanum, weighting, k).errors(twist, LEFT)
        np.testing.assert_allclose(errors.total, -2.0 * ROOT * psi, rtol=1e-12)


def test_turning_left_releases_the_brakes_on_the_left(mecanum: Wheels) -> None:
    # Drag on the left increases the rotation to the left: moment (0.6 + 0.45)/sqrt(2) at each
    # wheel, times 0.5.
    errors = manifold(mecanum, "zero").errors(np.array([2.0, 0.0, 0.5]), LEFT)
    moment = 1.05 * ROOT * 0.5
    np.testing.assert_allclose(errors.angular, [moment, moment, -moment, -moment], rtol=1e-12)
    np.testing.assert_array_equal(errors.perpendicular, 0.0)


def test_drifting_left_releases_the_wheels_that_push_left(mecanum: Wheels) -> None:
    # Forces of front left and rear right point left, 0.5 m/s of drift times 1/sqrt(2).
    errors = manifold(mecanum, "zero").errors(np.array([5.0, 0.5, 0.0]), LEFT)
    push = 0.5 * ROOT
    np.testing.assert_allclose(errors.perpendicular, [-push, push, -push, push], rtol=1e-12)
    np.testing.assert_array_equal(errors.angular, 0.0)


def test_parallel_component_takes_the_part_of_the_wheel_velocity_along_the_platform(
    kiwi: Wheels,
) -> None:
    # The third wheel sits at (0, -0.5) and its roller points along x; Omega = 2 adds 1 m/s to it.
    twist = np.array([3.0, 0.0, 2.0])
    errors = manifold(kiwi, "cosine").errors(twist, LEFT)
    assert errors.parallel[2] == pytest.approx(-4.0)
    # The first sits at 30 deg: v = (2.5, sqrt(3)/2), roller (1/2, -sqrt(3)/2), so that
    # n . v = 1/2, |v| = sqrt(7), psi = 1/(2 sqrt(7)), f_hat . e = -1/2, along = 2.5.
    assert errors.parallel[0] == pytest.approx(-0.5 / math.sqrt(7.0) * 0.5 * 2.5)


# Physics


@given(v_x=speeds, v_y=speeds, omega=yaw_rates, across=directions)
def test_zero_brakes_exactly_the_wheels_that_drain_drift_and_rotation(
    mecanum: Wheels, kiwi: Wheels, v_x: float, v_y: float, omega: float, across: float
) -> None:
    twist, p = np.array([v_x, v_y, omega]), unit(across)
    for wheels in (mecanum, kiwi):
        m, geometry = manifold(wheels, "zero"), PlatformGeometry.from_wheels(wheels)
        forces = force_directions(geometry, twist)
        drift_power = (forces @ p) * (p @ twist[:2])
        rotation_power = cross(geometry.position, forces) * omega
        power = drift_power + rotation_power
        brakes = m.errors(twist, p).total < 0.0
        assert np.all(power[brakes] < 1e-12)
        # Without sliding, the direction of the friction force is undefined.
        slides = np.abs(sliding_velocities(geometry, twist)) > 1e-12
        assert np.all(power[slides & ~brakes] > -1e-12)


@given(v_x=speeds, v_y=speeds, omega=yaw_rates)
def test_friction_never_drives_a_wheel(
    mecanum: Wheels, kiwi: Wheels, v_x: float, v_y: float, omega: float
) -> None:
    twist = np.array([v_x, v_y, omega])
    for wheels in (mecanum, kiwi):
        velocities = PlatformKinematics(wheels).wheel_velocities(twist)
        forces = force_directions(PlatformGeometry.from_wheels(wheels), twist)
        assert np.all(np.sum(forces * velocities, axis=1) <= 1e-12)


@given(omega=yaw_rates.filter(lambda value: abs(value) > 1e-3))
def test_every_brake_slows_a_pure_spin(mecanum: Wheels, kiwi: Wheels, omega: float) -> None:
    for wheels in (mecanum, kiwi):
        assert np.all(manifold(wheels, "zero").errors(np.array([0, 0, omega]), None).total < 0.0)


# Symmetry


@given(
    weighting=st.sampled_from(WEIGHTINGS),
    v_x=speeds,
    v_y=speeds,
    omega=yaw_rates,
    across=directions,
    turn=st.floats(-180.0, 180.0),
)
def test_body_axes_do_not_matter(
    mecanum: Wheels,
    weighting: str,
    v_x: float,
    v_y: float,
    omega: float,
    across: float,
    turn: float,
) -> None:
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    matrix = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    twist, p = np.array([v_x, v_y, omega]), unit(across)
    here = manifold(mecanum, weighting)
    there = manifold(rotated(mecanum, turn), weighting)
    sliding = sliding_velocities(PlatformGeometry.from_wheels(mecanum), twist)
    known = np.abs(sliding) > 1e-6  # a zero force has no direction
    np.testing.assert_allclose(
        there.errors(matrix @ twist, matrix[:2, :2] @ p).total[known],
        here.errors(twist, p).total[known],
        atol=1e-6,
    )


@given(
    weighting=st.sampled_from(WEIGHTINGS),
    v_x=speeds,
    v_y=speeds,
    omega=yaw_rates,
    across=directions,
)
def test_mirror_image_has_mirrored_errors(
    mecanum: Wheels, weighting: str, v_x: float, v_y: float, omega: float, across: float
) -> None:
    p = unit(across)
    here = manifold(mecanum, weighting).errors(np.array([v_x, v_y, omega]), p)
    there = manifold(mirrored(mecanum), weighting).errors(
        np.array([v_x, -v_y, -omega]), p * np.array([1.0, -1.0])
    )
    geometry = PlatformGeometry.from_wheels(mecanum)
    known = np.abs(sliding_velocities(geometry, np.array([v_x, v_y, omega]))) > 1e-6
    np.testing.assert_allclose(there.total[known], here.total[known], rtol=1e-6, atol=1e-9)


@given(
    weighting=st.sampled_from(WEIGHTINGS),
    v_x=speeds,
    v_y=speeds,
    omega=yaw_rates,
    across=directions,
    exponent=st.integers(-6, 6),
)
def test_errors_scale_with_the_motion(
    mecanum: Wheels,
    weighting: str,
    v_x: float,
    v_y: float,
    omega: float,
    across: float,
    exponent: int,
) -> None:
    # A power of two scales without rounding, so even the signs of tiny errors must agree.
    scale = 2.0**exponent
    twist = np.where(np.abs([v_x, v_y, omega]) > 1e-100, [v_x, v_y, omega], 0.0)
    m = manifold(mecanum, weighting)
    np.testing.assert_array_equal(
        m.errors(scale * twist, unit(across)).total < 0.0,
        m.errors(twist, unit(across)).total < 0.0,
    )
    np.testing.assert_allclose(
        m.errors(scale * twist, unit(across)).total, scale * m.errors(twist, unit(across)).total
    )


def test_direction_across_may_point_either_way(mecanum: Wheels) -> None:
    m, twist, p = manifold(mecanum, "zero"), np.array([3.0, 1.0, 0.2]), unit(1.0)
    np.testing.assert_array_equal(m.errors(twist, p).total, m.errors(twist, -p).total)


# Edges


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_standstill_has_no_error(mecanum: Wheels, weighting: str) -> None:
    m = manifold(mecanum, weighting)
    with np.errstate(all="raise"):
        np.testing.assert_array_equal(m.errors(np.zeros(3), LEFT).total, 0.0)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_wheel_whose_center_rests_has_no_error(mecanum: Wheels, weighting: str) -> None:
    # The instantaneous center of rotation is under the front left wheel at (0.6, 0.45).
    m = manifold(mecanum, weighting)
    twist = np.array([0.45, -0.6, 1.0])
    with np.errstate(all="raise"):
        error = m.errors(twist, LEFT).total
    assert error[1] == 0.0
    assert np.all(np.isfinite(error))
    assert np.all(error[[0, 2, 3]] != 0.0)


def test_fastest_wheel_center(mecanum: Wheels) -> None:
    r_x, r_y = np.ascontiguousarray(PlatformGeometry.from_wheels(mecanum).position.T)
    assert fastest_wheel(r_x, r_y, 0.0, 0.0, 0.0) == 0.0
    assert fastest_wheel(r_x, r_y, 3.0, 4.0, 0.0) == pytest.approx(5.0)
    assert fastest_wheel(r_x, r_y, 0.0, 0.0, 2.0) == pytest.approx(2.0 * 0.75)


def test_without_a_line_nothing_is_perpendicular(mecanum: Wheels) -> None:
    errors = manifold(mecanum, "zero").errors(np.array([1.0, 2.0, 0.5]), None)
    np.testing.assert_array_equal(errors.perpendicular, 0.0)
    assert np.all(errors.angular != 0.0)
