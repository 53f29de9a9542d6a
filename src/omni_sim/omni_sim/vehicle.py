"""The vehicle as the simulator drives it: masses, wheels, tyres, brakes and ground together."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omni_platform.kinematics import PlatformKinematics
from omni_sim import dynamics
from omni_sim.base_motion import base_motion
from omni_sim.friction import FrictionMap
from omni_sim.loads import MassProperties
from omni_sim.plant import build_plant, static_loads
from omni_sim.vehicle_configuration import VehicleConfiguration

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

DEFAULT_PHYSICS_STEP = 0.0005
"""Physics step [s]."""


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
        energy: kinetic energy of translation, rotation and wheel spin, and energy of the tyres'
            deflection [J], (n, 4).
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
        body: body state, shape (8,).
        wheels: wheel states, shape (N, 9).
        counters: of steps with tipping or overload, shape (2,).
    """

    plant: dynamics.Plant
    body: FloatArray
    wheels: FloatArray
    counters: NDArray[np.int64]


class Vehicle:
    """A vehicle moving in the plane.

    The drive follows the inverse kinematics with the rolling radii that the wheels have at rest
    under their static loads, as a calibrated drive does.

    Attributes:
        configuration: what the vehicle is made of.
        kinematics: of the unloaded wheels, with the names and the order of all wheel arrays.
        masses: body and load together.
        physics_step: [s].
    """

    def __init__(
        self,
        configuration: VehicleConfiguration,
        friction: FrictionMap | None = None,
        physics_step: float = DEFAULT_PHYSICS_STEP,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        twist: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Build the vehicle and place it, rolling perfectly.

        Args:
            configuration: what the vehicle is made of.
            friction: of the ground; by default ``mu/mu_0 = 1`` everywhere.
            physics_step: [s].
            pose: x, y [m], yaw [rad] of base_link in the world frame.
            twist: of base_link in the body frame [m/s, m/s, rad/s].

        Raises:
            UnusablePlatformError: the wheels cannot move the platform in all directions.
            VehicleInputError: a number is out of range.
        """
        if not 0.0 < physics_step <= 0.01:
            raise VehicleInputError(f"physics step {physics_step} s must be in (0, 0.01] s")
        self.configuration = configuration
        self.kinematics = PlatformKinematics(configuration.wheels)
        self.masses = MassProperties.of(configuration.body, configuration.load)
        self.physics_step = physics_step
        self._plant = build_plant(
            configuration, self.kinematics, self.masses, friction or FrictionMap(), physics_step
        )
        n = len(configuration.wheels)
        self._body = np.zeros(dynamics.BODY_SIZE)
        self._wheels = np.zeros((n, dynamics.WHEEL_SIZE))
        self._counters = np.zeros(2, dtype=np.int64)
        self._tipping = False
        self._force = np.zeros(2)
        self._no_log = np.zeros((0, n, dynamics.WHEEL_SIZE)), np.zeros((0, 4))
        self.place(pose, twist)

    def place(self, pose: ArrayLike, twist: ArrayLike) -> None:
        """Put the vehicle somewhere, rolling perfectly, with its tyres at rest.

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
        self._body[dynamics.V_X] = cos * v[0] - sin * v[1]
        self._body[dynamics.V_Y] = sin * v[0] + cos * v[1]
        self._body[dynamics.YAW_RATE] = twist_body[2]
        self._wheels[:] = 0.0
        self._wheels[:, dynamics.SPEED] = self._plant.rolling @ twist_body
        self._wheels[:, dynamics.LOAD] = static_loads(self._plant)
        self._counters[:] = 0
        self._tipping = False

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
        control = self._control(pedal, enable, command_twist, hold_world_direction)
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
        control = self._control(pedal, enable, command_twist, hold_world_direction)
        wheels = np.empty((n_steps, *self._wheels.shape))
        energy = np.empty((n_steps, 4))
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
            force: in the world frame [N], shape (2,); the component of gravity on a slope is one.
        """
        self._force = _finite("force", force, (2,))

    def _control(
        self, pedal: float, enable: ArrayLike, command_twist: ArrayLike, hold_world: bool
    ) -> dynamics.Control:
        shares = _finite("enable", enable, (len(self._wheels),))
        if not 0.0 <= _finite("pedal", pedal, ()) <= 1.0:
            raise VehicleInputError(f"pedal {pedal!r} must be in 0..1")
        if np.min(shares) < 0.0 or np.max(shares) > 1.0:
            raise VehicleInputError(f"enable {enable!r} must be in 0..1")
        drive = self.configuration.drive
        engaged = pedal < drive.clutch_threshold
        return dynamics.Control(
            brake=pedal * self.configuration.brake.max_torque * shares,
            drive_stiffness=drive.stiffness if engaged else 0.0,
            twist=_finite("command twist", command_twist, (3,)),
            hold_world=bool(hold_world),
            force_x=float(self._force[0]),
            force_y=float(self._force[1]),
        )

    def _run(
        self, n_steps: int, control: dynamics.Control, wheels: FloatArray, energy: FloatArray
    ) -> FloatArray:
        if n_steps < 0:
            raise VehicleInputError(f"{n_steps} steps: time does not run backwards")
        trajectory = np.empty((n_steps + 1, 6))
        before = int(self._counters[dynamics.TIPPING_STEPS])
        dynamics.advance(
            self._plant,
            control,
            self._body,
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
    def twist(self) -> FloatArray:
        """Velocity of base_link in the body frame [m/s, m/s, rad/s], shape (3,)."""
        return self._motion()[3:]

    def _motion(self) -> FloatArray:
        motion = np.empty(6)
        base_motion(self._body, self._plant.centre_x, self._plant.centre_y, motion)
        return motion

    @property
    def kernel_state(self) -> KernelState:
        """The state itself, not a copy, for a kernel that advances the vehicle on its own."""
        return KernelState(self._plant, self._body, self._wheels, self._counters)

    @property
    def velocity_of_gravity_centre(self) -> FloatArray:
        """Velocity of the centre of gravity in the world frame [m/s], shape (2,)."""
        return self._body[dynamics.V_X : dynamics.V_Y + 1].copy()

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
        """Tyre forces on the vehicle along the active directions [N], shape (N,)."""
        return self._wheels[:, dynamics.FORCE].copy()

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
        w = self._plant.wheel
        radius = w[:, dynamics.RADIUS] - self.wheel_load / self._plant.vertical_stiffness
        hub = np.sum(
            self.kinematics.geometry.active * self.kinematics.wheel_velocities(self.twist), axis=1
        )
        return np.asarray(hub - self.wheel_speed * radius * w[:, dynamics.RIM], dtype=np.float64)

    @property
    def sliding(self) -> BoolArray:
        """Whether each contact patch slides, beyond the peak of its curve, shape (N,)."""
        sliding: BoolArray = self._wheels[:, dynamics.SLIDING] != 0.0
        return sliding

    @property
    def deflection(self) -> FloatArray:
        """Tyre deflections ``e`` along the active directions [m], shape (N,)."""
        return self._wheels[:, dynamics.DEFLECTION].copy()

    @property
    def brake_torque(self) -> FloatArray:
        """Torques of the brakes on the wheels, against their rotation [N m], shape (N,)."""
        return self._wheels[:, dynamics.BRAKE].copy()

    @property
    def kinetic_energy(self) -> float:
        """Energy of translation, rotation and wheel spin [J]."""
        v_x, v_y, rate = self._body[dynamics.V_X : dynamics.YAW_RATE + 1]
        return float(
            0.5 * self.masses.mass * (v_x**2 + v_y**2)
            + 0.5 * self.masses.yaw_inertia * rate**2
            + 0.5 * self.configuration.wheel_inertia * np.sum(self.wheel_speed**2)
        )

    @property
    def elastic_energy(self) -> float:
        """Energy of the tyres' deflection [J]."""
        return float(0.5 * self.configuration.tire.stiffness * np.sum(self.deflection**2))

    @property
    def overloaded(self) -> BoolArray:
        """Whether each wheel's load is beyond the tyre model, which clamps it, shape (N,)."""
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
