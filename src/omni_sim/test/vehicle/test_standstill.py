"""At rest and at the change of sign of the speed: no creep, no chatter, no sticking."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from logged_steps import advance_logged

from omni_core.quantities import GRAVITY
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle

ON, NO_COMMAND = np.ones(4), np.zeros(3)
MINUTE = 120_000


def test_parked_vehicle_stays_exactly_where_it_is(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(forklift, pose=(1.0, 2.0, 0.5))
    path = vehicle.advance(MINUTE, 1.0, ON, NO_COMMAND)
    np.testing.assert_allclose(path[-1], path[0], rtol=0.0, atol=1e-30)


@pytest.mark.parametrize("direction_deg", [0.0, 45.0, 90.0, 200.0])
def test_vehicle_parked_on_a_slope_does_not_creep(
    direction_deg: float, forklift: VehicleConfiguration
) -> None:
    vehicle = Vehicle(forklift)
    weight = vehicle.masses.mass * GRAVITY
    angle = math.radians(direction_deg)
    vehicle.push(0.05 * weight * np.array([math.cos(angle), math.sin(angle)]))
    vehicle.advance(8000, 1.0, ON, NO_COMMAND)  # the tires give way a little
    settled = vehicle.pose
    vehicle.advance(MINUTE, 1.0, ON, NO_COMMAND)
    assert np.max(np.abs(vehicle.pose - settled)) < 1e-5
    assert np.all(vehicle.wheels["speed"] == 0.0)


def test_too_steep_a_slope_is_not_held(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(forklift)
    vehicle.push((0.9 * vehicle.masses.mass * GRAVITY, 0.0))
    vehicle.advance(2000, 1.0, ON, NO_COMMAND)
    assert vehicle.pose[0] > 0.3
    assert vehicle.wheels["sliding"].any()


def test_released_vehicle_rolls_down_the_slope(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(forklift)
    mass = vehicle.masses.mass
    vehicle.push((0.05 * mass * GRAVITY, 0.0))
    vehicle.advance(2000, 1.0, np.zeros(4), NO_COMMAND)
    # Four wheels turn with it: I / R^2 each adds to the mass.
    inertia = mass + 4.0 * forklift.wheel_inertia / 0.2**2
    assert vehicle.twist[0] == pytest.approx(0.05 * mass * GRAVITY / inertia, rel=0.02)


def test_stopped_vehicle_stays_stopped(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(forklift, twist=(10.0, 0.0, 0.0))
    vehicle.advance(12_000, 1.0, ON, NO_COMMAND)
    stopped = vehicle.pose
    assert np.max(np.abs(vehicle.twist)) < 1e-6
    path = vehicle.advance(MINUTE, 1.0, ON, NO_COMMAND)
    np.testing.assert_allclose(path[:, :3], np.broadcast_to(stopped, (len(path), 3)), atol=1e-6)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, -0.6, 0.0)])
def test_speed_passes_smoothly_through_zero(
    direction: tuple[float, float, float], forklift: VehicleConfiguration
) -> None:
    vehicle = Vehicle(forklift)
    forces, speeds, commands = [], [], []
    for k in range(800):
        amplitude = 0.5 * math.sin(2.0 * math.pi * k * 0.01 / 4.0)
        log = advance_logged(vehicle, 20, 0.0, ON, amplitude * np.array(direction))
        forces.append(log.wheels["force"])
        speeds.append(vehicle.twist @ np.array(direction))
        commands.append(amplitude * np.dot(direction, direction))
    np.testing.assert_allclose(speeds[200:], commands[200:], atol=0.03)
    # Some 350 N accelerate the vehicle; a tire that chattered would jump by its grip of 3000 N.
    assert np.max(np.abs(np.diff(np.concatenate(forces)[4000:], axis=0))) < 40.0


def test_vehicle_braked_in_reverse_stops_like_forward(forklift: VehicleConfiguration) -> None:
    symmetric = dataclasses.replace(forklift, load=dataclasses.replace(forklift.load, mass=0.0))
    for twist in ((4.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 0.0, 3.0)):
        forward, reverse = (
            Vehicle(symmetric, twist=tuple(sign * np.array(twist))).advance(
                6000, 1.0, ON, NO_COMMAND
            )
            for sign in (1.0, -1.0)
        )
        assert np.max(np.abs(forward[-1, 3:])) < 1e-3
        assert forward[-1, :3] @ np.array(twist) > 0.0
        np.testing.assert_allclose(reverse, -forward, atol=1e-9)
