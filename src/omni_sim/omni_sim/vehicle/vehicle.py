"""The vehicle as the simulator drives it: masses, wheels, tires, brakes and ground together."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_platform.kinematics import PlatformKinematics
from omni_sim.ground.elevation import ElevationConfiguration
from omni_sim.ground.friction import FrictionMap
from omni_sim.vehicle import dynamics
from omni_sim.vehicle.base_motion import base_motion
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import GRAVITY, MassProperties
from omni_sim.vehicle.plant import build_losses, build_plant, static_loads
from omni_sim.vehicle.road_plane import RoadPlane, WheelContact, road_plane_at, wheel_contact
from omni_sim.vehicle.roller_dynamics import Rollers
from omni_sim.vehicle.uneven_ground import level, orientation, stand
from omni_sim.wheel.brake_pressure import (
    BrakePressure,
    brake_torques,
    build_brake_pressure,
    release,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

DEFAULT_PHYSICS_STEP = 0.0005
"""Physics step [s]."""

_PLACEMENTS = 8  # to find a plane that depends on where the wheels reach on it


class VehicleInputError(ValueError):
    """An input to the vehicle that has the wrong shape, is not finite or is out of range."""


@dataclasses.dataclass(frozen=True)
class StepLog:
    """What happened in each of n steps.

    Attributes:
        trajectory: x, y, yaw, v_x, v_y, yaw rate of base_link in the world frame, (n + 1, 6).
        load: wheel loads [N], shape (n, N).
        force: wheel forces along the active directions [N], (n, N).
        limit: largest force that friction allowed [N], (n, N).
        slip: Eq. (20) with sign [1], (n, N).
        speed: wheel speeds [rad/s], (n, N).
        brake_torque: of the brakes on the wheels [N m], (n, N).
        energy: kinetic energy of translation, rotation and wheel spin, energy of the tires'
            deflection, potential energy of the height [J], (n, 5).
    """

    trajectory: FloatArray
    load: FloatArray
    force: FloatArray
    limit: FloatArray
    slip: FloatArray
    speed: FloatArray
    brake_torque: FloatArray
    energy: FloatArray


class KernelState(NamedTuple):
    """What `dynamics.advance` works on.

    Attributes:
        plant: constants.
        terrain: height of the ground.
        losses: along the passive directions.
        body: body state, shape (10,).
        contacts: of the wheels, shape (N, 6).
        rollers: individual rollers, if the wheels have any.
        wheels: wheel states, shape (N, 12).
        counters: of steps with tipping or overload, shape (2,).
        pressure: in the brakes; `brake_pressure.brake_torques` advances it.
    """

    plant: dynamics.Plant
    terrain: dynamics.Terrain
    losses: dynamics.Losses
    body: FloatArray
    contacts: FloatArray
    rollers: Rollers | None
    wheels: FloatArray
    counters: NDArray[np.int64]
    pressure: BrakePressure


class Vehicle:
    """A vehicle moving in the plane, or on uneven ground that it keeps to (`uneven_ground`).

    The drive follows the inverse kinematics with the rolling radii that the wheels have at rest
    under their static loads, as a calibrated drive does.

    Attributes:
        configuration: what the vehicle is made of.
        kinematics: of the unloaded wheels, with the names and the order of all wheel arrays.
        masses: body and load together.
        physics_step: [s].
        wheel_model: that this class simulates.
    """

    wheel_model = "single"

    def __init__(
        self,
        configuration: VehicleConfiguration,
        friction: FrictionMap | None = None,
        physics_step: float = DEFAULT_PHYSICS_STEP,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        twist: ArrayLike = (0.0, 0.0, 0.0),
        elevation: ElevationConfiguration | None = None,
        wheel_angle: ArrayLike = 0.0,
    ) -> None:
        """Build the vehicle and place it, rolling perfectly.

        Args:
            configuration: what the vehicle is made of.
            friction: of the ground; by default ``mu/mu_0 = 1`` everywhere.
            physics_step: [s].
            pose: x, y [m], yaw [rad] of base_link in the world frame.
            twist: of base_link in the body frame [m/s, m/s, rad/s].
            elevation: of the ground; flat by default.
            wheel_angle: of the wheels when placed, 0 with a roller's middle on the ground [rad],
                a number or shape (N,).

        Raises:
            UnusablePlatformError: the wheels cannot move the platform in all directions.
            VehicleInputError: a number is out of range, or the configuration has other wheels.
        """
        if configuration.wheel_model != self.wheel_model:
            raise VehicleInputError(
                f"{type(self).__name__} has wheels of the model {self.wheel_model!r}, not "
                f"{configuration.wheel_model!r}; vehicle_factory.build_vehicle takes either"
            )
        if not 0.0 < physics_step <= 0.01:
            raise VehicleInputError(f"physics step {physics_step} s must be in (0, 0.01] s")
        self.configuration = configuration
        self.kinematics = PlatformKinematics(configuration.wheels)
        self.masses = MassProperties.of(configuration.body, configuration.load)
        self.physics_step = physics_step
        self._plant = build_plant(
            configuration, self.kinematics, self.masses, friction or FrictionMap(), physics_step
        )
        self._plant, self._losses = build_losses(
            configuration, self.kinematics, self.masses, self._plant
        )
        ground = elevation or ElevationConfiguration()
        self._terrain = dynamics.Terrain(ground.table(), ground.sampling_distance)
        n = len(configuration.wheels)
        self._body = np.zeros(dynamics.BODY_SIZE)
        self._wheels = np.zeros((n, dynamics.WHEEL_SIZE))
        brake = configuration.brake
        self._pressure = build_brake_pressure(
            brake.time_constant, brake.dead_time, n, self.physics_step
        )
        self._contacts = self._plant.wheel[:, : dynamics.CONTACT_SIZE].copy()
        self._individual_rollers: Rollers | None = None
        if np.ndim(wheel_angle) == 0:
            wheel_angle = np.full(n, wheel_angle)
        self._start_angle = _finite("wheel angle", wheel_angle, (n,))
        self._counters = np.zeros(2, dtype=np.int64)
        self._tipping = False
        self._force = np.zeros(2)
        self._no_log = (
            np.zeros((0, n, dynamics.WHEEL_SIZE)),
            np.zeros((0, dynamics.ENERGIES)),
        )
        self.place(pose, twist)

    def place(self, pose: ArrayLike, twist: ArrayLike) -> None:
        """Put the vehicle somewhere, rolling perfectly, with its tires at rest.

        Args:
            pose: x, y [m], yaw [rad] of base_link in the world frame.
            twist: of base_link in the body frame [m/s, m/s, rad/s].
        """
        x, y, yaw = _finite("pose", pose, (3,))
        twist_body = _finite("twist", twist, (3,))
        g = self.masses.centre
        v = twist_body[:2] + twist_body[2] * np.array([-g[1], g[0]])
        cos, sin = math.cos(yaw), math.sin(yaw)
        self._body[:] = 0.0
        self._body[dynamics.X] = x + cos * g[0] - sin * g[1]
        self._body[dynamics.Y] = y + sin * g[0] + cos * g[1]
        self._body[dynamics.YAW] = yaw
        self._lean_on_ground(x, y)
        self._body[dynamics.V_X] = cos * v[0] - sin * v[1]
        self._body[dynamics.V_Y] = sin * v[0] + cos * v[1]
        self._body[dynamics.YAW_RATE] = twist_body[2]
        release(self._pressure)
        self._wheels[:] = 0.0
        self._wheels[:, dynamics.SPEED] = self._plant.rolling @ twist_body
        pressing = math.sqrt(1.0 - float(np.sum(self._tilt**2)))
        self._wheels[:, dynamics.LOAD] = pressing * static_loads(self._plant)
        self._wheels[:, dynamics.ANGLE] = self._start_angle
        if self._plant.roller_pitch > 0.0:
            self._wheels[:, dynamics.SPEED] = self._rolling_speed(v, twist_body[2])
        self._wheels[:, dynamics.LAST_SPEED] = self._wheels[:, dynamics.SPEED]
        self._counters[:] = 0
        self._tipping = False

    def _rolling_speed(self, velocity: FloatArray, yaw_rate: float) -> FloatArray:
        """Move the contacts to the wheel angles and return the speeds of rolling, Eq. (16)."""
        self._wheels[:, dynamics.SPEED] = 0.0
        dynamics.displace_contacts(self._plant, self._wheels, self._contacts)
        twist = np.array([*velocity, yaw_rate])
        hub = self._contacts[:, [dynamics.N_X, dynamics.N_Y, dynamics.MOMENT]] @ twist
        speed: FloatArray = hub / (self._rolling_radius * self._contacts[:, dynamics.RIM])
        return speed

    def advance(
        self,
        n_steps: int,
        pedal: float,
        enable: ArrayLike,
        command_twist: ArrayLike,
        *,
        hold_world_direction: bool = False,
    ) -> FloatArray:
        """Advance by ``n_steps`` physics steps under constant inputs.

        Args:
            n_steps: number of physics steps.
            pedal: brake pedal, 0..1.
            enable: share of the brake pressure that reaches each wheel, 0..1, shape (N,).
            command_twist: that the drive follows while the clutch is engaged, in the body frame
                at the start of the call [m/s, m/s, rad/s], shape (3,).
            hold_world_direction: let its linear part keep its direction in the world while the
                body turns during the call.

        Returns:
            x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of base_link in the world frame
            at the start and after each step, shape (n_steps + 1, 6).
        """
        control = self._control(n_steps, pedal, enable, command_twist, hold_world_direction)
        return self._run(n_steps, control, *self._no_log)

    def advance_logged(
        self,
        n_steps: int,
        pedal: float,
        enable: ArrayLike,
        command_twist: ArrayLike,
        *,
        hold_world_direction: bool = False,
    ) -> StepLog:
        """Advance like `advance` and record every step."""
        control = self._control(n_steps, pedal, enable, command_twist, hold_world_direction)
        wheels = np.empty((n_steps, *self._wheels.shape))
        energy = np.empty((n_steps, dynamics.ENERGIES))
        trajectory = self._run(n_steps, control, wheels, energy)
        return StepLog(
            trajectory=trajectory,
            load=wheels[:, :, dynamics.LOAD],
            force=wheels[:, :, dynamics.FORCE],
            limit=wheels[:, :, dynamics.LIMIT],
            slip=wheels[:, :, dynamics.SLIP],
            speed=wheels[:, :, dynamics.SPEED],
            brake_torque=wheels[:, :, dynamics.BRAKE],
            energy=energy,
        )

    def push(self, force: ArrayLike) -> None:
        """Let a constant force act at the centre of gravity from now on.

        Args:
            force: along the ground, in the world frame [N], shape (2,).
        """
        self._force = _finite("force", force, (2,))

    def drive_speeds(self, twist: ArrayLike) -> FloatArray:
        """Return the wheel speeds that the drive commands for a body twist, Eqs. (28), (32).

        Args:
            twist: in the body frame [m/s, m/s, rad/s], shape (..., 3).

        Returns:
            With the rolling radii under the static loads [rad/s], shape (..., N).
        """
        return np.asarray(np.asarray(twist) @ self._plant.rolling.T, dtype=np.float64)

    def _lean_on_ground(self, x: float, y: float) -> None:
        """Find the path plane at a position of base_link; it tells where the wheels reach."""
        g_x, g_y = self._body[dynamics.X] - x, self._body[dynamics.Y] - y
        for _ in range(_PLACEMENTS if len(self._terrain.elevation) else 0):
            self._body[dynamics.TILT_X : dynamics.TILT_Y + 1] = self._stand()[3:5]
            d_x, d_y = level(*self._tilt, g_x, g_y)
            self._body[dynamics.X], self._body[dynamics.Y] = x + d_x, y + d_y

    def _stand(self) -> tuple[float, float, float, float, float, float]:
        x, y, yaw = self._body[:3]
        terrain, plant = self._terrain, self._plant
        standing: tuple[float, float, float, float, float, float] = stand(
            terrain.elevation,
            terrain.sampling,
            plant.wheel,
            plant.plane,
            x,
            y,
            math.cos(yaw),
            math.sin(yaw),
        )
        return standing

    @property
    def _rolling_radius(self) -> FloatArray:
        """``r_D`` of Eq. (1) under the wheel loads [m], shape (N,)."""
        radius: FloatArray = self._plant.wheel[:, dynamics.RADIUS]
        return radius - self._wheels[:, dynamics.LOAD] / self._plant.vertical_stiffness

    @property
    def _tilt(self) -> FloatArray:
        return self._body[dynamics.TILT_X : dynamics.TILT_Y + 1]

    def _control(
        self,
        n_steps: int,
        pedal: float,
        enable: ArrayLike,
        command_twist: ArrayLike,
        hold_world: bool,
    ) -> dynamics.Control:
        if n_steps < 0:
            raise VehicleInputError(f"{n_steps} steps: time does not run backwards")
        shares = _finite("enable", enable, (len(self._wheels),))
        if not 0.0 <= _finite("pedal", pedal, ()) <= 1.0:
            raise VehicleInputError(f"pedal {pedal!r} must be in 0..1")
        if np.min(shares) < 0.0 or np.max(shares) > 1.0:
            raise VehicleInputError(f"enable {enable!r} must be in 0..1")
        drive = self.configuration.drive
        engaged = pedal < drive.clutch_threshold
        twist = _finite("command twist", command_twist, (3,))
        asked = pedal * self.configuration.brake.max_torque * shares
        return dynamics.Control(
            brake=brake_torques(self._pressure, asked, n_steps),
            drive_stiffness=drive.stiffness if engaged else 0.0,
            twist=twist,
            hold_world=bool(hold_world),
            force_x=float(self._force[0]),
            force_y=float(self._force[1]),
        )

    def _run(
        self, n_steps: int, control: dynamics.Control, wheels: FloatArray, energy: FloatArray
    ) -> FloatArray:
        trajectory = np.empty((n_steps + 1, 6))
        before = int(self._counters[dynamics.TIPPING_STEPS])
        dynamics.advance(
            self._plant,
            self._terrain,
            self._losses,
            control,
            self._body,
            self._contacts,
            self._individual_rollers,
            self._wheels,
            self._counters,
            trajectory,
            wheels,
            energy,
        )
        self._tipping = int(self._counters[dynamics.TIPPING_STEPS]) > before
        return trajectory

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels in the order of all wheel arrays."""
        return self.kinematics.geometry.names

    @property
    def pose(self) -> FloatArray:
        """x, y [m], yaw [rad, not wrapped] of base_link in the world frame, shape (3,)."""
        return self._motion()[:3]

    @property
    def motion(self) -> tuple[FloatArray, float, float]:
        """Position and yaw in the path plane with the body twist, shape (6,), and its tilt [1].

        The tilt is the level part of the plane's normal; yaw and velocity are in the plane.
        """
        return (
            self._motion(),
            float(self._body[dynamics.TILT_X]),
            float(self._body[dynamics.TILT_Y]),
        )

    @property
    def twist(self) -> FloatArray:
        """Velocity of base_link in the body frame, along the ground [m/s, m/s, rad/s], (3,)."""
        return self._motion()[3:]

    def _motion(self) -> FloatArray:
        motion = np.empty(6)
        base_motion(self._body, self._plant.centre_x, self._plant.centre_y, motion)
        return motion

    @property
    def kernel_state(self) -> KernelState:
        """The state itself, not a copy, for a kernel that advances the vehicle on its own."""
        return KernelState(
            self._plant,
            self._terrain,
            self._losses,
            self._body,
            self._contacts,
            self._individual_rollers,
            self._wheels,
            self._counters,
            self._pressure,
        )

    @property
    def velocity_of_gravity_centre(self) -> FloatArray:
        """Velocity of the centre of gravity along the ground, in the world frame [m/s], (2,)."""
        return self._body[dynamics.V_X : dynamics.V_Y + 1].copy()

    @property
    def attitude(self) -> FloatArray:
        """Height of base_link [m], roll, pitch [rad] on uneven ground, shape (3,); else zeros."""
        if not len(self._terrain.elevation):
            return np.zeros(3)
        height, forward, left, _, _, _ = self._stand()
        rise = orientation(float(self._body[dynamics.YAW]), forward, left)[2]
        return np.array(
            [
                height - float(rise[:2] @ self.masses.centre),
                math.atan2(rise[1], rise[2]),
                -math.asin(rise[0]),
            ]
        )

    @property
    def wheel_contacts(self) -> tuple[WheelContact, ...]:
        """Contact of each wheel with its road plane, Eqs. (5), (6), in the order of the wheels."""
        height, forward, left, _, _, _ = self._stand()
        x, y, yaw = self._body[:3]
        turn = orientation(yaw, forward, left)
        base = np.array([x, y, height])
        levers, directions = self._plant.wheel[:, :2], self.kinematics.geometry.rolling
        contacts = []
        for lever, rolling, r_s in zip(levers, directions, self._rolling_radius, strict=True):
            centre = base + turn @ [*lever, r_s]
            c_x, c_y = float(centre[0]), float(centre[1])
            z, *normal = road_plane_at(*self._terrain, c_x, c_y, math.cos(yaw), math.sin(yaw))
            plane = RoadPlane(np.array([c_x, c_y, z]), np.array(normal))
            axis = turn @ [-rolling[1], rolling[0], 0.0]
            contacts.append(wheel_contact(centre, axis, plane))
        return tuple(contacts)

    @property
    def wheel_speed(self) -> FloatArray:
        """Wheel speeds [rad/s], shape (N,)."""
        return self._wheels[:, dynamics.SPEED].copy()

    @property
    def wheel_angle(self) -> FloatArray:
        """Wheel angles [rad, not wrapped], shape (N,)."""
        return self._wheels[:, dynamics.ANGLE].copy()

    @property
    def wheel_load(self) -> FloatArray:
        """Vertical wheel loads [N], shape (N,)."""
        return self._wheels[:, dynamics.LOAD].copy()

    @property
    def wheel_force(self) -> FloatArray:
        """Tire forces on the vehicle along the active directions [N], shape (N,)."""
        return self._wheels[:, dynamics.FORCE].copy()

    @property
    def passive_force(self) -> FloatArray:
        """Forces of the losses on the vehicle along the passive directions [N], shape (N,)."""
        return self._wheels[:, dynamics.PASSIVE].copy()

    @property
    def roller_speed(self) -> FloatArray:
        """Surface speeds of the rollers ``u_w . v_i - omega r_D (u_w . u_i)`` [m/s], (N,)."""
        geometry = self.kinematics.geometry
        rim = np.sum(geometry.passive * geometry.rolling, axis=1)
        hub = np.sum(geometry.passive * self.kinematics.wheel_velocities(self.twist), axis=1)
        return np.asarray(hub - self.wheel_speed * self._rolling_radius * rim, dtype=np.float64)

    @property
    def wheel_force_body(self) -> FloatArray:
        """Forces of the wheels on the vehicle in the body frame [N], shape (N, 2)."""
        direction = self._contacts[:, dynamics.N_X : dynamics.N_Y + 1]
        return np.asarray(self.wheel_force[:, np.newaxis] * direction, dtype=np.float64)

    @property
    def friction_limit(self) -> FloatArray:
        """Largest force that load and ground allowed each wheel in the last step [N], (N,)."""
        return self._wheels[:, dynamics.LIMIT].copy()

    @property
    def slip(self) -> FloatArray:
        """Slip of the contact patches along the active directions, Eq. (20) [1], shape (N,)."""
        return self._wheels[:, dynamics.SLIP].copy()

    @property
    def slip_velocity(self) -> FloatArray:
        """Sliding velocities of the rims ``n_w . v_i - omega r_D (n_w . u_i)`` [m/s], (N,)."""
        v_x, v_y, rate = self.twist
        g_x, g_y = self.masses.centre
        centre = np.array([v_x - rate * g_y, v_y + rate * g_x, rate])
        hub = self._contacts[:, [dynamics.N_X, dynamics.N_Y, dynamics.MOMENT]] @ centre
        rim = self.wheel_speed * self._rolling_radius * self._contacts[:, dynamics.RIM]
        return np.asarray(hub - rim, dtype=np.float64)

    @property
    def sliding(self) -> BoolArray:
        """Whether each contact patch slides, beyond the peak of its curve, shape (N,)."""
        sliding: BoolArray = self._wheels[:, dynamics.SLIDING] != 0.0
        return sliding

    @property
    def deflection(self) -> FloatArray:
        """Tire deflections ``e`` along the active directions [m], shape (N,)."""
        return self._wheels[:, dynamics.DEFLECTION].copy()

    @property
    def brake_torque(self) -> FloatArray:
        """Torques of the brakes on the wheels, against their rotation [N m], shape (N,)."""
        return self._wheels[:, dynamics.BRAKE].copy()

    @property
    def kinetic_energy(self) -> float:
        """Energy of translation, rotation and wheel spin, without that of rollers [J]."""
        v_x, v_y, rate = self._body[dynamics.V_X : dynamics.YAW_RATE + 1]
        return float(
            0.5 * self.masses.mass * (v_x**2 + v_y**2)
            + 0.5 * self.masses.yaw_inertia * rate**2
            + 0.5 * self.configuration.wheel_inertia * np.sum(self.wheel_speed**2)
        )

    @property
    def elastic_energy(self) -> float:
        """Energy of the tires' deflection [J]."""
        return float(0.5 * self.configuration.tire.stiffness * np.sum(self.deflection**2))

    @property
    def potential_energy(self) -> float:
        """Energy ``m g Z`` of the height over the level z = 0 [J]."""
        return self.masses.mass * GRAVITY * self._stand()[0]

    @property
    def overloaded(self) -> BoolArray:
        """Whether each wheel's load is beyond the tire model, which clamps it, shape (N,)."""
        beyond: BoolArray = self._wheels[:, dynamics.LOAD] > self._plant.largest_load
        return beyond

    @property
    def overloaded_steps(self) -> int:
        """Number of overloaded wheels summed over all steps since the vehicle was placed."""
        return int(self._counters[dynamics.OVERLOADED_STEPS])

    @property
    def tipping(self) -> bool:
        """Whether fewer than three wheels could carry the vehicle during the last call."""
        return self._tipping

    @property
    def tipping_steps(self) -> int:
        """Number of steps with tipping since the vehicle was placed."""
        return int(self._counters[dynamics.TIPPING_STEPS])


def _finite(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape or not np.all(np.isfinite(array)):
        raise VehicleInputError(f"{name} {value!r} must be {shape or 'a number'} and finite")
    return array
