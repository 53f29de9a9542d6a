"""Steered wheels: Ackermann geometry, linear bicycle model, swerve drive, energy."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from logged_steps import advance_logged

from omni_core.configuration import ConfigurationError, from_mapping
from omni_core.quantities import FloatArray
from omni_sim.tire.models.tmeasy import TMeasyParameters, curve_at, direction_coefficients
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_sim.wheel.steering import nearest_target

CONFIG = Path(__file__).parents[4] / "config"
FRONT, WHEELBASE, TRACK = 0.65, 1.3, 1.0
COAST = 0.05  # pedal position at which the clutch opens


def _vehicle(name: str) -> VehicleConfiguration:
    mapping = yaml.safe_load((CONFIG / f"vehicles/{name}.yaml").read_text())
    mapping["tire"] = yaml.safe_load((CONFIG / f"tires/{mapping['tire']}.yaml").read_text())
    return from_mapping(VehicleConfiguration, mapping)


@pytest.fixture(scope="module")
def forklift() -> VehicleConfiguration:
    """The forklift with fixed front wheels and steered rear wheels."""
    return _vehicle("steered_forklift")


@pytest.fixture(scope="module")
def swerve() -> VehicleConfiguration:
    """The robot with four steered wheels."""
    return _vehicle("swerve_robot")


def drive(vehicle: Vehicle, command: tuple[float, float, float], duration: float) -> FloatArray:
    steps = round(duration / vehicle.physics_step)
    return vehicle.advance(steps, 0.0, np.ones(4), np.array(command))


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi), st.floats(0.1, 2.0 * math.pi))
def test_target_is_within_the_limit_and_rolls_in_the_direction_if_possible(
    direction: float, angle: float, limit: float
) -> None:
    target = nearest_target(direction, min(max(angle, -limit), limit), limit)
    assert abs(target) <= limit
    if limit >= math.pi / 2.0:  # then one of two opposite directions is within the limit
        assert abs(math.sin(target - direction)) < 1e-9
        assert abs(target - angle) <= 1.5 * math.pi + 1e-9 or abs(angle) > limit


def test_forklift_turns_as_an_ackermann_drive(forklift: VehicleConfiguration) -> None:
    """All axes meet on the front axle; ``cot outer - cot inner = track / wheelbase``."""
    vehicle = Vehicle(forklift)
    drive(vehicle, (0.5, 0.0, 0.2), 4.0)
    left, _, _, right = vehicle.steering[0]
    assert max(left, right) < 0.0  # rear wheels steer to the right for a turn to the left
    outer, inner = sorted((abs(left), abs(right)))
    assert 1.0 / math.tan(outer) - 1.0 / math.tan(inner) == pytest.approx(TRACK / WHEELBASE)
    # Turning circle of the middle of the front axle: radius = wheelbase x mean cotangent.
    radius = WHEELBASE * 0.5 * (1.0 / math.tan(outer) + 1.0 / math.tan(inner))
    assert radius == pytest.approx(0.5 / 0.2)
    path = drive(vehicle, (0.5, 0.0, 0.2), 2.0 * math.pi / 0.2)
    axle = path[:, :2] + FRONT * np.column_stack((np.cos(path[:, 2]), np.sin(path[:, 2])))
    assert np.ptp(axle[:, 0]) == pytest.approx(2.0 * radius, rel=0.01)
    assert np.ptp(axle[:, 1]) == pytest.approx(2.0 * radius, rel=0.01)
    np.testing.assert_allclose(path[-1, :2], path[0, :2], atol=0.05)


@pytest.mark.parametrize("load_x", [0.65, -0.3])
@pytest.mark.parametrize("speed", [4.0, 8.0])
def test_steady_cornering_is_that_of_the_linear_bicycle_model(
    forklift: VehicleConfiguration, load_x: float, speed: float
) -> None:
    """Riekert and Schunck: alpha = beta + lever r / v - delta, with free wheels and held steering.

    In steady cornering, ``r = (delta_f - delta_r) v / (L + m v^2 / L (b / C_f - a / C_r))``.
    """
    load = dataclasses.replace(forklift.load, x=load_x, mass=500.0)
    vehicle = Vehicle(dataclasses.replace(forklift, load=load), twist=(speed, 0.0, 0.4 / speed))
    vehicle.advance(round(1.5 / vehicle.physics_step), COAST, np.zeros(4), np.zeros(3))
    mass, center = vehicle.masses.mass, vehicle.masses.center[0]
    a, b = FRONT - center, FRONT + center
    lateral = TMeasyParameters(direction_coefficients(forklift.tire.tmeasy, "y"))
    rear, front, _, _ = (
        2.0 * curve_at(lateral, float(load), 1.0).slope for load in vehicle.wheels["load"]
    )
    v_x, v_y, rate = vehicle.twist
    left, _, _, right = vehicle.steering[0]
    steer = -0.5 * (left + right)
    model = steer * v_x / (WHEELBASE + mass * v_x**2 / WHEELBASE * (b / front - a / rear))
    assert rate == pytest.approx(model, rel=0.015)
    slip = -mass * v_x * rate * b / (WHEELBASE * front)  # of the front axle
    beta = (v_y + center * rate) / v_x
    assert beta == pytest.approx(slip - a * rate / v_x, abs=math.radians(0.01))
    assert abs(slip) > math.radians(0.1)  # the kinematic angle alone would fail


def test_steering_while_coasting_adds_no_energy(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(forklift, twist=(4.0, 0.0, 0.0))
    drive(vehicle, (4.0, 0.0, 2.0), 0.02)  # sets a target that the wheels have not reached
    before = vehicle.steering[0].copy()
    log = advance_logged(vehicle, 2000, COAST, np.zeros(4), np.zeros(3))
    assert np.max(np.abs(vehicle.steering[0] - before)) > math.radians(10.0)
    energy = log.energy.sum(axis=1)
    assert np.max(np.diff(energy)) < 1e-7 * energy[0]


def test_steering_rate_is_limited(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(forklift, twist=(1.0, 0.0, 0.0))
    drive(vehicle, (1.0, 0.0, 1.5), 0.3)
    angle, rate = vehicle.steering
    np.testing.assert_allclose(angle[[0, 3]], -math.radians(60.0 * 0.3), rtol=1e-9)
    np.testing.assert_allclose(rate, [-math.radians(60.0), 0.0, 0.0, -math.radians(60.0)])


@pytest.mark.parametrize("command", [(0.0, 0.8, 0.0), (0.0, 0.0, 1.0), (0.6, -0.4, 0.7)])
def test_swerve_drive_moves_in_every_direction(
    swerve: VehicleConfiguration, command: tuple[float, float, float]
) -> None:
    vehicle = Vehicle(swerve)
    drive(vehicle, command, 2.0)
    np.testing.assert_allclose(vehicle.twist, command, atol=0.02)
    stopped = drive(vehicle, (0.0, 0.0, 0.0), 1.0)[-1]
    np.testing.assert_allclose(stopped[3:], 0.0, atol=1e-3)


def test_counter_steering_turns_front_and_rear_wheels_oppositely(
    swerve: VehicleConfiguration,
) -> None:
    vehicle = Vehicle(swerve)
    drive(vehicle, (0.5, 0.0, 0.5), 2.0)
    rear_left, front_left, front_right, rear_right = vehicle.steering[0]
    assert front_left == pytest.approx(-rear_left)
    assert front_right == pytest.approx(-rear_right)
    assert math.tan(front_left) == pytest.approx(0.4 / (1.0 - 0.3))


@pytest.mark.parametrize("direction", range(0, 360, 30))
def test_swerve_drive_brakes_in_every_direction_without_tipping(
    swerve: VehicleConfiguration, direction: int
) -> None:
    angle = math.radians(direction)
    vehicle = Vehicle(swerve, twist=(2.5 * math.cos(angle), 2.5 * math.sin(angle), 0.0))
    vehicle.advance(round(1.0 / vehicle.physics_step), 1.0, np.ones(4), np.zeros(3))
    np.testing.assert_allclose(vehicle.twist, 0.0, atol=1e-2)
    assert vehicle.tipping_steps == 0


def test_mujoco_refuses_steering_with_the_remedy(forklift: VehicleConfiguration) -> None:
    with pytest.raises(ConfigurationError, match=r"steering_limit_deg: .*'mujoco'; use 'single'"):
        dataclasses.replace(forklift, wheel_model="mujoco")
