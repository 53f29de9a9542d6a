"""A fork that lifts moves the center of gravity up, and the loads follow it in closed form."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_sim.masses import ForkConfiguration
from omni_sim.vehicle.configuration import SuspensionConfiguration, VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle

GENTLE, ON, NO_COMMAND = 0.1, np.ones(4), np.zeros(3)


def lifting(vehicle: VehicleConfiguration, *rows: tuple[float, float]) -> VehicleConfiguration:
    time, height = zip(*rows, strict=True)
    return dataclasses.replace(vehicle, fork=ForkConfiguration(time=time, height=height))


def braked(configuration: VehicleConfiguration, time: float) -> Vehicle:
    """Return a vehicle that has braked gently for 0.5 s with the fork as at a time [s]."""
    vehicle = Vehicle(configuration, twist=(5.0, 0.0, 0.0))
    vehicle.lift(time)
    vehicle.advance(1000, GENTLE, ON, NO_COMMAND)
    return vehicle


def test_load_moves_forward_by_mass_deceleration_and_height(forklift: VehicleConfiguration) -> None:
    """With the wheelbase b, the front wheels gain m a h / b while the vehicle brakes."""
    middle = dataclasses.replace(forklift, load=dataclasses.replace(forklift.load, x=0.0, y=0.0))
    moving = lifting(middle, (1.0, 0.3), (3.0, 2.3))
    for time, height in ((0.0, 0.3), (2.0, 1.3), (9.0, 2.3)):
        vehicle = braked(moving, time)
        masses = vehicle.masses
        center = (1000.0 * 0.35 + 250.0 * height) / 1250.0
        assert vehicle.height == pytest.approx(center)
        deceleration = -float(vehicle.wheel_force_body[:, 0].sum()) / masses.mass
        front = [name.startswith("front") for name in vehicle.wheel_names]
        load = np.array(vehicle.wheels["load"])
        gained = 0.5 * (load[front].sum() - load[np.logical_not(front)].sum())
        assert deceleration > 0.5
        assert gained == pytest.approx(masses.mass * deceleration * center / 1.3, rel=1e-3)


@pytest.mark.parametrize("stiffness", [0.0, 4.0e5])
def test_a_raised_fork_is_a_load_at_that_height(
    stiffness: float, forklift: VehicleConfiguration
) -> None:
    """Also on springs; only the inertia about pitch and roll stays that of the lowered load."""
    springs = SuspensionConfiguration(stiffness=stiffness, pitch_inertia=300.0, roll_inertia=300.0)
    sprung = dataclasses.replace(forklift, suspension=springs)
    high = dataclasses.replace(sprung, load=dataclasses.replace(sprung.load, height=1.7))
    raised = braked(lifting(sprung, (0.0, 0.5), (1.0, 1.7)), 5.0)
    np.testing.assert_allclose(raised.wheels["load"], braked(high, 0.0).wheels["load"], rtol=1e-12)
    np.testing.assert_allclose(raised.pose, braked(high, 0.0).pose, rtol=1e-12, atol=1e-15)


def test_rows_must_fit_together() -> None:
    with pytest.raises(ConfigurationError, match="has 1 rows but must have 2"):
        ForkConfiguration(time=(0.0, 1.0), height=(0.5,))
    with pytest.raises(ConfigurationError, match="must increase"):
        ForkConfiguration(time=(1.0, 1.0), height=(0.5, 0.6))
