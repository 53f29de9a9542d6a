"""The two platforms of the dissertation's Eqs. (34), (35)."""

from __future__ import annotations

import math

import pytest

from omni_core.geometry import WheelMount


@pytest.fixture(scope="session")
def mecanum() -> dict[str, WheelMount]:
    """Four Mecanum wheels in the order of Eq. (35)."""
    half_length, half_width = 0.6, 0.45
    return {
        "rear_left": WheelMount(x=-half_length, y=half_width, roller_angle_deg=45.0),
        "front_left": WheelMount(x=half_length, y=half_width, roller_angle_deg=-45.0),
        "front_right": WheelMount(x=half_length, y=-half_width, roller_angle_deg=45.0),
        "rear_right": WheelMount(x=-half_length, y=-half_width, roller_angle_deg=-45.0),
    }


@pytest.fixture(scope="session")
def kiwi() -> dict[str, WheelMount]:
    """Three wheels at 120 deg with rollers at 0 deg, Eq. (34)."""
    radius = 0.5
    return {
        name: WheelMount(
            x=radius * math.cos(math.radians(position)),
            y=radius * math.sin(math.radians(position)),
            heading_deg=position - 90.0,
            roller_angle_deg=0.0,
        )
        for name, position in (("first", 30.0), ("second", 150.0), ("third", 270.0))
    }
