"""One roller on the ground: its steady force, its limits, and how two rollers share a load."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from omni_sim.tire.combined_slip import combined_curve, slip_norms
from omni_sim.tire.interface.configuration import TireConfiguration, TMeasyConfiguration
from omni_sim.tire.models import MODELS
from omni_sim.tire.models.tmeasy import curve_of, force_at
from omni_sim.tire.tire import Tire
from omni_sim.wheel.drivetrain import Drive, Spin
from omni_sim.wheel.roller import RollerHub, RollerPatch, load_share, roller_step
from omni_sim.wheel.single import TireConstants

LOAD = 3000.0
HELD = 1e30  # inertia of a wheel or a roller whose speed is given [kg m^2]
TABLE_1 = TMeasyConfiguration()
TIRE = Tire(TireConfiguration(tmeasy=TABLE_1))
LATERAL = Tire(TireConfiguration(tmeasy=dataclasses.replace(TABLE_1, x=TABLE_1.y)))
ACTIVE, PASSIVE = curve_of(TABLE_1, LOAD, 1.0, "x"), curve_of(TABLE_1, LOAD, 1.0, "y")


def steady(
    slip_active: float,
    slip_passive: float,
    curves: tuple[Any, Any] = (ACTIVE, PASSIVE),
    speed: float = 2.0,
) -> tuple[float, float]:
    """Return the force [N] of a contact that slides steadily with two slips."""
    patch = RollerPatch((0.0, 0.0), speed, False, (1.0, 0.0))
    velocity = (slip_active * speed, slip_passive * speed)
    for _ in range(4000):
        after = roller_step(
            TireConstants(2.0e6, 5000.0, 5e-4),
            curves,
            patch,
            RollerHub((0.2, 0.0), velocity, 0.0, 0.0, HELD, 0.04),
            Spin(0.0, HELD, 0.0),
            Drive(0.0, 0.0, 0.0, 0.0),
        )
        patch = RollerPatch(after.deflection, speed, after.sliding, after.direction)
    force: tuple[float, float] = after.force
    return force


@pytest.mark.parametrize("slip", [-0.5, -0.1, 0.02, 0.14, 0.3, 1.0])
def test_force_along_one_direction_is_that_directions_curve(slip: float) -> None:
    along, across = steady(slip, 0.0)
    assert along == pytest.approx(-float(TIRE.force(slip, LOAD)), rel=1e-6)
    assert across == 0.0
    along, across = steady(0.0, slip)
    assert across == pytest.approx(-float(LATERAL.force(slip, LOAD)), rel=1e-6)
    assert abs(along) < 1e-9


@pytest.mark.parametrize("model", MODELS)
def test_a_roller_has_the_force_of_any_tire_against_the_slip(model: str) -> None:
    tire = Tire(TireConfiguration(model=model))
    curves = (tire.curve(LOAD), tire.curve(LOAD))
    for slip in (0.02, 0.14, 1.0):
        expected = -float(tire.force(slip, LOAD)) * np.array([0.6, -0.8])
        np.testing.assert_allclose(steady(0.6 * slip, -0.8 * slip, curves), expected, rtol=1e-5)


@pytest.mark.parametrize("slips", [(0.03, 0.02), (-0.1, 0.1), (0.4, -0.1), (0.5, 1.5)])
def test_slips_of_both_directions_are_added_as_vectors(slips: tuple[float, float]) -> None:
    norms = slip_norms(ACTIVE, PASSIVE)
    vector = np.array(slips) / norms
    slip = float(np.linalg.norm(vector))
    q = vector / slip
    expected = force_at(combined_curve(ACTIVE, PASSIVE, norms, (q[0], q[1])), slip)[0]
    np.testing.assert_allclose(steady(*slips), -expected * q, rtol=1e-5)


def test_a_tire_alike_in_all_directions_has_its_force_against_the_slip() -> None:
    norms = slip_norms(ACTIVE, ACTIVE)
    assert norms == (1.0, 1.0)
    for angle in np.linspace(0.0, 2.0 * np.pi, 17):
        curve = combined_curve(ACTIVE, ACTIVE, norms, (math.cos(angle), math.sin(angle)))
        np.testing.assert_allclose(curve, ACTIVE)


def test_two_rollers_share_the_load_and_none_of_it_gets_lost() -> None:
    half, overlap = math.pi / 12.0, 0.1
    for gamma in np.linspace(-half, half, 201):
        lower = load_share(gamma, half, overlap)
        assert 0.5 <= lower <= 1.0
        assert load_share(-gamma, half, overlap) == lower
        if abs(gamma) < (1.0 - overlap) * half:
            assert lower == 1.0
    assert load_share(half, half, overlap) == pytest.approx(0.5)
    # In and out of the shared part the load passes without a jump.
    assert load_share((1.0 - overlap) * half * 1.001, half, overlap) == pytest.approx(1.0, abs=1e-3)
