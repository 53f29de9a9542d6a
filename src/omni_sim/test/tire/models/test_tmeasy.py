"""TMeasy parameters: Table 1, the load interpolation (3), and rejected values."""

from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_core.configuration import ConfigurationError, from_mapping, to_mapping
from omni_sim.tire.interface.configuration import TireConfiguration, TMeasyConfiguration
from omni_sim.tire.models.tmeasy import curve_of
from omni_sim.tire.tire import Tire

TABLE_1 = TMeasyConfiguration()
TIRE = Tire(TireConfiguration(tmeasy=TABLE_1))


def printed_equation_3(f_1: float, f_2: float, load_1: float, load_2: float, load: float) -> float:
    """Equation (3) as printed, term by term."""
    bracket = (f_2 * load_1 / load_2 - f_1 * load_2 / load_1) * (
        (load_1 - load) / (load_1 - load_2)
    ) + f_1 * load / load_1
    return bracket * load / load_1


@given(st.floats(0.0, 6000.0), st.sampled_from(["x", "y"]))
def test_forces_and_slopes_follow_equation_3(load: float, direction: str) -> None:
    curve = getattr(TABLE_1, direction)
    point = curve_of(TABLE_1, load, direction=direction)
    for value, f_1, f_2 in (
        (point.slope, curve.slope_1, curve.slope_2),
        (point.peak_force, curve.peak_force_1, curve.peak_force_2),
        (point.slide_force, curve.slide_force_1, curve.slide_force_2),
    ):
        assert value == pytest.approx(printed_equation_3(f_1, f_2, 3000.0, 6000.0, load), abs=1e-8)
        q = load / 3000.0
        short = q * (2.0 * f_1 - f_2 / 2.0 - (f_1 - f_2 / 2.0) * q)
        assert value == pytest.approx(short, abs=1e-8)


def test_other_ratio_of_nominal_loads_follows_equation_3_too() -> None:
    tire = dataclasses.replace(TABLE_1, nominal_load_2=5000.0)
    for load in (0.0, 700.0, 3000.0, 4200.0, 5000.0):
        expected = printed_equation_3(3000.0, 4500.0, 3000.0, 5000.0, load)
        assert curve_of(tire, load).peak_force == pytest.approx(expected)


def test_slips_are_linear_in_the_load() -> None:
    assert curve_of(TABLE_1, 4500.0).peak_slip == pytest.approx(0.165)
    assert curve_of(TABLE_1, 4500.0).slide_slip == pytest.approx(0.45)
    assert curve_of(TABLE_1, 1500.0, direction="y").peak_slip == pytest.approx(0.195)
    assert curve_of(TABLE_1, 1500.0, direction="y").slide_slip == pytest.approx(0.5)


def test_load_beyond_the_second_nominal_one_is_clamped_and_reported() -> None:
    assert curve_of(TABLE_1, 9000.0) == curve_of(TABLE_1, 6000.0)


@pytest.mark.parametrize(
    ("key", "change"),
    [
        ("nominal_load_2", {"nominal_load_2": 2500.0}),
        ("x.slide_slip_1", {"x": {"slide_slip_1": 0.1}}),
        ("y.slide_force_2", {"y": {"slide_force_2": 5000.0}}),
        # The parabola through (3000, 1000) and (6000, 4500) is negative near zero load.
        ("x.peak_force_2", {"x": {"peak_force_1": 1000.0, "slide_force_1": 900.0}}),
        ("x.peak_slip_1", {"x": {"peak_slip_1": 0.05, "peak_slip_2": 0.2}}),
    ],
)
def test_a_tire_without_physical_meaning_is_refused_by_name(
    key: str, change: dict[str, object]
) -> None:
    mapping = to_mapping(TABLE_1)
    for name, value in change.items():
        if isinstance(value, dict):
            mapping[name].update(value)
        else:
            mapping[name] = value
    with pytest.raises(ConfigurationError) as caught:
        from_mapping(TMeasyConfiguration, mapping)
    assert caught.value.key == key
