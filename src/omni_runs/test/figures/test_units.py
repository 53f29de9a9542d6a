"""Values are shown in a unit in which they have few digits."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest

from omni_core.configuration import Configuration, parameter, section
from omni_runs.figures.units import readable_unit, unit_of


@pytest.mark.parametrize(
    ("unit", "values", "shown"),
    [
        ("m", [0.003, -0.15], "mm"),
        ("m", [0.003, 1.5], "m"),
        ("m", [0.0], "m"),
        ("m", [math.nan, 0.01], "mm"),
        ("N", [40.0, -150.0], "N"),
        ("N", [40.0, -4500.0], "kN"),
        ("deg", [0.001], "deg"),
        ("m", [], "m"),
    ],
)
def test_the_largest_magnitude_chooses_the_unit(unit: str, values: list[float], shown: str) -> None:
    found, factor = readable_unit(unit, values)
    assert found == shown
    assert factor == {"mm": 1e3, "kN": 1e-3}.get(shown, 1.0)


class _Wheel(Configuration):
    radius: float = parameter(0.1, unit="m", minimum=0.0)
    """radius"""
    gain: float = parameter(1.0)
    """gain"""


class _Vehicle(Configuration):
    wheel: _Wheel = parameter()
    """wheel"""
    wheels: Mapping[str, _Wheel] = section(dict)
    """wheels"""


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("wheel.radius", "m"),
        ("wheels.front_left.radius", "m"),
        ("wheel.gain", "1"),
        ("wheels", "1"),
        ("wheel", "1"),
        ("unknown.key", "1"),
    ],
)
def test_the_unit_of_a_dotted_key(key: str, unit: str) -> None:
    assert unit_of(_Vehicle, key) == unit
