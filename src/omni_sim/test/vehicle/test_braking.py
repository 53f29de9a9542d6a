"""Braking: friction limit and passivity (48) at every step, convergence, and rotation."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logged_steps import Log, advance_logged, kinetic_energy

from omni_core.geometry import PlatformGeometry
from omni_core.quantities import FloatArray
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.ground.friction import FrictionMap
from omni_sim.masses import MassConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle


def stop(vehicle: Vehicle, seconds: float = 4.0) -> FloatArray:
    n = len(vehicle.wheel_names)
    return vehicle.advance(round(seconds / vehicle.physics_step), 1.0, np.ones(n), np.zeros(3))


def require_lawful(log: Log, energy_before: float, allowance: float) -> None:
    """Require the friction limit and that no step adds energy, elastic energy included."""
    assert np.all(np.isfinite(log.trajectory))
    assert np.all(np.abs(log.wheels["force"]) <= log.wheels["limit"] * (1.0 + 1e-12))
    energy = np.concatenate(([energy_before], log.energy.sum(axis=1)))
    assert np.max(np.diff(energy)) <= allowance


def brake_at_random(vehicle: Vehicle, seed: int, periods: int, tolerance: float = 1e-9) -> None:
    random = np.random.default_rng(seed)
    n = len(vehicle.wheel_names)
    allowance = tolerance * kinetic_energy(vehicle)
    for _ in range(periods):
        before = kinetic_energy(vehicle) + vehicle.energies.elastic
        enable = random.integers(0, 2, n) * random.choice([1.0, 1.0, 0.3], n)
        pedal = random.choice([1.0, 1.0, 0.4, 0.06])
        log = advance_logged(vehicle, 20, pedal, enable, np.zeros(3))
        require_lawful(log, before, allowance)


@settings(max_examples=20)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(-math.pi, math.pi),
    st.floats(0.1, 10.0),
    st.floats(-4.0, 4.0),
    st.booleans(),
)
def test_no_pattern_of_brakes_adds_energy_or_breaks_the_friction_limit(
    forklift: VehicleConfiguration,
    robot: VehicleConfiguration,
    seed: int,
    direction: float,
    speed: float,
    yaw_rate: float,
    three_wheels: bool,
) -> None:
    ice = FrictionPatch(x=3.0, y=0.3, length=2.0, width=1.0, heading_deg=20.0, friction=0.15)
    vehicle = Vehicle(
        robot if three_wheels else forklift,
        FrictionMap(1.0, {"ice": ice}),
        twist=(speed * math.cos(direction), speed * math.sin(direction), yaw_rate),
    )
    brake_at_random(vehicle, seed, 150)


# With the hardest tire the phase of a wheel's oscillation changes by 0.5 rad per step. The coupling
# of the wheels through the body, which lags by a step, may then add a share of 1e-7 of the energy.
@pytest.mark.parametrize(
    ("stiffness", "damping", "tolerance"), [(2.0e7, 1.0e5, 1e-9), (1.0e8, 1.0e6, 1e-6)]
)
@pytest.mark.parametrize("seed", range(3))
def test_stiff_tires_and_light_wheels_stay_passive_at_a_coarse_step(
    seed: int,
    stiffness: float,
    damping: float,
    tolerance: float,
    forklift: VehicleConfiguration,
) -> None:
    tire = dataclasses.replace(forklift.tire, stiffness=stiffness, damping=damping)
    hard = dataclasses.replace(forklift, tire=tire, wheel_inertia=0.01)
    vehicle = Vehicle(hard, physics_step=0.001, twist=(6.0, 2.0, 1.0))
    brake_at_random(vehicle, seed, 250, tolerance)
    # With locked wheels, only the coupling between steps could sustain an oscillation.
    vehicle.advance(2000, 1.0, np.ones(4), np.zeros(3))
    np.testing.assert_allclose(vehicle.twist, 0.0, atol=1e-6)


def test_kinetic_energy_never_grows_by_more_than_the_tires_store(
    forklift: VehicleConfiguration,
) -> None:
    vehicle = Vehicle(forklift, twist=(10.0, 0.0, 0.0))
    log = advance_logged(vehicle, 10000, 1.0, np.ones(4), np.zeros(3))
    kinetic = log.energy[:, :3].sum(axis=1)
    elastic = log.energy[:, 3]
    lowest = np.minimum.accumulate(kinetic + elastic)
    assert np.all(kinetic <= lowest + 1e-6)
    assert kinetic[-1] < 1e-6 * kinetic[0]


@pytest.mark.parametrize("kind", ["forklift", "robot"])
def test_stopping_distance_converges_with_the_step(
    kind: str, forklift: VehicleConfiguration, robot: VehicleConfiguration
) -> None:
    configuration = forklift if kind == "forklift" else robot
    ends = [
        stop(Vehicle(configuration, physics_step=step, twist=(7.0, 4.0, 0.0)))[-1]
        for step in (0.0005, 0.00025, 0.0000625)
    ]
    distances = [float(np.hypot(*end[:2])) for end in ends]
    assert abs(distances[1] - distances[0]) < 0.01 * distances[0]
    # First order: the error shrinks with the step.
    coarse, fine = (np.linalg.norm(end[:3] - ends[2][:3]) for end in ends[:2])
    assert fine < 0.7 * coarse


def test_locked_wheels_decelerate_evenly_loaded_forklift_by_the_sliding_force(
    forklift: VehicleConfiguration,
) -> None:
    low = MassConfiguration(mass=1200.0, height=0.0, yaw_inertia=400.0)
    even = dataclasses.replace(forklift, body=low, load=MassConfiguration(mass=0.0, height=0.0))
    log = advance_logged(Vehicle(even, twist=(10.0, 0.0, 0.0)), 1500, 1.0, np.ones(4), np.zeros(3))
    assert np.all(log.wheels["speed"][-1] == 0.0)
    q = 1200.0 * 9.81 / 4.0 / 3000.0
    f_slide = q * (2.0 * 2800.0 - 2100.0 - (2800.0 - 2100.0) * q)  # Eq. (3)
    np.testing.assert_allclose(np.abs(log.wheels["force"][-1]), f_slide, rtol=1e-9)
    deceleration = -(log.trajectory[-1, 3] - log.trajectory[-101, 3]) / (100 * 0.0005)
    assert deceleration == pytest.approx(4.0 * f_slide * math.sqrt(0.5) / 1200.0, rel=1e-6)


def test_unassisted_forklift_swerves_around_its_most_loaded_wheel(
    forklift: VehicleConfiguration,
) -> None:
    vehicle = Vehicle(forklift, twist=(10.0, 0.0, 0.0))
    assert vehicle.wheel_names[int(np.argmax(vehicle.wheels["load"]))] == "front_left"
    active = PlatformGeometry.from_wheels(forklift.wheels).active[
        vehicle.wheel_names.index("front_left")
    ]
    trajectory = stop(vehicle)
    # Section 3.1: the vehicle turns to the loaded side until the active direction of that wheel,
    # 45 deg to the right of forward, is parallel to the velocity.
    _, _, yaw, v_x, v_y, _ = trajectory[round(1.0 / vehicle.physics_step)]
    along = math.remainder(yaw + math.atan2(*active[::-1]) - math.atan2(v_y, v_x), math.pi)
    assert abs(along) < math.radians(2.0)
    end = trajectory[-1]
    assert math.radians(25.0) < end[2] < math.radians(50.0)
    assert 8.0 < np.hypot(end[0], end[1]) < 12.0
    assert vehicle.overloaded_steps == 0
    assert vehicle.tipping_steps == 0


@pytest.mark.parametrize("direction", range(0, 360, 45))
def test_robot_brakes_in_every_direction_without_tipping(
    direction: int, robot: VehicleConfiguration
) -> None:
    angle = math.radians(direction)
    vehicle = Vehicle(robot, twist=(5.0 * math.cos(angle), 5.0 * math.sin(angle), 0.0))
    end = stop(vehicle)[-1]
    assert 1.0 < np.hypot(end[0], end[1]) < 4.0
    assert vehicle.tipping_steps == 0
    assert vehicle.overloaded_steps == 0
