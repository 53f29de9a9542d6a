"""Vehicles on each tire of config/tires: convergence, rest, zero crossing, passivity."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from logged_steps import advance_logged, kinetic_energy

from omni_core.configuration import from_mapping
from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.ground.friction import FrictionMap
from omni_sim.masses import MassConfiguration
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.tire.tire import Tire
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle

TIRES = {
    path.stem: from_mapping(TireConfiguration, yaml.safe_load(path.read_text()))
    for path in sorted((Path(__file__).parents[4] / "config" / "tires").glob("*.yaml"))
}
MINUTE = 120_000  # steps

every_tire = pytest.mark.parametrize("tire", TIRES)
both_vehicles = pytest.mark.parametrize("kind", ["forklift", "robot"])


@pytest.fixture
def vehicle(
    kind: str, tire: str, forklift: VehicleConfiguration, robot: VehicleConfiguration
) -> VehicleConfiguration:
    base = forklift if kind == "forklift" else robot
    return dataclasses.replace(base, tire=TIRES[tire])


def brake(vehicle: Vehicle, seconds: float) -> FloatArray:
    n = len(vehicle.wheel_names)
    return vehicle.advance(round(seconds / vehicle.physics_step), 1.0, np.ones(n), np.zeros(3))


def heading(degrees: float) -> FloatArray:
    return np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])


def test_every_model_has_a_tire() -> None:
    assert {tire.model for tire in TIRES.values()} >= {"linear", "magic_formula", "tmeasy"}


@every_tire
@both_vehicles
def test_halving_the_step_changes_the_stopping_distance_by_less_than_one_per_cent(
    vehicle: VehicleConfiguration,
) -> None:
    for direction in (0.0, 90.0, 180.0, 240.0):
        distances = []
        for step in (0.0005, 0.00025, 0.000125):
            moving = Vehicle(vehicle, physics_step=step, twist=(*4.0 * heading(direction), 0.0))
            distances.append(float(np.hypot(*brake(moving, 3.0)[-1, :2])))
            np.testing.assert_allclose(moving.twist, 0.0, atol=1e-3)
        assert distances[0] > 0.9
        np.testing.assert_allclose(distances[1:], distances[:-1], rtol=0.005)


@every_tire
@both_vehicles
@pytest.mark.parametrize("direction", [0.0, 65.0, 90.0, 180.0, 270.0])
def test_parked_on_a_slope_nothing_creeps(direction: float, vehicle: VehicleConfiguration) -> None:
    parked = Vehicle(vehicle)
    parked.push(parked.masses.mass * GRAVITY * math.sin(math.atan(0.05)) * heading(direction))
    # The tires give way by the weight's component over their stiffness, and then hold.
    settled = brake(parked, 2.0)[-1]
    assert np.hypot(*settled[:2]) < 2e-3
    end = parked.advance(MINUTE, 1.0, np.ones(len(vehicle.wheels)), np.zeros(3))[-1]
    assert np.hypot(*(end - settled)[:2]) < 1e-6
    assert abs(end[2] - settled[2]) < 1e-6
    assert not parked.wheels["sliding"].any()


@every_tire
@both_vehicles
@pytest.mark.parametrize("pedal", [1.0, 0.0])
def test_a_vehicle_that_stopped_stays_stopped(pedal: float, vehicle: VehicleConfiguration) -> None:
    for direction in (0.0, 90.0, 200.0):
        stopped = Vehicle(vehicle, twist=(*3.0 * heading(direction), 0.3))
        brake(stopped, 4.0)
        # With the pedal up, the drive holds it at a command of zero; the wound-up tires relax.
        stopped.advance(MINUTE // 3, pedal, np.ones(len(vehicle.wheels)), np.zeros(3))
        before = stopped.pose
        stopped.advance(MINUTE, pedal, np.ones(len(vehicle.wheels)), np.zeros(3))
        np.testing.assert_allclose(stopped.pose, before, atol=1e-6)
        np.testing.assert_allclose(stopped.twist, 0.0, atol=1e-7)


@every_tire
@both_vehicles
@pytest.mark.parametrize(
    "direction",
    [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, -0.8, 0.0), (0.0, 0.0, 1.0)],
)
def test_speed_passes_smoothly_through_zero(
    direction: tuple[float, float, float], vehicle: VehicleConfiguration
) -> None:
    along = np.array(direction)
    moving = Vehicle(vehicle, twist=0.5 * along)
    speed = [0.5]
    for k in range(200):
        command = 0.5 * along * (1.0 - (k + 1) / 100.0)
        moving.advance(20, 0.0, np.ones(len(vehicle.wheels)), command)
        speed.append(float(moving.twist @ along))
    # Commanded -0.5 m/s^2, after the initial transient: no plateau and no jerk at zero.
    acceleration = np.diff(speed)[80:] / 0.01
    assert speed[80] > 0.05
    assert speed[-1] < -0.4
    np.testing.assert_allclose(acceleration, -0.5, rtol=0.05)
    np.testing.assert_allclose(np.diff(acceleration), 0.0, atol=0.01)


@every_tire
@both_vehicles
def test_no_pattern_of_brakes_adds_energy_or_breaks_the_friction_limit(
    vehicle: VehicleConfiguration,
) -> None:
    random = np.random.default_rng(5)
    n = len(vehicle.wheels)
    ice = FrictionPatch(x=3.0, y=0.3, length=2.0, width=1.0, heading_deg=20.0, friction=0.15)
    for direction in (10.0, 100.0, 230.0):
        moving = Vehicle(
            vehicle, FrictionMap(1.0, {"ice": ice}), twist=(*8.0 * heading(direction), 1.0)
        )
        energy = kinetic_energy(moving)
        allowance = 1e-9 * energy
        for _ in range(150):
            pedal = float(random.choice([1.0, 0.4]))
            log = advance_logged(moving, 20, pedal, random.integers(0, 2, n), np.zeros(3))
            total = np.concatenate(([energy], log.energy.sum(axis=1)))
            assert np.max(np.diff(total)) <= allowance
            assert np.all(np.abs(log.wheels["force"]) <= log.wheels["limit"] * (1.0 + 1e-9))
            energy = total[-1]


@every_tire
def test_locked_wheels_slide_with_the_force_of_their_model(
    tire: str, forklift: VehicleConfiguration
) -> None:
    low = MassConfiguration(mass=1200.0, height=0.0, yaw_inertia=400.0)
    empty = MassConfiguration(mass=0.0, height=0.0)
    even = dataclasses.replace(forklift, body=low, load=empty, tire=TIRES[tire])
    moving = Vehicle(even, twist=(10.0, 0.0, 0.0))
    path = moving.advance(1500, 1.0, np.ones(4), np.zeros(3))
    force = Tire(TIRES[tire]).curve(1200.0 * GRAVITY / 4.0).slide_force
    deceleration = (path[-101, 3] - path[-1, 3]) / (100 * 0.0005)
    assert deceleration == pytest.approx(4.0 * force * math.sqrt(0.5) / 1200.0, rel=1e-4)
