"""Combined slip: reduction to one direction, symmetry, isotropy, bounds, friction."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_sim.tire.combined_slip import combined_forces, slip_norms
from omni_sim.tire.interface.configuration import TireConfiguration, TMeasyConfiguration
from omni_sim.tire.models.tmeasy import curve_of, curve_through
from omni_sim.tire.tire import Tire

TABLE_1 = TMeasyConfiguration()
TIRE = Tire(TireConfiguration(tmeasy=TABLE_1))
LATERAL = Tire(TireConfiguration(tmeasy=dataclasses.replace(TABLE_1, x=TABLE_1.y)))

slips = st.floats(-1.5, 1.5)
loads = st.floats(100.0, 6000.0)


@given(slips, loads, st.floats(0.1, 1.5))
def test_slip_along_one_direction_is_that_direction_alone(
    slip: float, load: float, friction: float
) -> None:
    for direction, arguments, zero in (("x", (slip, 0.0), 1), ("y", (0.0, slip), 0)):
        force = combined_forces(TABLE_1, *arguments, load, friction)
        alone = float((LATERAL if direction == "y" else TIRE).force(slip, load, friction))
        assert force[1 - zero] == pytest.approx(alone, rel=1e-9, abs=1e-9)
        assert force[zero] == 0.0


@given(slips, slips, loads)
def test_force_mirrors_with_the_slip(slip_x: float, slip_y: float, load: float) -> None:
    force = combined_forces(TABLE_1, slip_x, slip_y, load)
    np.testing.assert_array_equal(
        combined_forces(TABLE_1, -slip_x, slip_y, load), force * np.array([-1.0, 1.0])
    )
    np.testing.assert_array_equal(
        combined_forces(TABLE_1, slip_x, -slip_y, load), force * np.array([1.0, -1.0])
    )


@given(st.floats(0.0, 1.5), st.floats(-math.pi, math.pi), loads)
def test_tire_that_is_alike_in_both_directions_is_so_in_every_direction(
    slip: float, angle: float, load: float
) -> None:
    round_tire = dataclasses.replace(TABLE_1, y=TABLE_1.x)
    direction = np.array([math.cos(angle), math.sin(angle)])
    force = combined_forces(round_tire, slip * direction[0], slip * direction[1], load)
    alone = float(TIRE.force(slip, load))
    np.testing.assert_allclose(force, alone * direction, rtol=1e-9, atol=1e-8)


@given(slips, slips, loads, st.floats(0.1, 1.5))
def test_force_is_bounded_by_friction_and_scales_with_it(
    slip_x: float, slip_y: float, load: float, friction: float
) -> None:
    force = combined_forces(TABLE_1, slip_x, slip_y, load, friction)
    x = curve_of(TABLE_1, load, friction).peak_force
    y = curve_of(TABLE_1, load, friction, "y").peak_force
    # The ellipse of the two peaks, which Rill's interpolation exceeds by ((x/y + y/x) / 2)^2.
    excess = (0.5 * (x / y + y / x)) ** 2
    assert (force[0] / x) ** 2 + (force[1] / y) ** 2 <= excess * (1.0 + 1e-9)
    scaled = friction * combined_forces(TABLE_1, slip_x / friction, slip_y / friction, load)
    np.testing.assert_allclose(force, scaled, rtol=1e-9, atol=1e-9)


def test_lateral_slip_takes_longitudinal_force_away() -> None:
    side = np.linspace(0.0, 1.0, 50)
    force = combined_forces(TABLE_1, 0.1, side, 3000.0)
    assert np.all(np.diff(force[:, 0]) < 0.0)
    # Full sliding: the force is along the normalized slip.
    n_x, n_y = slip_norms(curve_of(TABLE_1, 3000.0), curve_of(TABLE_1, 3000.0, direction="y"))
    slid = combined_forces(TABLE_1, 3.0, 4.0, 3000.0)
    assert slid[1] / slid[0] == pytest.approx(4.0 / 3.0 * n_x / n_y, rel=1e-12)
    assert n_x + n_y == pytest.approx(2.0)


def test_work_against_the_slip_is_never_negative() -> None:
    random = np.random.default_rng(2)
    slip = random.normal(0.0, 0.5, (2, 1000))
    force = combined_forces(TABLE_1, slip[0], slip[1], random.uniform(0.0, 6000.0, 1000))
    assert np.all(force[:, 0] * slip[0] + force[:, 1] * slip[1] >= 0.0)


def test_slips_are_normalized_by_the_peaks_and_by_their_linear_extension() -> None:
    # The straight lines with the initial slopes reach the peak forces at slips of 0.04 and 0.12.
    x = curve_through(1000.0 / 0.04, 0.1, 1000.0, 0.5, 900.0)
    y = curve_through(600.0 / 0.12, 0.3, 600.0, 0.8, 500.0)
    assert slip_norms(x, y) == pytest.approx((0.25 + 0.25, 0.75 + 0.75))
    assert slip_norms(x, y._replace(peak_force=0.0)) == (1.0, 1.0)


def test_overload_and_no_load() -> None:
    np.testing.assert_array_equal(
        combined_forces(TABLE_1, 0.1, 0.2, 9000.0), combined_forces(TABLE_1, 0.1, 0.2, 6000.0)
    )
    np.testing.assert_array_equal(combined_forces(TABLE_1, 0.1, 0.2, [0.0, -5.0]), 0.0)
    assert combined_forces(TABLE_1, np.zeros((4, 1)), np.zeros(3), 3000.0).shape == (4, 3, 2)
