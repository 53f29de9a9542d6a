"""Friction of the ground over position."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from omni_sim.ground.configuration import FrictionPatch
from omni_sim.ground.friction import FrictionMap


def test_patch_counts_inside_and_the_base_outside() -> None:
    ground = FrictionMap(
        0.9, {"ice": FrictionPatch(x=5.0, y=-1.0, length=2.0, width=1.0, friction=0.2)}
    )
    assert ground.at(5.0, -1.0) == 0.2
    assert ground.at(5.99, -0.51) == 0.2
    assert ground.at(6.01, -1.0) == 0.9
    assert ground.at(5.0, -0.49) == 0.9


def test_turned_patch_turns_about_its_center() -> None:
    patch = FrictionPatch(x=1.0, y=2.0, length=4.0, width=0.2, heading_deg=30.0, friction=0.3)
    ground = FrictionMap(1.0, {"strip": patch})
    along = math.cos(math.radians(30.0)), math.sin(math.radians(30.0))
    for distance in (-1.9, 0.0, 1.9):
        assert ground.at(1.0 + distance * along[0], 2.0 + distance * along[1]) == 0.3
    assert ground.at(1.0 + 2.1 * along[0], 2.0 + 2.1 * along[1]) == 1.0
    assert ground.at(1.0 + 1.9 * along[0], 2.0 - 1.9 * along[1]) == 1.0


def test_last_of_overlapping_patches_counts() -> None:
    wide = FrictionPatch(x=0.0, y=0.0, length=4.0, width=4.0, friction=0.2)
    small = FrictionPatch(x=0.0, y=0.0, length=1.0, width=1.0, friction=0.7)
    assert FrictionMap(1.0, {"wide": wide, "small": small}).at(0.0, 0.0) == 0.7
    assert FrictionMap(1.0, {"small": small, "wide": wide}).at(0.0, 0.0) == 0.2


def test_negative_friction_is_refused() -> None:
    with pytest.raises(ValueError, match=r"-0\.1"):
        FrictionMap(-0.1)


def test_ellipse_is_what_a_stretched_circle_covers() -> None:
    ellipse = FrictionPatch(
        shape="ellipse", x=1.0, y=-2.0, length=4.0, width=1.0, heading_deg=25.0, friction=0.3
    )
    ground = FrictionMap(1.0, {"oil": ellipse})
    cos, sin = math.cos(math.radians(25.0)), math.sin(math.radians(25.0))
    for angle in np.linspace(0.0, 2.0 * np.pi, 37):
        for stretch, expected in ((0.999, 0.3), (1.001, 1.0)):
            along, across = stretch * 2.0 * math.cos(angle), stretch * 0.5 * math.sin(angle)
            x, y = 1.0 + cos * along - sin * across, -2.0 + sin * along + cos * across
            assert ground.at(x, y) == expected
    # Its bounding box is larger than the patch.
    corner = FrictionMap(1.0, {"oil": dataclasses.replace(ellipse, heading_deg=0.0)})
    assert corner.at(1.0 + 1.9, -2.0 + 0.45) == 1.0
