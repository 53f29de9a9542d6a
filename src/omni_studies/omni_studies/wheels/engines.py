"""Emergency braking of a vehicle in different engines with the brake assistant."""

import dataclasses
import itertools
import math

import numpy as np
from numpy.typing import ArrayLike

from omni_brake_assist.brake_assist import BrakeAssist, BrakeAssistConfiguration, BrakeDemand
from omni_platform import kinematics, signals
from omni_platform.quantities import FloatArray
from omni_sim import run_progress
from omni_sim.configuration import SimulationConfiguration
from omni_sim.imu import IMU_DRAWS, ImuConfiguration, build_imu, read_imu
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.mujoco_vehicle import build_vehicle
from omni_sim.vehicle.vehicle import Vehicle

PERIOD = SimulationConfiguration.control_period
"""Control period [s]."""

_LONGEST = 10.0  # [s]
_END = run_progress.run_end(SimulationConfiguration(duration_limit=_LONGEST))
_BEFORE = 50  # control periods with measurements before the pedal goes down
_IMU = ImuConfiguration(
    misalignment_deg=0.0, gyro_bias=0.0, gyro_scale=0.0, bias_x=0.0, bias_y=0.0, scale=0.0
)


ENGINES = ("single", "rollers", "mujoco")
"""Wheel models of a vehicle: two of the simulator, and MuJoCo's."""


def in_engine(configuration: VehicleConfiguration, engine: str, twist: ArrayLike) -> Vehicle:
    """Return a vehicle at the origin in an engine, moving with a body twist, shape (3,)."""
    return build_vehicle(dataclasses.replace(configuration, wheel_model=engine), twist=twist)


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
    """The brake assistant with twist, encoders and IMU without errors."""

    def __init__(self, assistant: BrakeAssistConfiguration) -> None:
        self._assist = BrakeAssist(assistant)
        self._imu = build_imu(_IMU, PERIOD)
        self._stamps = 0

    def enable(
        self, pedal: float, pose: FloatArray, twist: FloatArray, wheel_speed: FloatArray
    ) -> FloatArray:
        """Return the shares of brake pressure at the next stamp, shape (N,)."""
        stamp, felt = round(self._stamps * PERIOD * 1e9), np.empty(3)
        motion = np.concatenate([pose, twist])
        read_imu(self._imu, self._stamps, PERIOD, motion, (0.0, 0.0), np.zeros(IMU_DRAWS), felt)
        self._stamps += 1
        demand = BrakeDemand(
            stamp,
            pedal,
            signals.TwistSample(stamp, twist, np.eye(3) * 1e-6),
            signals.WheelSample(stamp, wheel_speed),
            signals.ImuSample(stamp, float(felt[0]), felt[1:]),
        )
        return self._assist.update(demand).enable


def brake_to_rest(vehicle: Vehicle, assistant: BrakeAssistConfiguration) -> Stop:
    """Brake fully until the vehicle is at rest; the assistant receives true values.

    Args:
        vehicle: vehicle in motion; before braking it rolls without forces.
        assistant: the assistant, which may be switched off.
    """
    informed, rolling = _Informed(assistant), kinematics.PlatformKinematics.of(assistant.wheels)
    steps = round(PERIOD / vehicle.physics_step)
    first = vehicle.twist
    for index in range(-_BEFORE, 0):
        turned = first[2] * index * PERIOD
        cos, sin = math.cos(turned), math.sin(turned)
        v_x, v_y = cos * first[0] + sin * first[1], cos * first[1] - sin * first[0]
        twist = np.array([v_x, v_y, first[2]])
        where = vehicle.pose + np.array([0.0, 0.0, turned])
        informed.enable(0.0, where, twist, rolling.wheel_speeds(twist))
    path, rest = [vehicle.pose], run_progress.rest_memory()
    for index in itertools.count(1):
        enable = informed.enable(1.0, vehicle.pose, vehicle.twist, vehicle.wheels["speed"])
        vehicle.advance(steps, 1.0, enable, np.zeros(3), traced=False)
        path.append(vehicle.pose)
        stamp = round(index * PERIOD * 1e9)
        outcome = run_progress.run_outcome(
            _END, rest, stamp, 1.0, run_progress.rim_speed(vehicle.twist)
        )
        if outcome != run_progress.RUNNING:
            break
    pose = np.array(path)
    pose[:, 2] = np.unwrap(pose[:, 2])
    return Stop(pose, outcome == run_progress.STOPPED)
