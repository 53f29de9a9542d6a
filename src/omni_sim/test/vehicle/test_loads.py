"""Masses and wheel loads against hand calculation, balance and contact."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_core.quantities import FloatArray
from omni_sim.masses import MassConfiguration, MassProperties, support_polygon
from omni_sim.vehicle.loads import load_plane, wheel_loads

WEIGHT = 12000.0
SQUARE = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


def loads_of(position: FloatArray, z_x: float, z_y: float) -> tuple[FloatArray, bool]:
    loads = np.full(len(position), np.nan)
    tipping = wheel_loads(
        position, load_plane(position), support_polygon(position), WEIGHT, z_x, z_y, loads
    )
    return loads, bool(tipping)


def test_masses_combine_by_steiner() -> None:
    body = MassConfiguration(mass=900.0, x=0.0, y=0.0, height=0.4, yaw_inertia=300.0)
    load = MassConfiguration(mass=100.0, x=1.0, y=0.5, height=1.4, yaw_inertia=5.0)
    together = MassProperties.of(body, load)
    assert together.mass == 1000.0
    np.testing.assert_allclose(together.center, [0.1, 0.05])
    assert together.height == pytest.approx(0.5)
    # Two bodies: J = sum J_k + (m_1 m_2 / m) d^2
    assert together.yaw_inertia == pytest.approx(305.0 + 90.0 * 1.25)


def test_four_wheels_by_hand() -> None:
    # F_i = m g / 4 (1 + x_i z_x / l^2 + y_i z_y / w^2) on a rectangle of half lengths l, w.
    rectangle = SQUARE * np.array([0.65, 0.5])
    loads, tipping = loads_of(rectangle, 0.13, 0.1)
    np.testing.assert_allclose(loads, [4200.0, 3000.0, 1800.0, 3000.0])
    assert not tipping


def test_three_wheels_by_hand() -> None:
    # Two wheels in front, 1 m apart, one 1 m behind; the weight 0.4 m before the rear wheel.
    position = np.array([[1.0, 0.5], [1.0, -0.5], [0.0, 0.0]])
    loads, _ = loads_of(position - np.array([0.4, 0.1]), 0.0, 0.0)
    np.testing.assert_allclose(loads, WEIGHT * np.array([0.3, 0.1, 0.6]))


def test_lifted_wheel_leaves_its_load_to_the_others() -> None:
    # All four would give -0.05 of the weight to wheel 2; three balance as 0.6, 0.2, 0.2.
    loads, tipping = loads_of(SQUARE, 0.6, 0.6)
    np.testing.assert_allclose(loads, WEIGHT * np.array([0.6, 0.2, 0.0, 0.2]), atol=1e-6)
    assert not tipping


def test_tipping_vehicle_stands_on_the_nearest_edge_or_corner() -> None:
    loads, tipping = loads_of(SQUARE, 1.5, 0.5)
    np.testing.assert_allclose(loads, WEIGHT * np.array([0.75, 0.0, 0.0, 0.25]))
    assert tipping
    loads, tipping = loads_of(SQUARE, -3.0, 2.0)
    np.testing.assert_allclose(loads, WEIGHT * np.array([0.0, 1.0, 0.0, 0.0]))
    assert tipping


def test_polygon_leaves_out_inner_wheels_and_turns_counter_clockwise() -> None:
    position = np.array([[0.1, 0.2], *SQUARE, [0.0, 1.0]])
    assert sorted(support_polygon(position)) == [1, 2, 3, 4]
    corners = position[support_polygon(position)]
    following = np.roll(corners, -1, axis=0)
    area = 0.5 * np.sum(corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0])
    assert area == pytest.approx(4.0)


def test_nine_wheels_of_which_few_reach_out_settle_on_one_plane() -> None:
    # Without damping, the search for the contact set would end at a single wheel here.
    angle = np.radians(40.0 * np.arange(9) + np.array([3.0, *([0.0] * 8)]))
    radius = np.array([2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 0.5, 0.75])
    require_carried(
        radius[:, np.newaxis] * np.column_stack((np.cos(angle), np.sin(angle))), 1.75, 0.0
    )


@given(
    st.lists(st.tuples(st.floats(0.3, 2.0), st.floats(-20.0, 20.0)), min_size=3, max_size=9),
    st.floats(0.0, 3.0),
    st.floats(-math.pi, math.pi),
)
def test_any_vehicle_is_carried_in_balance_by_wheels_that_only_push(
    wheels: list[tuple[float, float]], distance: float, direction: float
) -> None:
    n = len(wheels)
    turns = np.array([math.radians(turn) for _, turn in wheels])
    angle = 2.0 * math.pi * np.arange(n) / n + turns
    radius = np.array([r for r, _ in wheels])
    position = radius[:, np.newaxis] * np.column_stack((np.cos(angle), np.sin(angle)))
    require_carried(position, distance, direction)


def require_carried(position: FloatArray, distance: float, direction: float) -> None:
    """Require balance with positive loads, for a zero-moment point at a distance and an angle."""
    n = len(position)
    z = distance * np.array([math.cos(direction), math.sin(direction)])
    loads, tipping = loads_of(position, z[0], z[1])
    assert np.all(loads >= 0.0)
    assert loads.sum() == pytest.approx(WEIGHT)

    corners = position[support_polygon(position)]
    edges = np.roll(corners, -1, axis=0) - corners
    to_point = z - corners
    inside = (edges[:, 0] * to_point[:, 1] - edges[:, 1] * to_point[:, 0]) / np.linalg.norm(
        edges, axis=1
    )
    if np.min(inside) < -1e-9:
        assert tipping
        return
    np.testing.assert_allclose(loads @ position, WEIGHT * z, atol=1e-6 * WEIGHT)
    if np.min(inside) > 1e-3:
        assert not tipping
        # Equal springs: the carrying wheels are on one plane, and it lifts off all others.
        carrying = loads > 0.0
        basis = np.column_stack((np.ones(n), position))
        plane, _, rank, _ = np.linalg.lstsq(basis[carrying], loads[carrying], rcond=None)
        assert rank == 3
        np.testing.assert_allclose(basis[carrying] @ plane, loads[carrying], atol=1e-6 * WEIGHT)
        assert np.all(basis[~carrying] @ plane <= 1e-6 * WEIGHT)
