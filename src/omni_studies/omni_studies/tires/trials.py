"""Checks of a vehicle with any tire: convergence in the step, rest, smooth zero crossing.

Each trial runs in one process without sensors, on even ground, in several directions of motion,
and returns the worst result.
"""

import math

import numpy as np

from omni_platform.quantities import FloatArray
from omni_sim.configuration import SimulationConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import GRAVITY
from omni_sim.vehicle.vehicle import DEFAULT_PHYSICS_STEP, Vehicle

_DIRECTIONS_DEG = (0.0, 45.0, 90.0, 180.0, 240.0, 300.0)
_PERIOD = SimulationConfiguration.control_period  # of the drive's commands [s]


def stopping_distance(
    vehicle: VehicleConfiguration, direction: float, step: float, speed: float = 4.0
) -> float:
    """Return the distance to rest with all brakes on, after 4 s [m].

    Args:
        vehicle: the vehicle.
        direction: direction of its motion in the body frame [rad].
        step: step of the physics [s].
        speed: speed at the start [m/s].
    """
    twist = (speed * math.cos(direction), speed * math.sin(direction), 0.0)
    moving = Vehicle(vehicle, physics_step=step, twist=twist)
    return float(np.hypot(*_brake(moving, 4.0)[-1, :2]))


def stopping_distance_change(vehicle: VehicleConfiguration) -> float:
    """Return the relative change of a stopping distance by halving the physics step [1]."""
    changes = []
    for direction in map(math.radians, _DIRECTIONS_DEG):
        whole, half = (
            stopping_distance(vehicle, direction, step)
            for step in (DEFAULT_PHYSICS_STEP, 0.5 * DEFAULT_PHYSICS_STEP)
        )
        changes.append(abs(half / whole - 1.0))
    return max(changes)


def slope_creep(
    vehicle: VehicleConfiguration, slope: float, settling: float = 2.0
) -> tuple[float, float]:
    """Park a vehicle with its brakes on across and along a slope.

    Args:
        vehicle: the vehicle.
        slope: rise over run [1].
        settling: time in which its tires deflect [s].

    Returns:
        Initial deflection of its tires [m], and its displacement in the following minute [m].
    """
    give, creep = [], []
    for direction in map(math.radians, _DIRECTIONS_DEG):
        parked = Vehicle(vehicle)
        pull = parked.masses.mass * GRAVITY * math.sin(math.atan(slope))
        parked.push((pull * math.cos(direction), pull * math.sin(direction)))
        settled = _brake(parked, settling)[-1, :2]
        minute = _brake(parked, 60.0)[:, :2]
        give.append(np.linalg.norm(settled))
        creep.append(np.max(np.linalg.norm(minute - settled, axis=1)))
    return float(max(give)), float(max(creep))


def creep_after_stop(vehicle: VehicleConfiguration, speed: float = 4.0) -> float:
    """Return the displacement in the minute after a stop of 6 s from a speed [m/s], in [m]."""
    creep = []
    for direction in map(math.radians, _DIRECTIONS_DEG):
        twist = (speed * math.cos(direction), speed * math.sin(direction), 0.3)
        moving = Vehicle(vehicle, twist=twist)
        stop = _brake(moving, 6.0)[-1, :2]
        creep.append(np.max(np.linalg.norm(_brake(moving, 60.0)[:, :2] - stop, axis=1)))
    return float(max(creep))


def zero_crossing(
    vehicle: VehicleConfiguration, direction: FloatArray, speed: float = 0.5
) -> FloatArray:
    """Command a speed that decreases linearly to its negative in 2 s.

    Args:
        vehicle: the vehicle.
        direction: unit body twist, shape (3,).
        speed: the first one [m/s or rad/s].

    Returns:
        Speed along `direction` at the control stamps [m/s or rad/s], shape (201,).
    """
    moving = Vehicle(vehicle, twist=speed * direction)
    enable = np.ones(len(vehicle.wheels))
    periods = round(2.0 / _PERIOD)
    steps = round(_PERIOD / moving.physics_step)
    speeds = [speed]
    for k in range(periods):
        command = speed * direction * (1.0 - 2.0 * (k + 1) / periods)
        moving.advance(steps, 0.0, enable, command)
        speeds.append(float(moving.twist @ direction))
    return np.array(speeds)


def zero_crossing_unevenness(vehicle: VehicleConfiguration) -> float:
    """Return the largest change of acceleration from one period to the next near zero [1].

    Relative to the commanded acceleration, in the second around the change of sign, in any
    direction: a speed that sticks at zero would change it by about 1.
    """
    worst = []
    for angle in map(math.radians, _DIRECTIONS_DEG):
        speed = zero_crossing(vehicle, np.array([math.cos(angle), math.sin(angle), 0.0]))
        acceleration = np.diff(speed) / _PERIOD
        near = np.abs(np.arange(len(acceleration)) - len(acceleration) // 2) <= 25
        worst.append(np.max(np.abs(np.diff(acceleration[near]))) / speed[0])
    return float(max(worst))


def _brake(vehicle: Vehicle, seconds: float) -> FloatArray:
    n = len(vehicle.wheel_names)
    return vehicle.advance(round(seconds / vehicle.physics_step), 1.0, np.ones(n), np.zeros(3))
