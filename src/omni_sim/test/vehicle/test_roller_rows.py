"""Wheels with two rows of rollers, or with large and small rollers (Figure 2): levers, energy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from logged_steps import advance_logged, kinetic_energy

from omni_core.configuration import ConfigurationError
from omni_core.geometry import PlatformGeometry, cross
from omni_core.quantities import GRAVITY
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_sim.wheel.roller_contact import roller_contact
from omni_sim.wheel.roller_geometry import AXIS, RollerConfiguration

APART, SMALL = 0.04, 0.038
ROWS = RollerConfiguration(rows_apart=APART)
SIZES = RollerConfiguration(small_radius=SMALL)
BOTH = RollerConfiguration(rows_apart=APART, small_radius=SMALL)


def on(vehicle: VehicleConfiguration, rollers: RollerConfiguration) -> VehicleConfiguration:
    return dataclasses.replace(vehicle, wheel_model="rollers", rollers=rollers)


def test_contacts_of_both_rows_and_sizes_are_those_of_equation_10(
    forklift: VehicleConfiguration,
) -> None:
    geometry = dataclasses.replace(forklift, contact="roller", rollers=BOTH).roller_geometries[0]
    even, odd = np.array(geometry.constants, AXIS)
    axle = geometry.wheel_axis[:2]
    for roller, radius, side in ((even, ROWS.radius, 1.0), (odd, SMALL, -1.0)):
        alone = dataclasses.replace(geometry, distance=geometry.radius - radius, rows_apart=0.0)
        for gamma in (-0.2, 0.0, 0.1):
            _, _, x, y, _, _, depth = roller_contact(gamma, roller)
            expected = alone.contact_point(gamma) - alone.center + side * 0.5 * APART * axle
            np.testing.assert_allclose([x, y], expected, atol=1e-12)
            assert depth == pytest.approx((geometry.radius - radius) / np.cos(gamma))
    # At 45 deg, the middles of the rows and the ends of the rollers are apart along the axle.
    assert geometry.jump > dataclasses.replace(geometry, rows_apart=0.0).jump


def test_the_force_of_a_wheel_alternates_between_the_rows(robot: VehicleConfiguration) -> None:
    """In closed form, the lever of a rolling force is half the distance, and 0 in the mean."""
    vehicle = Vehicle(on(robot, ROWS), twist=(1.0, 0.0, 0.0))
    vehicle.push((-0.1 * vehicle.masses.mass * GRAVITY, 0.0))
    command = np.array([1.0, 0.0, 0.0])
    vehicle.advance(2000, 0.0, np.ones(3), command, traced=False)
    geometry = PlatformGeometry.from_wheels(robot.wheels)
    arm, rolling = geometry.position[0] - vehicle.masses.center, geometry.rolling[0]
    start, levers = vehicle.wheels["angle"][0], []
    while abs(vehicle.wheels["angle"][0] - start) < 2.0 * np.pi:
        vehicle.advance(1, 0.0, np.ones(3), command, traced=False)
        assert vehicle.state.rollers is not None
        *force, moment = vehicle.state.rollers.push[0, :3]
        levers.append(float((moment - cross(arm, np.array(force))) / (rolling @ force)))
    lever = np.array(levers)
    assert np.max(np.abs(lever)) == pytest.approx(0.5 * APART, rel=0.02)
    share = np.mean(np.abs(np.abs(lever) - 0.5 * APART) < 0.02 * APART)
    assert share > 0.8  # otherwise, two rollers carry the wheel
    assert abs(np.mean(lever)) < 0.02 * APART
    changes = np.flatnonzero(np.diff(np.sign(lever)) != 0.0)
    assert len(changes) == ROWS.count


@pytest.mark.parametrize("rollers", [ROWS, SIZES, BOTH])
@pytest.mark.parametrize("twist", [(4.0, 0.0, 0.0), (2.0, -1.0, 1.5)])
def test_braking_adds_no_energy(
    twist: tuple[float, float, float],
    rollers: RollerConfiguration,
    forklift: VehicleConfiguration,
) -> None:
    vehicle = Vehicle(on(forklift, rollers), twist=twist)
    start = kinetic_energy(vehicle) + vehicle.energies.elastic
    log = advance_logged(vehicle, 4000, 1.0, np.ones(4), np.zeros(3))
    energy = np.concatenate(([start], log.energy.sum(axis=1)))
    assert np.max(np.diff(energy)) < 1e-3 * start
    assert np.max(energy) <= start * (1.0 + 1e-9)
    assert np.hypot(*vehicle.twist[:2]) < 0.01


def test_alternating_rollers_need_an_even_number_and_must_fit(
    forklift: VehicleConfiguration,
) -> None:
    with pytest.raises(ConfigurationError, match="count: is 9, must be even"):
        RollerConfiguration(count=9, rows_apart=APART)
    with pytest.raises(ConfigurationError, match=r"rollers\.small_radius.*rear_left"):
        on(forklift, RollerConfiguration(small_radius=0.005))
