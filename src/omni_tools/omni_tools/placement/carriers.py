"""Cameras that turn with steered wheels, at the steering angles of each motion."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from omni_core.sensors import LineSensor, turned_mount
from omni_sim.configuration import check_carriers
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_tools.placement.error import MotionMix


class SteeredCameras(NamedTuple):
    """Cameras at the steering angles with which a vehicle follows a motion.

    Attributes:
        sensors: cameras at these angles, keyed by name.
        mix: mix that contains only this motion.
        angle_deg: angle of each carrier [deg], keyed by wheel.
    """

    sensors: Mapping[str, LineSensor]
    mix: MotionMix
    angle_deg: Mapping[str, float]


def steered_cameras(
    sensors: Mapping[str, LineSensor], vehicle: VehicleConfiguration, mix: MotionMix
) -> dict[str, SteeredCameras]:
    """Return the cameras in each motion that turns them, keyed by motion; mirror images have a 2.

    Args:
        sensors: cameras in the body frame at steering angles of 0, keyed by name.
        vehicle: vehicle with the carriers.
        mix: motions of the center of the chassis.

    Raises:
        ConfigurationError: a carrier is not a steered wheel, or its position is not the wheel's.
    """
    check_carriers(sensors, vehicle.wheels)
    carriers = list(dict.fromkeys(one.carrier for one in sensors.values() if one.carrier))
    if not carriers:
        return {}
    x, y = vehicle.chassis_center
    found: dict[str, SteeredCameras] = {}
    for row, (name, (v_x, v_y, turn)) in enumerate(zip(mix.names, mix.twist, strict=True)):
        at_base = np.array([v_x + turn * y, v_y - turn * x, turn])
        steering = Vehicle(vehicle, twist=at_base).steering[0].tolist()
        angles = dict(zip(vehicle.wheels, steering, strict=True))
        if any(angles[wheel] for wheel in carriers):
            turned = {
                camera: turned_mount(one, angles.get(one.carrier, 0.0))
                for camera, one in sensors.items()
            }
            alone = MotionMix((name,), mix.twist[[row]], np.ones(1))
            degrees = {wheel: math.degrees(angles[wheel]) for wheel in carriers}
            key = f"{name}_2" if name in found else name
            found[key] = SteeredCameras(turned, alone, degrees)
    return found
