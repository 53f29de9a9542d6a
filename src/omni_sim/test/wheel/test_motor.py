"""Motor of a drive: current loop, back EMF and power limit, against closed forms."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.quantities import FloatArray
from omni_sim.tire.interface.configuration import TMeasyConfiguration
from omni_sim.tire.models.tmeasy import curve_of
from omni_sim.vehicle.configuration import DriveConfiguration, VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_sim.wheel.drivetrain import Hub, Spin, clutch_torque, motor_drive, wheel_step
from omni_sim.wheel.single import Patch, TireConstants

INERTIA, DT = 0.5, 0.0005
TIRE, CURVE = TireConstants(2.0e5, 5000.0, DT), curve_of(TMeasyConfiguration(), 0.0)


def spun(
    drive: DriveConfiguration, command: float, duration: float, inertia: float = INERTIA
) -> FloatArray:
    """Return speed [rad/s] and torque [N m] of a wheel without load after each step, (K, 2)."""
    motor, power = drive.motor(DT), drive.max_power or math.inf
    speed, torque, rows = 0.0, 0.0, []
    for _ in range(round(duration / DT)):
        one = motor_drive(motor, drive.stiffness, command, speed, torque, power)
        patch, hub = Patch(0.0, 1.0, False), Hub(-0.2, 0.0, 0.0)
        speed = wheel_step(TIRE, CURVE, patch, hub, Spin(speed, inertia, 0.0), one).speed
        torque = clutch_torque(one, speed)
        rows.append((speed, torque))
    return np.array(rows)


def test_the_torque_follows_a_step_of_its_command_as_a_first_order_lag() -> None:
    drive = DriveConfiguration(current_time=0.02, max_torque=80.0, stiffness=1.0e5)
    torque = spun(drive, 1.0e6, 0.1)[:, 1]
    time = DT * np.arange(1, len(torque) + 1)
    np.testing.assert_allclose(torque, -80.0 * np.expm1(-time / 0.02), rtol=1e-9)


def test_current_loop_and_speed_controller_are_a_damped_oscillator() -> None:
    # I w' = T, lag T' = k (w_cmd - w) - T: natural frequency sqrt(k / (I lag)).
    lag, k, command = 0.02, 40.0, 10.0
    drive = DriveConfiguration(current_time=lag, max_torque=1e6, stiffness=k)
    speed = spun(drive, command, 0.4)[:, 0]
    time = DT * np.arange(1, len(speed) + 1)
    decay, rate = 0.5 / lag, math.sqrt(k / (INERTIA * lag) - 0.25 / lag**2)
    swing = np.cos(rate * time) + decay / rate * np.sin(rate * time)
    np.testing.assert_allclose(speed, command * (1.0 - np.exp(-decay * time) * swing), atol=0.2)


@pytest.mark.parametrize("inertia", [0.5, 1e-3])  # the second reaches its speed within a step
def test_the_back_emf_limits_torque_and_speed(inertia: float) -> None:
    drive = DriveConfiguration(stall_torque=60.0, no_load_speed=20.0, max_torque=1e6, stiffness=1e4)
    run = spun(drive, 50.0, 2.0, inertia)
    time, rate = DT * np.arange(1, len(run) + 1), 60.0 / (20.0 * inertia)
    if rate * DT < 0.01:
        assert run[0, 1] == pytest.approx(60.0, rel=rate * DT)
        np.testing.assert_allclose(run[:, 0], -20.0 * np.expm1(-rate * time), atol=0.02)
    assert run[-1, 0] == pytest.approx(20.0, rel=1e-4)
    np.testing.assert_allclose(run[:, 1], 60.0 * (1.0 - run[:, 0] / 20.0), atol=1e-6)


def test_a_power_limit_gives_the_energy_power_times_time() -> None:
    drive = DriveConfiguration(max_power=500.0, max_torque=1e4, stiffness=1e5)
    run = spun(drive, 1e4, 1.0)
    energy = 0.5 * INERTIA * run[:, 0] ** 2
    time = DT * np.arange(1, len(run) + 1)
    start = len(run) // 10  # in the first steps, the speed of the start of a step is far lower
    gained = energy[start:] - energy[start]
    np.testing.assert_allclose(gained, 500.0 * (time[start:] - time[start]), rtol=0.02, atol=1.0)


def test_the_work_of_the_motors_is_the_energy_of_a_vehicle(forklift: VehicleConfiguration) -> None:
    drive = dataclasses.replace(
        forklift.drive, stall_torque=250.0, no_load_speed=30.0, current_time=0.005, max_power=1500.0
    )
    machine = Vehicle(dataclasses.replace(forklift, drive=drive))
    work = lost = 0.0
    for _ in range(3000):
        machine.advance(1, 0.0, np.ones(4), np.array([2.0, 0.0, 0.0]), traced=False)
        power = machine.wheels["motor"] * machine.wheels["speed"]
        assert np.max(power) < 1.05 * 1500.0  # the current loop is late
        work += machine.physics_step * float(np.sum(power))
        lost -= machine.physics_step * float(machine.wheels["force"] @ machine.slip_velocity)
    found = machine.energies
    assert found.translation == pytest.approx(0.5 * machine.masses.mass * 4.0, rel=0.02)
    assert 0.0 < lost < 0.1 * work  # by the slip of the tires
    assert sum(found) == pytest.approx(work - lost, rel=2e-3)


def test_half_of_the_limit_by_the_voltage_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="no_load_speed: belongs to stall_torque"):
        DriveConfiguration(stall_torque=60.0)
