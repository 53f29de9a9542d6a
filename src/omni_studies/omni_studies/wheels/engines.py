"""Emergency braking of one vehicle in different engines, by the brake assistant itself."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from omni_brake_assist.brake_assist import BrakeAssist, BrakeAssistConfiguration, BrakeDemand
from omni_platform.kinematics import PlatformKinematics
from omni_platform.quantities import FloatArray
from omni_platform.signals import ImuSample, TwistSample, WheelSample
from omni_sim.configuration import SimulationConfiguration
from omni_sim.imu import IMU_DRAWS, ImuConfiguration, build_imu, read_imu
from omni_sim.run_progress import (
    RUNNING,
    STOPPED,
    rest_memory,
    rim_speed,
    run_end,
    run_outcome,
)
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.wheels.mujoco_vehicle import MujocoVehicle

PERIOD = 0.01
"""Control period [s]."""

_LONGEST = 10.0  # [s]
_END = run_end(SimulationConfiguration(duration_limit=_LONGEST))
_BEFORE = 50  # control periods for which the assistant hears the vehicle before the pedal goes down
_IMU = ImuConfiguration(
    misalignment_deg=0.0, gyro_bias=0.0, gyro_scale=0.0, bias_x=0.0, bias_y=0.0, scale=0.0
)


class Machine(Protocol):
    """A vehicle in any engine."""

    physics_step: float

    @property
    def pose(self) -> FloatArray:
        """x, y [m], yaw [rad] of base_link in the world frame, shape (3,)."""

    @property
    def twist(self) -> FloatArray:
        """Of base_link in the body frame [m/s, m/s, rad/s], shape (3,)."""

    @property
    def wheel_speed(self) -> FloatArray:
        """Wheel speeds [rad/s], shape (N,)."""

    def advance(self, n_steps: int, pedal: float, enable: ArrayLike, /) -> object:
        """Advance by some physics steps under constant brakes, the clutches open."""


class PlanarMachine:
    """Our own vehicle as a `Machine`."""

    def __init__(self, configuration: VehicleConfiguration, twist: ArrayLike) -> None:
        self._vehicle = Vehicle(configuration, twist=twist)
        self.physics_step = self._vehicle.physics_step

    @property
    def pose(self) -> FloatArray:
        """x, y [m], yaw [rad] of base_link in the world frame, shape (3,)."""
        return self._vehicle.pose

    @property
    def twist(self) -> FloatArray:
        """Of base_link in the body frame [m/s, m/s, rad/s], shape (3,)."""
        return self._vehicle.twist

    @property
    def wheel_speed(self) -> FloatArray:
        """Wheel speeds [rad/s], shape (N,)."""
        return self._vehicle.wheels["speed"]

    def advance(self, n_steps: int, pedal: float, enable: ArrayLike) -> object:
        """Advance by some physics steps under constant brakes, the clutches open."""
        return self._vehicle.advance(n_steps, pedal, enable, np.zeros(3), traced=False)


ENGINES: dict[str, Callable[[VehicleConfiguration, ArrayLike], PlanarMachine | MujocoVehicle]] = {
    "single": lambda vehicle, twist: PlanarMachine(_on(vehicle, "single"), twist),
    "rollers": lambda vehicle, twist: PlanarMachine(_on(vehicle, "rollers"), twist),
    "mujoco": lambda vehicle, twist: MujocoVehicle(vehicle, twist=twist),
}
"""How to build the vehicle in each engine: our two wheel models, and MuJoCo."""


def _on(vehicle: VehicleConfiguration, wheel_model: str) -> VehicleConfiguration:
    return dataclasses.replace(vehicle, wheel_model=wheel_model)


@dataclasses.dataclass(frozen=True)
class Stop:
    """A braking from the first step to rest.

    Attributes:
        path: pose at each control stamp [m, m, rad], shape (T, 3).
        stopped: whether the vehicle came to rest.
    """

    path: FloatArray
    stopped: bool

    @property
    def swerve(self) -> float:
        """Change of yaw [deg], counter-clockwise."""
        return math.degrees(float(self.path[-1, 2] - self.path[0, 2]))

    @property
    def distance(self) -> float:
        """Straight line from start to end [m]."""
        return math.hypot(*(self.path[-1, :2] - self.path[0, :2]))


class _Informed:
    """The brake assistant, told the truth by twist, encoders and an IMU without errors."""

    def __init__(self, assistant: BrakeAssistConfiguration) -> None:
        self._assist = BrakeAssist(assistant)
        self._imu = build_imu(_IMU, PERIOD)
        self._told = 0  # stamps

    def enable(
        self, pedal: float, pose: FloatArray, twist: FloatArray, wheel_speed: FloatArray
    ) -> FloatArray:
        """Return the shares of brake pressure at the next stamp, shape (N,)."""
        stamp, felt = round(self._told * PERIOD * 1e9), np.empty(3)
        motion = np.concatenate([pose, twist])
        read_imu(self._imu, self._told, PERIOD, motion, (0.0, 0.0), np.zeros(IMU_DRAWS), felt)
        self._told += 1
        demand = BrakeDemand(
            stamp,
            pedal,
            TwistSample(stamp, twist, np.eye(3) * 1e-6),
            WheelSample(stamp, wheel_speed),
            ImuSample(stamp, float(felt[0]), felt[1:]),
        )
        return self._assist.update(demand).enable


def brake_to_rest(machine: Machine, assistant: BrakeAssistConfiguration) -> Stop:
    """Brake fully until the vehicle stands; the assistant is told the truth.

    Args:
        machine: at speed. Until the pedal goes down it rolls as if no force acted on it.
        assistant: which may be switched off.
    """
    informed, rolling = _Informed(assistant), PlatformKinematics.of(assistant.wheels)
    steps = round(PERIOD / machine.physics_step)
    first = machine.twist
    for index in range(-_BEFORE, 0):
        turned = first[2] * index * PERIOD
        cos, sin = math.cos(turned), math.sin(turned)
        v_x, v_y = cos * first[0] + sin * first[1], cos * first[1] - sin * first[0]
        twist = np.array([v_x, v_y, first[2]])
        where = machine.pose + np.array([0.0, 0.0, turned])
        informed.enable(0.0, where, twist, rolling.wheel_speeds(twist))
    path, rest = [machine.pose], rest_memory()
    for index in itertools.count(1):
        enable = informed.enable(1.0, machine.pose, machine.twist, machine.wheel_speed)
        machine.advance(steps, 1.0, enable)
        path.append(machine.pose)
        stamp = round(index * PERIOD * 1e9)
        outcome = run_outcome(_END, rest, stamp, 1.0, rim_speed(machine.twist))
        if outcome != RUNNING:
            break
    pose = np.array(path)
    pose[:, 2] = np.unwrap(pose[:, 2])
    return Stop(pose, outcome == STOPPED)
