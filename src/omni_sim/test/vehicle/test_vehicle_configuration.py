"""The vehicles in config/, and rejected vehicles."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics, UnusablePlatformError
from omni_sim.masses import MassConfiguration
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration


def test_forklift_is_a_mecanum_platform_in_the_order_of_equation_35(
    forklift: VehicleConfiguration,
) -> None:
    assert list(forklift.wheels) == ["rear_left", "front_left", "front_right", "rear_right"]
    lever = 1.3 / 2 + 1.0 / 2
    printed = np.array([[1, 1, -lever], [1, -1, -lever], [1, 1, lever], [1, -1, lever]]) / 0.2
    speeds = PlatformKinematics(forklift.wheels).wheel_speeds(np.eye(3)).T
    np.testing.assert_allclose(speeds, printed, atol=1e-12)


def test_forklift_is_loaded_at_the_front_left(forklift: VehicleConfiguration) -> None:
    center = forklift.masses.center
    assert np.all(center >= 0.0999)
    assert np.all(center <= 0.15)


def test_robot_is_the_platform_of_equation_34(robot: VehicleConfiguration) -> None:
    root, r = np.sqrt(3.0) / 2.0, 0.9
    printed = np.array([[0.5, -root, -r], [0.5, root, -r], [-1.0, 0.0, -r]]) / 0.15
    speeds = PlatformKinematics(robot.wheels).wheel_speeds(np.eye(3)).T
    np.testing.assert_allclose(speeds, printed, atol=1e-7)
    assert robot.load.mass == 500.0
    assert robot.load.yaw_inertia == pytest.approx(0.4 * 500.0 * 0.48**2, rel=0.02)  # a sphere


def test_both_stand_on_the_tire_of_table_1(
    forklift: VehicleConfiguration, robot: VehicleConfiguration
) -> None:
    assert forklift.tire == TireConfiguration()
    assert robot.tire == TireConfiguration()


def test_center_of_gravity_beside_the_wheels_is_refused(forklift: VehicleConfiguration) -> None:
    heavy = dataclasses.replace(forklift.load, mass=2000.0, x=1.2)
    with pytest.raises(ConfigurationError, match="tips over"):
        dataclasses.replace(forklift, load=heavy)


def test_vehicle_without_mass_or_inertia_is_refused(forklift: VehicleConfiguration) -> None:
    nothing = MassConfiguration(mass=0.0, height=0.0)
    with pytest.raises(ConfigurationError, match=r"body\.mass"):
        dataclasses.replace(forklift, body=nothing, load=nothing)
    point = MassConfiguration(mass=100.0, height=0.3)
    with pytest.raises(ConfigurationError, match="yaw_inertia"):
        dataclasses.replace(forklift, body=point, load=nothing)


def test_platform_that_cannot_move_is_refused(forklift: VehicleConfiguration) -> None:
    parallel = {
        name: dataclasses.replace(mount, roller_angle_deg=45.0)
        for name, mount in forklift.wheels.items()
    }
    with pytest.raises(UnusablePlatformError, match="rank 2"):
        dataclasses.replace(forklift, wheels=parallel)


def test_wheels_in_a_row_are_refused(forklift: VehicleConfiguration) -> None:
    row = {
        f"w{i}": WheelMount(x=float(i) - 1.0, y=0.0, heading_deg=50.0 * i, roller_angle_deg=0.0)
        for i in range(3)
    }
    with pytest.raises(ConfigurationError, match="not between the wheels"):
        dataclasses.replace(forklift, wheels=row)


def test_tire_too_soft_for_the_weight_is_refused(forklift: VehicleConfiguration) -> None:
    soft = dataclasses.replace(forklift.tire, vertical_stiffness=5.0e4)
    with pytest.raises(ConfigurationError, match="flatten"):
        dataclasses.replace(forklift, tire=soft)
