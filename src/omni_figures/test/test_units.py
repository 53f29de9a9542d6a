"""Values are shown in a unit in which they have few digits."""

from __future__ import annotations

import math

import pytest

from omni_figures.units import readable_unit


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
