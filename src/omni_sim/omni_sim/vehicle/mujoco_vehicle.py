"""Vehicle with individual rollers, simulated by MuJoCo with rigid bodies and contacts.

Chassis, load, wheels and all rollers are separate bodies. Each wheel is mounted on a vertical
spring, because a rigid chassis on four wheels is statically indeterminate: a height difference of a
millimeter would determine which three wheels carry load. Rollers are ellipsoids that touch the
wheel's envelope at their middle and at the change to the next roller; a conventional wheel is a
sphere that turns about its axle. Friction is Coulomb friction
without a slip curve. At the start of a call of `advance`, the friction coefficient of a wheel
becomes the sliding force of the tire on the ground under it, divided by the wheel load. The brake
is dry friction in the wheel's joint, and the drive is a velocity servo in the same joint.

Further assumptions: the body is a homogeneous box as long and wide as the chassis, with its center
of gravity in the middle, and the load is a sphere.

Source: E. Todorov, T. Erez and Y. Tassa, "MuJoCo: A physics engine for model-based control", IROS
2012. The package is optional, see `requirements/mujoco.in`.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omni_core.configuration import ConfigurationError
from omni_core.geometry import PlatformGeometry
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.ground.configuration import ElevationConfiguration
from omni_sim.ground.friction import FrictionMap, friction_at
from omni_sim.mujoco_import import load_mujoco
from omni_sim.tire.interface.model import curve_at
from omni_sim.vehicle import state as layout
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.dynamics import in_turned_frame
from omni_sim.vehicle.plant import static_loads
from omni_sim.vehicle.vehicle import Vehicle, VehicleInputError
from omni_sim.wheel.brake_pressure import press, set_demand
from omni_sim.wheel.roller_geometry import RollerConfiguration

_DAMPING_RATIO = 0.5  # damping ratio of the vehicle on its springs
_SOFTNESS = 0.002  # time constant of contacts and of the brakes' friction [s]
_LEAST_LOAD = 10.0  # smallest load for which friction is computed [N]


def build_vehicle(configuration: VehicleConfiguration, *others: Any, **options: Any) -> Vehicle:
    """Return a vehicle of the class that the wheel model requires.

    The arguments are those of the constructor of `Vehicle`.
    """
    kind = MujocoVehicle if configuration.wheel_model == "mujoco" else Vehicle
    return kind(configuration, *others, **options)


class MujocoVehicle(Vehicle):
    """A vehicle on individual rollers in MuJoCo, on flat ground.

    Each call of `advance` writes the vehicle's state: motion, wheel speeds and angles, loads of the
    springs, brake torques, and the contact forces along the active directions.
    """

    def __init__(
        self,
        configuration: VehicleConfiguration,
        *others: Any,
        suspension: float = 2.0e5,
        height_offset: ArrayLike = 0.0,
        **options: Any,
    ) -> None:
        """Build the vehicle and place it with rolling wheels and its springs at rest.

        Args:
            configuration: configuration of the vehicle.
            *others: further positional arguments of `Vehicle`.
            suspension: stiffness of each wheel's spring [N/m].
            height_offset: error of each wheel's mounting height [m], a number or shape (N,).
            **options: keyword arguments of `Vehicle`.

        Raises:
            ConfigurationError: MuJoCo is not installed, or the ground is not flat.
            VehicleInputError: a number is out of range.
        """
        self._mujoco = load_mujoco()
        self._stiffness = suspension
        offsets = np.asarray(height_offset, dtype=np.float64)
        self._offsets = np.broadcast_to(offsets, len(configuration.wheels))
        super().__init__(configuration, *others, **options)

    def _build_state(
        self, friction: FrictionMap, elevation: ElevationConfiguration | None
    ) -> layout.State:
        state = super()._build_state(friction, elevation)
        if len(state.terrain.parts):
            raise ConfigurationError("ground.elevation", "must be flat for wheel_model 'mujoco'")
        configuration, n = self.configuration, len(state.wheels)
        self._loads = static_loads(state.plant)
        design = self._loads, self._offsets, self._stiffness, self.physics_step
        text = "\n".join(_model(configuration, *design))
        self._model = self._mujoco.MjModel.from_xml_string(text)
        self._data = self._mujoco.MjData(self._model)
        joints = [self._model.joint(f"wheel_{i}") for i in range(n)]
        self._hinges = np.array([int(joint.dofadr[0]) for joint in joints])
        self._angles = np.array([int(joint.qposadr[0]) for joint in joints])
        springs = [self._model.joint(f"spring_{i}") for i in range(n)]
        self._springs = np.array([int(joint.qposadr[0]) for joint in springs])
        # Number of geometries of each wheel that can touch the ground.
        conventional = PlatformGeometry.from_wheels(configuration.wheels).conventional
        touching = np.where(conventional, 1, configuration.rollers.count)
        ends = 1 + np.cumsum([0, *touching])  # the ground plane is the first geometry
        self._geometries = [np.arange(*pair) for pair in itertools.pairwise(ends)]
        self._wheel_of = np.repeat(np.arange(-1, n), [1, *touching])
        return state

    def place(self, pose: ArrayLike, twist: ArrayLike) -> None:
        """Place the vehicle with wheels and rollers that roll without slip at the given twist.

        Args:
            pose: x, y [m], yaw [rad] of base_link in the world frame.
            twist: twist of base_link in the body frame [m/s, m/s, rad/s].
        """
        super().place(pose, twist)
        data, (x, y, yaw), moving = self._data, np.asarray(pose), np.asarray(twist)
        self._mujoco.mj_resetData(self._model, data)
        data.qpos[:7] = x, y, 0.0, math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)
        data.qpos[self._angles] = self._start_angle
        data.qvel[:2] = in_turned_frame(moving[0], moving[1], -yaw)
        data.qvel[5] = moving[2]
        speeds = data.qvel[self._hinges] = self.drive_speeds(moving)
        geometry, rollers = self.kinematics.geometry, self.configuration.rollers
        for i, hub in enumerate(self.kinematics.wheel_velocities(moving)):
            n_x, n_y = geometry.active[i]
            sliding = hub - speeds[i] * geometry.radius[i] * geometry.rolling[i]
            surface = sliding[0] * n_y - sliding[1] * n_x
            for k in range(0 if geometry.conventional[i] else rollers.count):
                joint = self._model.joint(f"roller_{i}_{k}")
                data.qvel[joint.dofadr[0]] = surface / rollers.radii[k % 2]
        self._mujoco.mj_forward(self._model, data)
        self._write_back(np.zeros(len(speeds)))

    def drive_speeds(self, twist: ArrayLike) -> FloatArray:
        """Return the wheel speeds that the drive commands for a body twist, Eq. (28).

        Args:
            twist: twist in the body frame [m/s, m/s, rad/s], shape (..., 3).

        Returns:
            Wheel speeds with the nominal radii [rad/s], shape (..., N).
        """
        return self.kinematics.wheel_speeds(np.asarray(twist))

    def _run(self, control: layout.Control, steps: int, trajectory: FloatArray) -> None:
        if control.force_x or control.force_y or control.moment:
            raise VehicleInputError("wheel_model 'mujoco' supports no external forces")
        plant, pressure, data = self.state.plant, self.state.pressure, self._data
        set_demand(pressure, control.brake, control.enable)
        limits = self._set_friction()
        self._model.actuator_gainprm[:, 0] = control.drive_stiffness
        self._model.actuator_biasprm[:, 2] = -control.drive_stiffness
        start, twist = self.pose[2], control.twist
        for k in range(steps + 1):
            pose, rates = self._base()
            self.state.body["yaw"] = pose[2]
            if len(trajectory):
                trajectory[k] = *pose, *rates
            if k == steps:
                break
            turned = pose[2] - start if control.in_world else 0.0
            ahead = *in_turned_frame(twist[0], twist[1], turned), twist[2]
            data.ctrl[:] = self.drive_speeds(ahead)
            press(pressure)
            self._model.dof_frictionloss[self._hinges] = self.configuration.brake.limited(
                plant.brake_share * pressure.acting, data.qvel[self._hinges]
            )
            self._mujoco.mj_step(self._model, data)
        self._write_back(limits)
        loads, counters = self.state.wheels["load"], self.state.counters[0]
        self.tipping = bool(np.count_nonzero(loads > 0.0) < 3)
        counters["tipping_steps"] += steps * self.tipping
        counters["overloaded_steps"] += steps * np.count_nonzero(loads > plant.largest_load)

    def _set_friction(self) -> FloatArray:
        """Set the rollers' friction for each wheel; return the friction limits [N], shape (N,)."""
        plant, (x, y, yaw) = self.state.plant, self.pose
        limits = np.empty(len(self._hinges))
        for i, (mount, load) in enumerate(
            zip(self.configuration.wheels.values(), self.state.wheels["load"], strict=True)
        ):
            a, b = in_turned_frame(mount.x, mount.y, -yaw)
            friction = plant.grip[i] * friction_at(plant.friction, plant.patches, x + a, y + b)
            carried = min(max(float(load), _LEAST_LOAD), plant.largest_load)
            limits[i] = curve_at(plant.tire, carried, friction).slide_force
            self._model.geom_friction[self._geometries[i], 0] = limits[i] / carried
        return limits

    def _base(self) -> tuple[FloatArray, FloatArray]:
        """Return x, y [m], yaw [rad] of base_link in the world and their rates, shape (3,) each."""
        w, x, y, z = self._data.qpos[3:7]
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        yaw += 2.0 * math.pi * round((self.state.body[0]["yaw"] - yaw) / (2.0 * math.pi))
        place, velocity = self._data.qpos, self._data.qvel
        return np.array([*place[:2], yaw]), np.array([*velocity[:2], velocity[5]])

    def _write_back(self, limits: FloatArray) -> None:
        """Copy MuJoCo's state and the friction limits [N] to the state of the planar model."""
        data, body, wheels = self._data, self.state.body[0], self.state.wheels
        (x, y, yaw), (v_x, v_y, rate) = self._base()
        c_x, c_y = self.masses.center
        g_x, g_y = in_turned_frame(c_x, c_y, -yaw)
        for name, value in (
            *(("x", x + g_x), ("y", y + g_y), ("yaw", yaw)),
            *(("v_x", v_x - rate * g_y), ("v_y", v_y + rate * g_x), ("yaw_rate", rate)),
        ):
            body[name] = value
        wheels["speed"], wheels["angle"] = data.qvel[self._hinges], data.qpos[self._angles]
        # The wheel loads include the forces of the springs, but not those of the dampers.
        wheels["load"] = self._loads + self._stiffness * (data.qpos[self._springs] - self._offsets)
        dry = data.efc_type == self._mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
        torques = dict(zip(data.efc_id[dry], data.efc_force[dry], strict=True))
        wheels["brake"] = [torques.get(hinge, 0.0) for hinge in self._hinges]
        force = np.zeros((len(wheels), 3))
        for index, contact in enumerate(data.contact):
            push = np.zeros(6)
            self._mujoco.mj_contactForce(self._model, data, index, push)
            wheel = self._wheel_of[max(contact.geom)]
            force[wheel] += contact.frame.reshape(3, 3).T @ push[:3]
        cos, sin = math.cos(yaw), math.sin(yaw)
        in_body = force[:, :2] @ np.array([[cos, -sin], [sin, cos]])
        wheels["force"] = np.sum(in_body * self.kinematics.geometry.active, axis=1)
        reference = self.kinematics.geometry.radius * np.abs(wheels["speed"])
        wheels["slip"] = self.slip_velocity / (reference + self.state.plant.slip_speed)
        wheels["limit"] = limits
        wheels["sliding"] = np.abs(wheels["force"]) >= 0.99 * limits

    @property
    def attitude(self) -> FloatArray:
        """Height of base_link [m], roll, pitch [rad] of the chassis on its springs, shape (3,)."""
        w, x, y, z = self._data.qpos[3:7]
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        return np.array([self._data.qpos[2], roll, math.asin(2.0 * (w * y - z * x))])


def _model(
    vehicle: VehicleConfiguration,
    loads: FloatArray,
    offsets: FloatArray,
    suspension: float,
    physics_step: float,
) -> Iterator[str]:
    """Generate the lines of a vehicle's description in MuJoCo's XML format.

    Args:
        vehicle: configuration of the vehicle.
        loads: loads of the wheels at rest [N], shape (N,).
        offsets: error of each wheel's mounting height [m], shape (N,).
        suspension: stiffness of each wheel's spring [N/m].
        physics_step: length of a step [s].
    """
    n, rollers = len(vehicle.wheels), vehicle.rollers
    damping = 2.0 * _DAMPING_RATIO * math.sqrt(suspension * float(loads.sum()) / GRAVITY / n)
    soft = f"{_SOFTNESS:g} 1"
    yield "<mujoco><compiler angle='radian' autolimits='true'/>"
    yield (
        f"<option timestep='{physics_step:g}' gravity='0 0 -{GRAVITY:g}' cone='elliptic' "
        "impratio='10' integrator='implicitfast' solver='Newton'/>"
    )
    yield f"<default><geom friction='0 0 0' condim='3' solref='{soft}'/></default>"
    yield "<worldbody><geom type='plane' size='1 1 1' contype='0' conaffinity='1'/>"
    yield "<body name='base'><freejoint/>"
    geometry = PlatformKinematics(vehicle.wheels).geometry
    # The mass of a conventional wheel belongs to the body.
    masses = ~geometry.conventional * 0.5 * rollers.count * np.sum(_roller_masses(rollers))
    yield from _chassis(vehicle, masses)
    for i, mount in enumerate(vehicle.wheels.values()):
        distance = mount.radius - rollers.radius
        u_x, u_y = geometry.rolling[i]
        axis = np.array([-u_y, u_x, 0.0])
        rest = (masses[i] * GRAVITY - loads[i]) / suspension + offsets[i]
        hub = max(vehicle.wheel_inertia - masses[i] * distance**2, 0.1 * vehicle.wheel_inertia)
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
        tilt = abs(float(geometry.active[i] @ geometry.rolling[i]))  # sin(delta)
        if geometry.conventional[i]:
            size = f"type='sphere' size='{mount.radius}' mass='0'"
            yield f"<geom {size} contype='1' conaffinity='0'/>"
        else:
            lowest = np.array([*geometry.active[i], 0.0])
            yield from _rollers(rollers, i, mount.radius, tilt, axis, lowest)
        yield "</body>"
    yield f"</body></worldbody><actuator>{_drives(n, vehicle.drive.max_torque)}</actuator></mujoco>"


def _roller_masses(rollers: RollerConfiguration) -> FloatArray:
    """Return the masses [kg] of cylinders with radii and inertias of even and odd rollers, (2,)."""
    return np.asarray(2.0 * rollers.inertias / np.square(rollers.radii))


def _rollers(
    rollers: RollerConfiguration,
    wheel: int,
    radius: float,
    tilt: float,
    axis: FloatArray,
    lowest: FloatArray,
) -> Iterator[str]:
    """Generate the XML elements of the rollers of a wheel.

    Args:
        rollers: configuration of the rollers.
        wheel: number of the wheel.
        radius: radius of the wheel [m].
        tilt: sine of the angle between the axes of roller and wheel [1].
        axis: axis of the wheel, a unit vector, shape (3,).
        lowest: axis of the lowest roller, a unit vector, shape (3,).
    """
    tangent, cosine = math.tan(math.pi / rollers.count), math.cos(math.pi / rollers.count)
    masses = _roller_masses(rollers)
    for k in range(rollers.count):
        size, mass, inertia = rollers.radii[k % 2], masses[k % 2], rollers.inertias[k % 2]
        distance = radius - size
        # These ellipsoids touch the envelope at their middle and at the change of rollers.
        half = distance * tangent / tilt
        length = half / math.sqrt(1.0 - ((radius - distance / cosine) / size) ** 2)
        across = mass * (size**2 / 4.0 + half**2 / 3.0)
        angle, row = 2.0 * math.pi * k / rollers.count, (0.5 - k % 2) * rollers.rows_apart
        place = _turned(np.array([0.0, 0.0, -distance]), axis, angle) + row * axis
        yield f"<body pos='{_numbers(place)}' zaxis='{_numbers(_turned(lowest, axis, angle))}'>"
        yield f"<joint name='roller_{wheel}_{k}' type='hinge' axis='0 0 1'/>"
        yield (f"<inertial pos='0 0 0' mass='{mass}' diaginertia='{across} {across} {inertia}'/>")
        shape = f"{size} {size} {length}"
        yield f"<geom type='ellipsoid' size='{shape}' contype='1' conaffinity='0'/></body>"


def _chassis(vehicle: VehicleConfiguration, wheel_masses: FloatArray) -> Iterator[str]:
    """Generate the XML elements of the chassis and its load.

    The mass of the chassis does not include the masses of the wheels [kg], shape (N,).
    """
    body, load = vehicle.body, vehicle.load
    # The body of the planar vehicle includes the wheels' mass and moment about the vertical axis.
    reach = np.array([mount.x**2 + mount.y**2 for mount in vehicle.wheels.values()])
    mass = body.mass - float(np.sum(wheel_masses))
    if mass <= 0.0:
        raise ConfigurationError(
            "vehicle.rollers",
            f"radius and inertia give {np.max(wheel_masses):.3g} kg per wheel, but vehicle and "
            f"wheels weigh {body.mass:g} kg",
        )
    yaw_inertia = max(body.yaw_inertia - float(wheel_masses @ reach), 0.1 * body.yaw_inertia)
    height = 2.0 * body.height
    roll = mass / 12.0 * (vehicle.chassis_width**2 + height**2)
    pitch = mass / 12.0 * (vehicle.chassis_length**2 + height**2)
    yaw_inertia = min(yaw_inertia, 0.999 * (roll + pitch))  # limit for any rigid body
    yield (
        f"<inertial pos='{body.x} {body.y} {body.height}' mass='{mass}' "
        f"diaginertia='{roll} {pitch} {yaw_inertia}'/>"
    )
    if load.mass > 0.0:
        ball = max(load.yaw_inertia, 1e-3)
        yield (
            f"<body pos='{load.x} {load.y} {load.height}'><inertial pos='0 0 0' "
            f"mass='{load.mass}' diaginertia='{ball} {ball} {ball}'/></body>"
        )


def _drives(n: int, limit: float) -> str:
    """Return the XML elements of the wheels' velocity servos, which are disengaged at first.

    Args:
        n: number of wheels.
        limit: limit on the torque of a servo [N m].
    """
    return "".join(
        f"<velocity joint='wheel_{i}' kv='0' forcerange='{-limit} {limit}'/>" for i in range(n)
    )


def _turned(vector: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """Return a vector, rotated about a unit axis by an angle [rad] (Rodrigues' formula)."""
    cos, sin = math.cos(angle), math.sin(angle)
    along = float(axis @ vector) * (1.0 - cos) * axis
    return np.asarray(cos * vector + sin * np.cross(axis, vector) + along, dtype=np.float64)


def _numbers(values: FloatArray) -> str:
    return " ".join(f"{value:.12g}" for value in values)
