"""Velocity drives that brake along a ramp: closed forms, released wheels, limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import ArrayLike

from omni_core.configuration import ConfigurationError
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle

STEP, SPEED, RADIUS = 0.0005, 3.0, 0.2


def ramped(forklift: VehicleConfiguration, **brake: float | str) -> VehicleConfiguration:
    """Return the vehicle with velocity drives, each stiff enough to follow its command."""
    values = dataclasses.replace(forklift.brake, kind="velocity", **brake)  # type: ignore[arg-type]
    return dataclasses.replace(forklift, brake=values)


def lost(speed: float) -> float:
    """Return the loss of a wheel's speed [rad/s] for that of its rim [m/s]."""
    return speed / RADIUS


def stop(
    vehicle: Vehicle, time: float, pedal: float = 1.0, enable: ArrayLike = (1.0, 1.0, 1.0, 1.0)
) -> None:
    vehicle.advance(round(time / STEP), pedal, enable, (SPEED, 0.0, 0.0))


@pytest.mark.parametrize(("ramp", "pedal"), [(1.0, 1.0), (2.0, 1.0), (2.0, 0.4)])
def test_the_wheels_follow_the_ramp(
    forklift: VehicleConfiguration, ramp: float, pedal: float
) -> None:
    vehicle = Vehicle(ramped(forklift, ramp=ramp), None, STEP, twist=(SPEED, 0.0, 0.0))
    first = vehicle.wheels["speed"]
    stop(vehicle, 0.5, pedal)
    np.testing.assert_allclose(first - vehicle.wheels["speed"], lost(0.5 * pedal * ramp), rtol=0.02)
    slipped = 0.5 * pedal * ramp - (SPEED - vehicle.twist[0])
    assert 0.0 < slipped < 0.03 * SPEED  # a tire transmits its force with some per cent of slip
    stop(vehicle, 2.0 * SPEED / (pedal * ramp), pedal)
    np.testing.assert_allclose(vehicle.twist, 0.0, atol=1e-3)


def test_the_ramp_begins_after_the_dead_time(forklift: VehicleConfiguration) -> None:
    late = ramped(forklift, ramp=2.0, dead_time=0.1)
    vehicle = Vehicle(late, None, STEP, twist=(SPEED, 0.0, 0.0))
    first = vehicle.wheels["speed"]
    stop(vehicle, 0.3)
    np.testing.assert_allclose(first - vehicle.wheels["speed"], lost(0.2 * 2.0), rtol=0.02)


def test_a_released_wheel_gets_no_torque(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(ramped(forklift, ramp=2.0), None, STEP, twist=(SPEED, 0.0, 0.0))
    stop(vehicle, 0.3, enable=(0.0, 1.0, 1.0, 1.0))
    torque = vehicle.wheels["brake"]
    assert torque[0] == 0.0
    assert np.sum(torque) < 0.0


def test_a_drive_below_its_limits_only_brakes(forklift: VehicleConfiguration) -> None:
    """A drive whose torque and power are limited brakes with as much as the limits allow."""
    power = 2000.0
    weak = ramped(forklift, ramp=10.0, max_power=power)
    vehicle = Vehicle(weak, None, STEP, twist=(SPEED, 0.0, 0.0))
    for _ in range(20):
        speed = vehicle.wheels["speed"]
        stop(vehicle, STEP)
        torque = vehicle.wheels["brake"]
        assert np.all(torque <= 0.0)
        assert np.all(np.abs(torque * speed) <= power * (1.0 + 1e-9))


def test_the_drive_takes_its_vehicle_along_again(forklift: VehicleConfiguration) -> None:
    vehicle = Vehicle(ramped(forklift, ramp=2.0), None, STEP, twist=(SPEED, 0.0, 0.0))
    stop(vehicle, 0.3)
    stop(vehicle, 3.0, pedal=0.0)
    assert vehicle.twist[0] == pytest.approx(SPEED, rel=0.02)


def test_mujoco_has_no_velocity_drives(forklift: VehicleConfiguration) -> None:
    with pytest.raises(ConfigurationError, match=r"brake.kind: is not part of wheel_model"):
        dataclasses.replace(ramped(forklift), wheel_model="mujoco")
