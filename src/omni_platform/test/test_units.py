"""The unit of a parameter is the declared one, at any depth."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from omni_platform.configuration import Configuration, parameter, section
from omni_platform.units import unit_of


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
