"""Wheels that differ from the others, and brakes of limited power."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.quantities import FloatArray
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.ground.friction import FrictionMap
from omni_sim.vehicle.configuration import VehicleConfiguration, WheelCondition
from omni_sim.vehicle.vehicle import Vehicle

SPEED, STEP = 10.0, 0.0005  # [m/s], [s]


def in_condition(
    vehicle: VehicleConfiguration, *names: str, **condition_of_them: float
) -> VehicleConfiguration:
    condition = WheelCondition(**condition_of_them)
    return dataclasses.replace(vehicle, conditions=dict.fromkeys(names, condition))


def braked(
    configuration: VehicleConfiguration, ground: FrictionMap | None = None, steps: int = 1500
) -> Vehicle:
    vehicle = Vehicle(configuration, ground, STEP, twist=(SPEED, 0.0, 0.0))
    vehicle.advance(steps, 1.0, np.ones(len(configuration.wheels)), (SPEED, 0.0, 0.0))
    return vehicle


@pytest.mark.parametrize("model", ["single", "rollers"])
def test_oily_tires_all_around_are_an_oily_ground(
    model: str, forklift: VehicleConfiguration
) -> None:
    forklift = dataclasses.replace(forklift, wheel_model=model)
    oily = braked(in_condition(forklift, *forklift.wheels, friction=0.5), steps=200)
    ground = braked(forklift, FrictionMap(0.5), steps=200)
    np.testing.assert_array_equal(oily.pose, ground.pose)


def test_an_oily_tire_is_a_wheel_on_ice(forklift: VehicleConfiguration) -> None:
    """The result equals that of a lane of ice under the left wheels."""
    lane = FrictionPatch(x=0.0, y=5.0, length=100.0, width=10.0, friction=0.3)
    left = (name for name, mount in forklift.wheels.items() if mount.y > 0.0)
    oily = braked(in_condition(forklift, *left, friction=0.3), steps=300)
    on_ice = braked(forklift, FrictionMap(1.0, {"lane": lane}), steps=300)
    np.testing.assert_array_equal(oily.pose, on_ice.pose)
    assert abs(oily.pose[2]) > 0.01


def test_a_brake_that_fails_lets_its_wheel_roll(forklift: VehicleConfiguration) -> None:
    vehicle = braked(in_condition(forklift, "front_left", brake=0.0), steps=500)
    pulling = vehicle.wheels["brake"] != 0.0
    assert list(pulling) == [name != "front_left" for name in forklift.wheels]


def test_a_valve_that_cannot_release_brakes_with_the_pedal(
    forklift: VehicleConfiguration,
) -> None:
    commanded = np.array([float(name != "front_left") for name in forklift.wheels])
    poses = []
    for configuration, enable in (
        (in_condition(forklift, "front_left", open_valve=1.0), commanded),
        (forklift, np.ones(4)),
    ):
        vehicle = Vehicle(configuration, None, STEP, twist=(SPEED, 0.0, 0.0))
        vehicle.advance(500, 1.0, enable, (SPEED, 0.0, 0.0))
        poses.append(vehicle.pose)
    np.testing.assert_array_equal(poses[0], poses[1])


def test_a_stuck_brake_acts_with_the_pedal_up(forklift: VehicleConfiguration) -> None:
    """On rolling wheels without a drive, the vehicle loses the momentum that this brake removes."""
    idle = dataclasses.replace(forklift, drive=dataclasses.replace(forklift.drive, max_torque=0.0))
    share, steps = 0.05, 400
    stuck = in_condition(idle, *idle.wheels, stuck_brake=share)
    vehicle = Vehicle(stuck, None, STEP, twist=(SPEED, 0.0, 0.0))
    before = energy(vehicle, stuck)
    vehicle.advance(steps, 0.0, np.ones(4), (SPEED, 0.0, 0.0))
    turned = float(np.sum(np.abs(vehicle.wheels["angle"])))
    taken = before - energy(vehicle, stuck)
    assert taken == pytest.approx(share * stuck.brake.max_torque * turned, rel=0.05)


def energy(vehicle: Vehicle, configuration: VehicleConfiguration) -> float:
    twist: FloatArray = vehicle.twist
    moving = (
        0.5 * (configuration.body.mass + configuration.load.mass) * float(twist[:2] @ twist[:2])
    )
    spin = vehicle.wheels["speed"]
    return moving + 0.5 * configuration.wheel_inertia * float(spin @ spin)


def test_brakes_of_limited_power_take_just_that(forklift: VehicleConfiguration) -> None:
    """While the wheels roll, the loss of kinetic energy equals the work of the brakes."""
    power = 10_000.0
    weak = dataclasses.replace(forklift, brake=dataclasses.replace(forklift.brake, max_power=power))
    before = energy(Vehicle(weak, twist=(SPEED, 0.0, 0.0)), weak)
    vehicle = braked(weak, steps=1000)
    taken = before - energy(vehicle, weak)
    assert taken == pytest.approx(len(weak.wheels) * power * 1000 * STEP, rel=0.03)


def test_power_ends_no_torque_at_standstill(forklift: VehicleConfiguration) -> None:
    weak = dataclasses.replace(
        forklift, brake=dataclasses.replace(forklift.brake, max_power=40_000.0)
    )
    vehicle = braked(weak, steps=6000)
    np.testing.assert_allclose(vehicle.twist, 0.0, atol=1e-3)


def test_a_condition_of_no_wheel_is_refused(forklift: VehicleConfiguration) -> None:
    with pytest.raises(ConfigurationError, match=r"conditions: 'front_lift' .* 'front_left'"):
        in_condition(forklift, "front_lift")
