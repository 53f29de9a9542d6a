"""The vehicle on individual rollers in another engine: MuJoCo's rigid bodies and contacts.

Chassis, load, wheels and every roller are bodies of their own. Each wheel hangs on a vertical
spring: a rigid chassis on four wheels is statically indeterminate, and a millimeter of height would
decide which three of them carry. Rollers are ellipsoids that touch the wheel's envelope at their
middle and where the next one takes over. Friction is Coulomb's, with the sliding force of the
vehicle's tire at the load that the wheel's spring shows when a call begins; there is no slip curve.
The brake is dry friction in the wheel's joint.

Assumed where the planar vehicle needs nothing: the body is a homogeneous box as long and wide as
the chassis with the height of its center of gravity in its middle, and the load is a sphere.

Source: E. Todorov, T. Erez and Y. Tassa, "MuJoCo: A physics engine for model-based control", IROS
2012. The package is optional, see `requirements/mujoco.in`.
"""

from __future__ import annotations

import importlib
import math
import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omni_platform.configuration import ConfigurationError
from omni_platform.kinematics import PlatformKinematics
from omni_platform.quantities import FloatArray
from omni_sim.tire.tire import Tire
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import GRAVITY
from omni_sim.vehicle.vehicle import Vehicle

INSTALL = "./omni exec python -m pip install --no-deps --require-hashes -r requirements/mujoco.lock"

_DAMPING_RATIO = 0.5  # of the vehicle on its springs
_SOFTNESS = 0.002  # time constant of contacts and of the brakes' friction [s]
_LEAST_LOAD = 10.0  # at which friction is looked up [N]


def load_mujoco() -> Any:
    """Import MuJoCo, without its windows.

    Raises:
        ConfigurationError: it is not installed; says how to.
    """
    os.environ.setdefault("MUJOCO_GL", "disable")
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise ConfigurationError("mujoco", f"is not installed; {INSTALL}") from error


class MujocoVehicle:
    """A vehicle on individual rollers in MuJoCo; moves like `omni_sim.vehicle.vehicle.Vehicle`.

    Attributes:
        configuration: what the vehicle is made of.
        physics_step: [s].
    """

    def __init__(
        self,
        configuration: VehicleConfiguration,
        physics_step: float = 0.0005,
        twist: ArrayLike = (0.0, 0.0, 0.0),
        *,
        suspension: float = 2.0e5,
        height_offset: ArrayLike = 0.0,
    ) -> None:
        """Build the vehicle at the origin, rolling on its springs at rest.

        Args:
            configuration: what the vehicle is made of.
            physics_step: [s].
            twist: of base_link in the body frame [m/s, m/s, rad/s].
            suspension: stiffness of each wheel's spring [N/m].
            height_offset: by how much each wheel is mounted too high [m], a number or shape (N,).
        """
        self._mujoco = load_mujoco()
        self.configuration = configuration
        self.physics_step = physics_step
        self._kinematics = PlatformKinematics(configuration.wheels)
        n = len(configuration.wheels)
        offsets = np.broadcast_to(np.asarray(height_offset, dtype=np.float64), n)
        self._loads = Vehicle(configuration).wheels["load"]
        lines = _model(configuration, self._loads, offsets, suspension, physics_step)
        self._model = self._mujoco.MjModel.from_xml_string("\n".join(lines))
        self._data = self._mujoco.MjData(self._model)
        self._hinges = [self._dof(f"wheel_{i}") for i in range(n)]
        self._springs = [self._dof(f"spring_{i}") for i in range(n)]
        self._suspension, self._offsets = suspension, offsets
        self._tire = Tire(configuration.tire)
        count = configuration.rollers.count  # the plane is the first geometry
        self._geometries = 1 + np.arange(n * count).reshape(n, count)
        self._roll(np.asarray(twist, dtype=np.float64))

    def _dof(self, joint: str) -> int:
        return int(self._model.joint(joint).dofadr[0])

    def _roll(self, twist: FloatArray) -> None:
        velocity = self._data.qvel
        velocity[:2] = twist[:2]
        velocity[5] = twist[2]
        geometry, rollers = self._kinematics.geometry, self.configuration.rollers
        speeds = self._kinematics.wheel_speeds(twist)
        for i, hub in enumerate(self._kinematics.wheel_velocities(twist)):
            velocity[self._hinges[i]] = speeds[i]
            n_x, n_y = geometry.active[i]
            sliding = hub - speeds[i] * geometry.radius[i] * geometry.rolling[i]
            spin = (sliding[0] * n_y - sliding[1] * n_x) / rollers.radius
            for k in range(rollers.count):
                velocity[self._dof(f"roller_{i}_{k}")] = spin
        self._mujoco.mj_forward(self._model, self._data)

    def advance(self, n_steps: int, pedal: float, enable: ArrayLike) -> None:
        """Advance by some physics steps under constant brakes, the clutches open.

        Args:
            n_steps: number of physics steps.
            pedal: brake pedal, 0..1.
            enable: share of the brake pressure that reaches each wheel, 0..1, shape (N,).
        """
        torque = pedal * self.configuration.brake.max_torque * np.asarray(enable)
        self._model.dof_frictionloss[self._hinges] = torque
        for geometries, load in zip(self._geometries, self.wheel_load, strict=True):
            carried = max(float(load), _LEAST_LOAD)
            sliding = self._tire.curve(carried).slide_force / carried
            self._model.geom_friction[geometries, 0] = sliding
        self._mujoco.mj_step(self._model, self._data, nstep=n_steps)

    @property
    def pose(self) -> FloatArray:
        """x, y [m], yaw [rad] of base_link in the world frame, shape (3,)."""
        w, x, y, z = self._data.qpos[3:7]
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return np.array([self._data.qpos[0], self._data.qpos[1], yaw])

    @property
    def twist(self) -> FloatArray:
        """Velocity of base_link in the body frame, seen from above [m/s, m/s, rad/s], (3,)."""
        v_x, v_y = self._data.qvel[:2]
        cos, sin = math.cos(self.pose[2]), math.sin(self.pose[2])
        rate = self._data.qvel[5]
        return np.array([cos * v_x + sin * v_y, cos * v_y - sin * v_x, rate])

    @property
    def wheel_speed(self) -> FloatArray:
        """Wheel speeds [rad/s], shape (N,)."""
        return np.array(self._data.qvel[self._hinges])

    @property
    def wheel_load(self) -> FloatArray:
        """Wheel loads [N] as the springs show them, without their dampers, shape (N,)."""
        places = [self._model.joint(f"spring_{i}").qposadr[0] for i in range(len(self._springs))]
        pressed = self._data.qpos[places] - self._offsets
        return np.asarray(self._loads + self._suspension * pressed, dtype=np.float64)


def _model(
    vehicle: VehicleConfiguration,
    loads: FloatArray,
    offsets: FloatArray,
    suspension: float,
    physics_step: float,
) -> Iterator[str]:
    """Write a vehicle in MuJoCo's format.

    Args:
        vehicle: what it is made of.
        loads: of the wheels at rest [N], shape (N,).
        offsets: by how much each wheel is mounted too high [m], shape (N,).
        suspension: stiffness of each wheel's spring [N/m].
        physics_step: [s].
    """
    mass = float(loads.sum()) / GRAVITY
    n, rollers = len(vehicle.wheels), vehicle.rollers
    damping = 2.0 * _DAMPING_RATIO * math.sqrt(suspension * mass / n)
    soft = f"{_SOFTNESS:g} 1"
    yield "<mujoco><compiler angle='radian' autolimits='true'/>"
    yield (
        f"<option timestep='{physics_step:g}' gravity='0 0 -{GRAVITY:g}' cone='elliptic' "
        "impratio='10' integrator='implicitfast' solver='Newton'/>"
    )
    yield f"<default><geom friction='0 0 0' condim='3' solref='{soft}'/></default>"
    yield "<worldbody><geom type='plane' size='1 1 1' contype='0' conaffinity='1'/>"
    yield "<body name='base'><freejoint/>"
    roller_mass = 2.0 * rollers.inertia / rollers.radius**2
    wheel_mass = rollers.count * roller_mass
    body, load = vehicle.body, vehicle.load
    # In the planar vehicle the wheels' mass and moment about the vertical are the body's.
    reach = sum(mount.x**2 + mount.y**2 for mount in vehicle.wheels.values())
    chassis = body.mass - n * wheel_mass
    yaw_inertia = max(body.yaw_inertia - wheel_mass * reach, 0.1 * body.yaw_inertia)
    box = (vehicle.chassis_width, vehicle.chassis_length, 2.0 * body.height)
    roll = chassis / 12.0 * (box[0] ** 2 + box[2] ** 2)
    pitch = chassis / 12.0 * (box[1] ** 2 + box[2] ** 2)
    yaw_inertia = min(yaw_inertia, 0.999 * (roll + pitch))  # what any rigid body keeps
    yield (
        f"<inertial pos='{body.x} {body.y} {body.height}' mass='{chassis}' "
        f"diaginertia='{roll} {pitch} {yaw_inertia}'/>"
    )
    if load.mass > 0.0:
        ball = max(load.yaw_inertia, 1e-3)
        yield (
            f"<body pos='{load.x} {load.y} {load.height}'><inertial pos='0 0 0' "
            f"mass='{load.mass}' diaginertia='{ball} {ball} {ball}'/></body>"
        )
    geometry = PlatformKinematics(vehicle.wheels).geometry
    for i, mount in enumerate(vehicle.wheels.values()):
        distance = mount.radius - rollers.radius
        u_x, u_y = geometry.rolling[i]
        axis = np.array([-u_y, u_x, 0.0])
        rest = (wheel_mass * GRAVITY - loads[i]) / suspension + offsets[i]
        hub = max(vehicle.wheel_inertia - wheel_mass * distance**2, 0.1 * vehicle.wheel_inertia)
        yield f"<body pos='{mount.x} {mount.y} {mount.radius}'>"
        yield (
            f"<joint name='spring_{i}' type='slide' axis='0 0 1' stiffness='{suspension}' "
            f"springref='{rest}' damping='{damping}'/>"
        )
        yield (
            f"<joint name='wheel_{i}' type='hinge' axis='{_numbers(axis)}' armature='{hub}' "
            f"solreffriction='{soft}'/>"
        )
        yield "<inertial pos='0 0 0' mass='0.01' diaginertia='1e-4 1e-4 1e-4'/>"
        lowest = np.array([*geometry.active[i], 0.0])
        tilt = abs(float(geometry.active[i] @ geometry.rolling[i]))  # sin(delta)
        for k in range(rollers.count):
            angle = 2.0 * math.pi * k / rollers.count
            place = _turned(np.array([0.0, 0.0, -distance]), axis, angle)
            along = _turned(lowest, axis, angle)
            # The ellipsoid that fills the envelope in the middle and at the change of rollers.
            half = distance * math.tan(math.pi / rollers.count) / tilt
            change = mount.radius - distance / math.cos(math.pi / rollers.count)
            length = half / math.sqrt(1.0 - (change / rollers.radius) ** 2)
            across = roller_mass * (rollers.radius**2 / 4.0 + half**2 / 3.0)
            yield f"<body pos='{_numbers(place)}' zaxis='{_numbers(along)}'>"
            yield f"<joint name='roller_{i}_{k}' type='hinge' axis='0 0 1'/>"
            yield (
                f"<inertial pos='0 0 0' mass='{roller_mass}' "
                f"diaginertia='{across} {across} {rollers.inertia}'/>"
            )
            size = f"{rollers.radius} {rollers.radius} {length}"
            yield f"<geom type='ellipsoid' size='{size}' contype='1' conaffinity='0'/></body>"
        yield "</body>"
    yield "</body></worldbody></mujoco>"


def _turned(vector: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """Turn a vector about a unit axis (Rodrigues)."""
    cos, sin = math.cos(angle), math.sin(angle)
    along = float(axis @ vector) * (1.0 - cos) * axis
    return np.asarray(cos * vector + sin * np.cross(axis, vector) + along, dtype=np.float64)


def _numbers(values: FloatArray) -> str:
    return " ".join(f"{value:.12g}" for value in values)
