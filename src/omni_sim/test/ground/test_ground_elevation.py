"""Height of the ground: its parts, their sum, and rejection of steep grounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_sim.ground.configuration import (
    BumpConfiguration,
    ElevationConfiguration,
    WaveConfiguration,
)
from omni_sim.ground.elevation import elevation_at


def test_default_is_flat_and_costs_nothing() -> None:
    table = ElevationConfiguration().table()
    assert len(table) == 0
    assert elevation_at(table, 3.0, -4.0) == 0.0


def test_slope_rises_uphill_and_is_level_across() -> None:
    table = ElevationConfiguration(grade=0.05, uphill_deg=30.0).table()
    up = np.array([math.cos(math.radians(30.0)), math.sin(math.radians(30.0))])
    assert elevation_at(table, *(10.0 * up)) == pytest.approx(0.5)
    assert elevation_at(table, -7.0 * up[1], 7.0 * up[0]) == pytest.approx(0.0, abs=1e-15)


def test_wave_repeats_after_its_length_and_reaches_its_amplitude() -> None:
    wave = WaveConfiguration(amplitude=0.1, length=4.0, direction_deg=90.0, phase_deg=90.0)
    table = ElevationConfiguration(waves={"swell": wave}).table()
    assert elevation_at(table, 0.0, 0.0) == pytest.approx(0.1)
    assert elevation_at(table, 5.0, 2.0) == pytest.approx(-0.1)
    assert elevation_at(table, -3.0, 4.7) == pytest.approx(elevation_at(table, 0.0, 0.7))


def test_bump_is_smooth_up_to_its_rim_and_as_steep_as_it_is_checked_for() -> None:
    bump = BumpConfiguration(x=1.0, y=-2.0, height=0.3, radius=2.0)
    table = ElevationConfiguration(bumps={"hill": bump}).table()
    assert elevation_at(table, 1.0, -2.0) == 0.3
    r = np.linspace(0.0, 2.5, 25001)
    z = np.array([elevation_at(table, 1.0 + d, -2.0) for d in r])
    slope = np.gradient(z, r)
    bend = np.gradient(slope, r)
    assert np.all(z[r >= 2.0] == 0.0)
    assert np.max(np.abs(np.diff(bend[2:-2]))) < 1e-3  # no kink in the slope
    steepest = float(np.max(np.abs(slope)))
    # Just steep enough to be refused, were it 0.5 / steepest times as high.
    ElevationConfiguration(
        bumps={"hill": BumpConfiguration(x=0.0, y=0.0, height=0.299 / steepest * 0.5, radius=2.0)}
    )
    with pytest.raises(ConfigurationError, match="hill"):
        ElevationConfiguration(
            bumps={
                "hill": BumpConfiguration(x=0.0, y=0.0, height=0.301 / steepest * 0.5, radius=2.0)
            }
        )


def test_parts_add_up() -> None:
    wave = WaveConfiguration(amplitude=0.05, length=3.0)
    bump = BumpConfiguration(x=0.5, y=0.0, height=-0.1, radius=1.0)
    parts = [
        ElevationConfiguration(grade=0.1),
        ElevationConfiguration(waves={"a": wave}),
        ElevationConfiguration(bumps={"b": bump}),
    ]
    together = ElevationConfiguration(grade=0.1, waves={"a": wave}, bumps={"b": bump}).table()
    z = sum(elevation_at(part.table(), 0.7, 0.2) for part in parts)
    assert elevation_at(together, 0.7, 0.2) == pytest.approx(z)


def test_ground_that_adds_up_to_too_steep_names_its_steepest_part() -> None:
    with pytest.raises(ConfigurationError, match=r"waves\.swell"):
        ElevationConfiguration(
            grade=0.1, waves={"swell": WaveConfiguration(amplitude=0.2, length=3.0)}
        )
