"""Values in a wrong unit, or of a vehicle of another size, are reported; right ones never are."""

from __future__ import annotations

import dataclasses
import math
import warnings
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omni_core.brakes import BrakeConfiguration
from omni_core.configuration import ConfigurationWarning, to_mapping
from omni_core.geometry import WheelMount
from omni_core.quantities import GRAVITY
from omni_sim.masses import MassConfiguration
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.vehicle.configuration import DriveConfiguration, VehicleConfiguration
from omni_sim.vehicle.plausibility import vehicle_remarks
from omni_sim.vehicle.vehicle import Vehicle


def scaled_tire(load: float, radius: float) -> TireConfiguration:
    """The tire of Table 1 for another largest load [N] and another radius [m]."""
    table_1 = TireConfiguration()
    ratio = load / table_1.largest_load

    def scaled(values: Any) -> Any:
        if isinstance(values, dict):
            return {k: v if "slip" in k else scaled(v) for k, v in values.items()}
        return ratio * values

    parameters: Any = type(table_1.model_parameters)
    directions = {
        key: type(getattr(table_1.model_parameters, key))(**value)
        if isinstance(value, dict)
        else value
        for key, value in scaled(to_mapping(table_1.model_parameters)).items()
    }
    stiffer = ratio * 0.2 / radius
    return dataclasses.replace(
        table_1,
        **{table_1.model: parameters(**directions)},
        stiffness=max(stiffer * table_1.stiffness, 1e4),
        damping=stiffer * table_1.damping,
        vertical_stiffness=max(stiffer * table_1.vertical_stiffness, 1e4),
    )


def robot(mass: float, length: float, load: float = 0.0, **others: Any) -> VehicleConfiguration:
    """A vehicle on four Mecanum wheels.

    Args:
        mass: mass without load [kg].
        length: length of the chassis, 1.5 times its width [m].
        load: mass of a load at the front left, in proportion to `mass` [1].
        others: values that replace those of the vehicle.
    """
    width, radius = length / 1.5, length / 8.0
    a, b = 0.5 * length - radius, 0.5 * width
    places = {"rear_left": (-a, b, 45), "rear_right": (-a, -b, -45),
              "front_left": (a, b, -45), "front_right": (a, -b, 45)}  # fmt: skip
    carried = (1.0 + load) * mass / 4.0
    locking = carried * GRAVITY * radius
    inertia = mass * (length**2 + width**2) / 12.0
    values = {
        "wheels": {
            name: WheelMount(x=x, y=y, roller_angle_deg=angle, radius=radius)
            for name, (x, y, angle) in places.items()
        },
        "chassis_length": length,
        "chassis_width": width,
        "body": MassConfiguration(mass=mass, height=1.5 * radius, yaw_inertia=inertia),
        "load": MassConfiguration(
            mass=load * mass, x=0.2 * length, y=0.2 * width, height=2.0 * radius
        ),
        "brake": BrakeConfiguration(max_torque=2.0 * locking),
        "drive": DriveConfiguration(max_torque=2.0 * locking, stiffness=30.0 * locking * radius),
        "wheel_inertia": max(0.5 * 0.05 * mass * radius**2, 1e-6),
        "tire": scaled_tire(2.0 * carried * GRAVITY, radius),
        **others,
    }
    return VehicleConfiguration(**values)


# From a toy of 0.5 kg to a forklift of 5 t: 17 to 1700 kg/m^2.
SIZES = [(0.5, 0.2), (3.0, 0.35), (30.0, 0.6), (80.0, 0.7), (300.0, 1.2), (1250.0, 1.6),
         (5000.0, 2.5), (20000.0, 5.0)]  # fmt: skip


@pytest.mark.parametrize(("mass", "length"), SIZES)
@pytest.mark.parametrize("load", [0.0, 0.3])
def test_right_vehicles_of_any_size_give_no_remark(mass: float, length: float, load: float) -> None:
    vehicle = robot(mass, length, load)
    assert vehicle_remarks(vehicle) == ()
    with warnings.catch_warnings():
        warnings.simplefilter("error", ConfigurationWarning)
        Vehicle(vehicle, physics_step=1e-5)


def test_the_vehicles_of_the_project_give_no_warning(
    forklift: VehicleConfiguration, robot: VehicleConfiguration
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", ConfigurationWarning)
        for vehicle in (forklift, robot):
            Vehicle(vehicle)


@given(st.sampled_from(SIZES), st.sampled_from([0.01, 0.1, 10.0, 100.0, 1000.0]))
def test_a_length_or_mass_in_another_unit_is_reported(
    size: tuple[float, float], factor: float
) -> None:
    right = robot(*size)
    sides = right.chassis_length * factor, right.chassis_width * factor
    if max(sides) <= 100.0 and min(sides) > 1e-3:
        wrong = dataclasses.replace(right, chassis_length=sides[0], chassis_width=sides[1])
        assert vehicle_remarks(wrong)
    mass = right.body.mass * factor
    if factor > 1.0 and mass * GRAVITY < 0.01 * right.tire.vertical_stiffness and mass < 1e5:
        heavy = dataclasses.replace(right, body=dataclasses.replace(right.body, mass=mass))
        assert vehicle_remarks(heavy)


@pytest.mark.parametrize(
    ("default", "words"),
    [
        ({"wheel_inertia": 1.0}, "vehicle.wheel_inertia"),
        ({"tire": TireConfiguration()}, "vehicle.tire"),
        ({"brake": BrakeConfiguration()}, "vehicle.brake.max_torque"),
        ({"drive": DriveConfiguration()}, "vehicle.drive.max_torque"),
        ({"chassis_length": 1.6, "chassis_width": 1.2}, "vehicle.body.yaw_inertia"),
    ],
)
def test_the_default_of_a_forklift_is_reported_in_python(
    default: dict[str, Any], words: str
) -> None:
    vehicle = robot(30.0, 0.6, **default)
    with pytest.warns(ConfigurationWarning, match=words):
        Vehicle(vehicle)


def test_rollers_in_radians_are_reported_in_python() -> None:
    right = robot(60.0, 0.7)
    wheels = {
        name: dataclasses.replace(mount, roller_angle_deg=math.copysign(0.785, mount.y * mount.x))
        for name, mount in right.wheels.items()
    }
    with pytest.warns(ConfigurationWarning, match="look like radians"):
        Vehicle(dataclasses.replace(right, wheels=wheels))
