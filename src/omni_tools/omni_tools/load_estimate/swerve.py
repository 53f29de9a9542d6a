"""Rotation of a vehicle with its load in a stop without assistance."""

import dataclasses
import math

import numpy as np

from omni_core.geometry import PlatformGeometry, turned
from omni_core.quantities import CONTROL_PERIOD, FloatArray
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle

_DIRECTIONS = 12
_LONGEST = 60.0  # limit on the simulated duration of a stop [s]
_SLIP = 1e-6  # limit on the sideslip of a wheel that rolls [1]
_REST = 0.05  # speed of a vehicle at rest [m/s]


def with_load(vehicle: VehicleConfiguration, load: FloatArray) -> VehicleConfiguration:
    """Return a vehicle whose load has another mass [kg] and position [m, m], shape (3,).

    Height and inertia of the load are not changed. A load that lacks a height has the body's.
    """
    mass, x, y = (float(value) for value in load)
    height = vehicle.load.height or vehicle.body.height
    carried = dataclasses.replace(vehicle.load, mass=max(mass, 0.0), x=x, y=y, height=height)
    return dataclasses.replace(vehicle, load=carried)


def largest_rotation(vehicle: VehicleConfiguration, speed: float) -> tuple[float, float]:
    """Return the largest rotation in a simulated stop with all brakes fully on [deg].

    Directions in which conventional wheels cannot roll are left out.

    Args:
        vehicle: vehicle with its load, on dry ground.
        speed: speed at the start [m/s].

    Returns:
        Rotation, positive counter-clockwise, and direction of motion in which it occurs [deg].
    """
    directions = np.arange(_DIRECTIONS) * 360.0 / _DIRECTIONS
    rotations = [_rotation(vehicle, speed, math.radians(one)) for one in directions]
    worst = int(np.argmax(np.abs(rotations)))
    return rotations[worst], float(directions[worst])


def highest_speed(vehicle: VehicleConfiguration, rotation: float, speed: float) -> float:
    """Return the highest speed up to `speed` [m/s] without a larger rotation [deg] in a stop."""
    low, high = 0.0, speed
    for _ in range(6):  # to 2 % of the speed
        middle = 0.5 * (low + high)
        if abs(largest_rotation(vehicle, middle)[0]) > rotation:
            high = middle
        else:
            low = middle
    return low


def _rotation(vehicle: VehicleConfiguration, speed: float, direction: float) -> float:
    """Return the rotation in a stop [deg]; 0 if the wheels cannot roll in this direction [rad]."""
    twist = np.array([speed * math.cos(direction), speed * math.sin(direction), 0.0])
    simulated = Vehicle(vehicle, twist=twist)
    geometry = PlatformGeometry.from_wheels(vehicle.wheels)
    axis = turned(geometry.axis, simulated.steering[0])[geometry.conventional]
    if np.max(np.abs(axis @ twist[:2]), initial=0.0) > _SLIP * speed:
        return 0.0
    steps = round(CONTROL_PERIOD / simulated.physics_step)
    on = np.ones(len(vehicle.wheels))
    for _ in range(round(_LONGEST / CONTROL_PERIOD)):
        simulated.advance(steps, 1.0, on, np.zeros(3), traced=False)
        if math.hypot(*simulated.twist[:2]) < _REST:
            break
    return math.degrees(float(simulated.pose[2]))
