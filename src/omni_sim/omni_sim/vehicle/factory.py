"""Builds the vehicle that its configuration names, with either wheel."""

from __future__ import annotations

from numpy.typing import ArrayLike

from omni_sim.ground.elevation import ElevationConfiguration
from omni_sim.ground.friction import FrictionMap
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.roller_vehicle import RollerVehicle
from omni_sim.vehicle.vehicle import DEFAULT_PHYSICS_STEP, Vehicle


def build_vehicle(
    configuration: VehicleConfiguration,
    friction: FrictionMap | None = None,
    physics_step: float = DEFAULT_PHYSICS_STEP,
    pose: ArrayLike = (0.0, 0.0, 0.0),
    twist: ArrayLike = (0.0, 0.0, 0.0),
    elevation: ElevationConfiguration | None = None,
    wheel_angle: ArrayLike = 0.0,
) -> Vehicle:
    """Return a vehicle on the wheels of its ``wheel_model``; arguments as for `Vehicle`."""
    kind = RollerVehicle if configuration.wheel_model == "rollers" else Vehicle
    return kind(configuration, friction, physics_step, pose, twist, elevation, wheel_angle)
