"""Emergency braking of one vehicle in different engines, by the brake assistant itself."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from omni_analysis.wheels.mujoco_vehicle import MujocoVehicle
from omni_brake_assist.brake_assist import BrakeAssist, BrakeAssistConfiguration, BrakeDemand
from omni_platform.quantities import FloatArray
from omni_platform.signals import Twist
from omni_sim.run_progress import (
    RUNNING,
    STOPPED,
    rest_memory,
    rim_speed,
    run_end,
    run_outcome,
)
from omni_sim.simulator import SimulationConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle

PERIOD = 0.01
"""Control period [s]."""

_LONGEST = 10.0  # [s]
_END = run_end(SimulationConfiguration(duration_limit=_LONGEST))


class Machine(Protocol):
    """A vehicle in any engine."""

    physics_step: float

    @property
    def pose(self) -> FloatArray:
        """x, y [m], yaw [rad] of base_link in the world frame, shape (3,)."""

    @property
    def twist(self) -> FloatArray:
        """Of base_link in the body frame [m/s, m/s, rad/s], shape (3,)."""

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


def brake_to_rest(machine: Machine, assistant: BrakeAssistConfiguration) -> Stop:
    """Brake fully until the vehicle stands; the assistant is told the true twist.

    Args:
        machine: at speed.
        assistant: which may be switched off.
    """
    assist = BrakeAssist(assistant)
    steps = round(PERIOD / machine.physics_step)
    path, rest = [machine.pose], rest_memory()
    for index in itertools.count():
        stamp = round(index * PERIOD * 1e9)
        twist = machine.twist
        feedback = Twist(stamp, twist, np.eye(3) * 1e-6)
        machine.advance(steps, 1.0, assist.update(BrakeDemand(stamp, 1.0, feedback)).enable)
        path.append(machine.pose)
        outcome = run_outcome(
            _END, rest, round(stamp + PERIOD * 1e9), 1.0, rim_speed(machine.twist)
        )
        if outcome != RUNNING:
            break
    pose = np.array(path)
    pose[:, 2] = np.unwrap(pose[:, 2])
    return Stop(pose, outcome == STOPPED)
