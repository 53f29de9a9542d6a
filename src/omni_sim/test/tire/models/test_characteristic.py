"""The steady characteristic: the points of Table 1, smoothness, and friction scaling."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_sim.tire.interface.configuration import TireConfiguration, TMeasyConfiguration
from omni_sim.tire.models.tmeasy import curve_of
from omni_sim.tire.tire import Tire

TABLE = TMeasyConfiguration()
TIRE = Tire(TireConfiguration(tmeasy=TABLE))
LATERAL = Tire(TireConfiguration(tmeasy=dataclasses.replace(TABLE, x=TABLE.y)))

# load, direction, dF0, s_max, F_max, s_slide, F_slide
TABLE_1 = [
    (3000.0, "x", 50000.0, 0.15, 3000.0, 0.4, 2800.0),
    (6000.0, "x", 75000.0, 0.18, 4500.0, 0.5, 4200.0),
    (3000.0, "y", 40000.0, 0.21, 2750.0, 0.6, 2500.0),
    (6000.0, "y", 60000.0, 0.24, 4125.0, 0.8, 3750.0),
]


@pytest.mark.parametrize(
    ("load", "direction", "slope", "s_max", "f_max", "s_slide", "f_slide"), TABLE_1
)
def test_curve_passes_through_the_points_of_table_1(
    load: float,
    direction: str,
    slope: float,
    s_max: float,
    f_max: float,
    s_slide: float,
    f_slide: float,
) -> None:
    def force(slip: float) -> float:
        return float((LATERAL if direction == "y" else TIRE).force(slip, load))

    h = 1e-7
    assert (force(h) - force(-h)) / (2.0 * h) == pytest.approx(slope, rel=1e-5)
    assert force(s_max) == pytest.approx(f_max, rel=1e-12)
    assert force(s_slide) == pytest.approx(f_slide, rel=1e-12)
    assert force(10.0 * s_slide) == pytest.approx(f_slide, rel=1e-12)
    # Level at the peak and where sliding begins, from both sides.
    for slip in (s_max, s_slide):
        for side in (-h, h):
            gradient = (force(slip + side) - force(slip)) / side
            assert abs(gradient) < 1e-3 * slope


@given(st.floats(100.0, 6000.0), st.floats(0.05, 1.5))
def test_curve_rises_to_one_peak_and_falls_to_sliding(load: float, friction: float) -> None:
    point = curve_of(TABLE, load, friction)
    slips = np.linspace(0.0, 1.5 * point.slide_slip, 2000)
    force = TIRE.force(slips, load, friction)
    steps = np.diff(force)
    assert np.all(steps[slips[1:] <= point.peak_slip] > 0.0)
    assert np.all(steps[slips[:-1] >= point.peak_slip] <= 0.0)
    assert np.max(force) <= point.peak_force * (1.0 + 1e-12)
    # No jump: no step exceeds the one at the steepest slope.
    assert np.max(np.abs(steps)) <= point.slope * slips[1] * (1.0 + 1e-9)


@given(st.floats(-1.0, 1.0), st.floats(1.0, 6000.0), st.floats(0.05, 1.5))
def test_friction_scales_force_and_slip_alike_and_keeps_the_slope(
    slip: float, load: float, friction: float
) -> None:
    scaled = float(TIRE.force(slip, load, friction))
    assert scaled == pytest.approx(friction * float(TIRE.force(slip / friction, load)), abs=1e-6)
    h = 1e-7
    assert float(TIRE.force(h, load, friction)) == pytest.approx(
        float(TIRE.force(h, load)), rel=1e-4
    )


def test_force_has_the_sign_of_the_slip() -> None:
    slips = np.linspace(-0.8, 0.8, 33)
    np.testing.assert_array_equal(TIRE.force(slips, 4000.0), -TIRE.force(-slips, 4000.0))


def test_no_load_or_no_friction_means_no_force() -> None:
    assert float(TIRE.force(0.3, 0.0)) == 0.0
    assert float(TIRE.force(0.3, -10.0)) == 0.0
    assert float(TIRE.force(0.3, 3000.0, 0.0)) == 0.0


def test_arguments_broadcast() -> None:
    force = TIRE.force(np.linspace(0.0, 0.5, 7)[:, np.newaxis], [1000.0, 3000.0, 6000.0])
    assert force.shape == (7, 3)
    assert force[3, 1] == float(TIRE.force(0.25, 3000.0))
