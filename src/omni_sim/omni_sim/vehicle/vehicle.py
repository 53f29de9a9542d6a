"""The simulated vehicle: masses, wheels, tires, brakes and ground."""

import math
import warnings

import numpy as np
from numpy.typing import ArrayLike

from omni_core import kinematics, quantities
from omni_core.configuration import ConfigurationWarning
from omni_core.quantities import GRAVITY
from omni_sim.ground.configuration import ElevationConfiguration
from omni_sim.ground.elevation import elevation_at
from omni_sim.ground.friction import FrictionMap
from omni_sim.vehicle import dynamics, placing, uneven_ground
from omni_sim.vehicle import state as layout
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.placing import along_active, rolling_radius
from omni_sim.vehicle.plant import build_state
from omni_sim.vehicle.plausibility import vehicle_remarks
from omni_sim.vehicle.suspension import fastest_motion, settle

DEFAULT_PHYSICS_STEP = 0.0005
"""Physics step [s]."""

# Entry of `warnings.filters` with which a program turns the remarks off.
_SILENT = ("ignore", None, ConfigurationWarning, None, 0)


class VehicleInputError(ValueError):
    """An input to the vehicle has the wrong shape, is not finite, or is out of range."""


class Vehicle:
    """A vehicle that moves in the plane, or on uneven ground that it never leaves.

    The option ``wheel_model`` selects the model of the wheels. With individual rollers, the force
    of a wheel is the sum of the forces of its rollers along the nominal active direction, and the
    force limit of the wheel is the sum of the rollers' limits. Slip, deflection and sliding state
    of the wheel are taken from its lower roller. The slip velocity is computed for the nominal
    contact under the wheel center.

    The drive is calibrated: it uses the inverse kinematics with the rolling radii under the static
    loads.

    Attributes:
        configuration: configuration of the vehicle.
        kinematics: kinematics of the unloaded wheels, with the names and the order of the wheels in
            all wheel arrays.
        masses: body and load together.
        physics_step: length of a step [s].
        state: state of the kernels, not a copy; changed by `advance` and `place`.
        wheel_names: names of the wheels, in the order of all arrays of wheel quantities.
        uneven: whether the ground has a slope, a wave or a bump.
        height: present height of the center of gravity [m]; `lift` changes it.
        tipping: whether fewer than three wheels carried the vehicle in any step of the last call of
            `advance`.
    """

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
        """Build the vehicle and place it, with wheels that roll without slip.

        Each of the configuration's `remarks` is a `ConfigurationWarning`.

        Args:
            configuration: configuration of the vehicle.
            friction: friction of the ground; by default ``mu/mu_0 = 1`` everywhere.
            physics_step: length of a step [s].
            pose: x, y [m], yaw [rad] of base_link in the world frame.
            twist: twist of base_link in the body frame [m/s, m/s, rad/s].
            elevation: elevation of the ground; flat by default.
            wheel_angle: initial angle of the wheels [rad], a number or shape (N,); at 0, the middle
                of a roller touches the ground.

        Raises:
            UnusablePlatformError: the wheels cannot move the platform in all directions.
            VehicleInputError: a number is out of range.
        """
        if not 0.0 < physics_step <= 0.01:
            raise VehicleInputError(f"physics step {physics_step} s must be in (0, 0.01] s")
        if _SILENT not in warnings.filters:  # remarks take time
            for remark in vehicle_remarks(configuration):
                warnings.warn(remark, ConfigurationWarning, stacklevel=2)
        self.configuration = configuration
        self.kinematics = kinematics.PlatformKinematics.of(configuration.wheels)
        self.wheel_names = self.kinematics.geometry.names
        self.masses = configuration.masses
        self.physics_step = physics_step
        self.state = self._build_state(friction or FrictionMap(), elevation)
        self.uneven = len(self.state.terrain.parts) > 0
        n = len(configuration.wheels)
        self._rest = np.zeros(3)
        if self.state.suspension.stiffness > 0.0:
            self._rest = self._static_ride()
        self.brake_fault_onsets = configuration.by_wheel("onset")
        self.apply_brake_faults(0.0)
        if np.ndim(wheel_angle) == 0:
            wheel_angle = np.full(n, wheel_angle)
        self._start_angle = _finite("wheel angle", wheel_angle, (n,))
        self._force, self._moment = np.zeros(2), 0.0
        self.lift(0.0)
        self.place(pose, twist)

    def _build_state(
        self, friction: FrictionMap, elevation: ElevationConfiguration | None
    ) -> layout.State:
        ground = elevation or ElevationConfiguration()
        return build_state(self.configuration, friction, self.physics_step, ground)

    def _static_ride(self, largest: float = 0.5) -> quantities.FloatArray:
        """Return heave [m] and gradients [1] of the chassis at rest, shape (3,).

        All wheels have the same mounting height in this computation.

        Args:
            largest: limit on the phase by which an oscillation on the springs may advance in a
                physics step [rad].

        Raises:
            VehicleInputError: the fastest oscillation exceeds this limit.
        """
        plant, suspension = self.state.plant, self.state.suspension
        fastest = fastest_motion(plant, suspension)
        if fastest * self.physics_step > largest:
            raise VehicleInputError(
                f"springs of {suspension.stiffness:g} N/m oscillate at {fastest:.3g} rad/s; "
                f"softer ones or a physics step below "
                f"{largest / fastest:.2g} s are needed"
            )
        n = len(self.state.wheels)
        level_springs = suspension._replace(mounted=np.zeros(n))
        settle(plant, level_springs, np.zeros(n), plant.mass * GRAVITY)
        return self._chassis

    def apply_brake_faults(self, time: float) -> None:
        """Activate the brake faults that have begun by `time` [s]."""
        faults, begun = self.configuration, self.brake_fault_onsets <= time
        self.state.plant.brake_share[:] = np.where(begun, faults.by_wheel("brake"), 1.0)
        self.state.pressure.open[:] = np.where(begun, faults.by_wheel("open_valve"), 0.0)
        stuck = faults.brake.max_torque * faults.by_wheel("stuck_brake")
        self.state.pressure.stuck[:] = np.where(begun, stuck, 0.0)

    def lift(self, time: float) -> None:
        """Move the fork to its position at a time [s] of a run."""
        self.height = float(self.configuration.height_at(time))

    def place(self, pose: ArrayLike, twist: ArrayLike) -> None:
        """Place the vehicle with undeflected tires and wheels that roll without slip at a twist.

        Args:
            pose: x, y [m], yaw [rad] of base_link in the world frame.
            twist: twist of base_link in the body frame [m/s, m/s, rad/s].
        """
        where, moving = _finite("pose", pose, (3,)), _finite("twist", twist, (3,))
        placing.place(self.state, self.masses, where, moving, self._start_angle)
        self.tipping = False

    def advance(
        self,
        n_steps: int,
        pedal: float,
        enable: ArrayLike,
        command_twist: ArrayLike,
        *,
        hold_world_direction: bool = False,
        traced: bool = True,
    ) -> quantities.FloatArray:
        """Advance by ``n_steps`` physics steps under constant inputs.

        Args:
            n_steps: number of physics steps.
            pedal: position of the brake pedal, 0 to 1.
            enable: share of the brake pressure that reaches each wheel, 0 to 1, shape (N,).
            command_twist: twist that the drive follows while the clutch is engaged, in the body
                frame at the start of the call [m/s, m/s, rad/s], shape (3,).
            hold_world_direction: whether the commanded velocity keeps its direction in the world
                while the body turns during the call.
            traced: whether the trajectory is returned, which takes time.

        Returns:
            x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of base_link in the world frame
            at the start and after each step, shape (n_steps + 1, 6); shape (0, 6) if not traced.
        """
        control = self._control(pedal, enable, command_twist, hold_world_direction)
        if n_steps < 0:
            raise VehicleInputError(f"{n_steps} steps: the number must not be negative")
        trajectory = np.empty((n_steps + 1 if traced else 0, 6))
        self._run(control, n_steps, trajectory)
        return trajectory

    def _run(self, control: layout.Control, steps: int, trajectory: quantities.FloatArray) -> None:
        before = self.tipping_steps
        dynamics.advance(self.state, control, steps, trajectory)
        self.tipping = self.tipping_steps > before

    def push(self, force: ArrayLike, moment: float = 0.0) -> None:
        """Apply a constant force and moment at the center of gravity from the next step on.

        Args:
            force: force along the ground, in the world frame [N], shape (2,).
            moment: moment about the vertical axis [N m].
        """
        self._force, self._moment = (
            _finite("force", force, (2,)),
            float(_finite("moment", moment, ())),
        )

    def drive_speeds(self, twist: ArrayLike) -> quantities.FloatArray:
        """Return the wheel speeds that the drive commands for a body twist, Eqs. (28), (32).

        Args:
            twist: twist in the body frame [m/s, m/s, rad/s], shape (..., 3).

        Returns:
            Wheel speeds with the rolling radii under the static loads [rad/s], shape (..., N).
        """
        return np.asarray(np.asarray(twist) @ self.state.plant.rolling.T, dtype=np.float64)

    def _control(
        self, pedal: float, enable: ArrayLike, command_twist: ArrayLike, hold_world: bool
    ) -> layout.Control:
        shares = _finite("enable", enable, (len(self.state.wheels),))
        if not 0.0 <= pedal <= 1.0:
            raise VehicleInputError(f"pedal {pedal!r} must be in 0..1")
        if shares.min() < 0.0 or shares.max() > 1.0:
            raise VehicleInputError(f"enable {enable!r} must be in 0..1")
        drive = self.configuration.drive
        engaged = pedal < drive.clutch_threshold
        twist = _finite("command twist", command_twist, (3,))
        return layout.Control(
            brake=pedal * self.configuration.brake.max_torque,
            enable=shares,
            drive_stiffness=drive.stiffness if engaged else 0.0,
            twist=twist,
            in_world=bool(hold_world),
            force_x=float(self._force[0]),
            force_y=float(self._force[1]),
            moment=self._moment,
            height=self.height,
        )

    @property
    def pose(self) -> quantities.FloatArray:
        """x, y [m], yaw [rad, not wrapped] of base_link in the world frame, shape (3,)."""
        return self.motion[:3]

    @property
    def motion(self) -> quantities.FloatArray:
        """`pose` followed by `twist`, shape (6,); see `uneven_ground` for both on uneven ground."""
        motion = np.empty(6)
        dynamics.base_motion(self.state.body[0], self.state.plant.center, motion)
        return motion

    @property
    def twist(self) -> quantities.FloatArray:
        """Velocity of base_link in the body frame, along the ground [m/s, m/s, rad/s], (3,)."""
        return self.motion[3:]

    @property
    def attitude(self) -> quantities.FloatArray:
        """Height of base_link [m], roll, pitch [rad] on uneven ground or springs, shape (3,).

        All are zero on flat ground if the springs are at rest and all wheels have the same height.
        """
        if not self.uneven and self.state.suspension.stiffness == 0.0:
            return np.zeros(3)
        height, forward, left, _, _, _ = uneven_ground.standing(self.state, 0.0)
        heave, pitch, roll = self._chassis - self._rest
        height, forward, left = height + heave, forward + pitch, left + roll
        rise = uneven_ground.orientation(float(self.state.body[0]["yaw"]), forward, left)[2]
        height -= float(rise[:2] @ self.masses.center)
        return np.array([height, math.atan2(rise[1], rise[2]), -math.asin(rise[0])])

    @property
    def ride(self) -> quantities.FloatArray:
        """Heave and gradients of the sprung chassis relative to the position at rest.

        Returns:
            Heave of the center of gravity [m], gradients forward and to the left [1], and the time
            derivatives of all three, shape (6,); zeros without suspension.
        """
        state = np.array(list(self.state.suspension.chassis[0]))
        state[:3] -= self._rest
        return state

    @property
    def steering(self) -> quantities.FloatArray:
        """Angle [rad] and rate [rad/s] of each wheel's steering, 0 if not steered, (2, N)."""
        if self.state.treads is None:
            return np.zeros((2, len(self.state.wheels)))
        steering = self.state.treads.steering
        return np.array((steering["angle"], steering["rate"]))

    def clearance(self, x: float, y: float) -> float:
        """Return the ground clearance of a point minus its clearance at rest on flat ground [m].

        Args:
            x: coordinate x of the point, forward of base_link [m].
            y: coordinate y of the point, left of base_link [m].
        """
        heave, forward, left = self.ride[:3]
        g_x, g_y = self.masses.center
        above = float(heave + forward * (x - g_x) + left * (y - g_y))
        if self.uneven:
            height, forward, left, _, _, _ = uneven_ground.standing(self.state, 0.0)
            world_x, world_y, yaw = self.pose
            cos, sin = math.cos(yaw), math.sin(yaw)
            ground = elevation_at(
                self.state.terrain.parts,
                float(world_x + cos * x - sin * y),
                float(world_y + sin * x + cos * y),
            )
            above += height + forward * (x - g_x) + left * (y - g_y) - ground
        return above

    @property
    def _chassis(self) -> quantities.FloatArray:
        """Heave [m] and gradients forward and to the left [1] of the chassis, shape (3,)."""
        return np.array(list(self.state.suspension.chassis[0])[:3])

    @property
    def wheels(self) -> layout.Structured:
        """State of each wheel, a copy of the records `state.WHEEL`, shape (N,)."""
        return self.state.wheels.copy()

    @property
    def rollers(self) -> layout.Structured:
        """State of each individual roller: a copy of the records `state.ROLLER`, shape (N, n).

        Raises:
            VehicleInputError: the wheels have no individual rollers.
        """
        if self.state.rollers is None:
            raise VehicleInputError("the wheel model 'single' has no individual rollers")
        return self.state.rollers.state.copy()

    @property
    def wheel_force_body(self) -> quantities.FloatArray:
        """Forces of the wheels on the vehicle in the body frame [N], shape (N, 2)."""
        pushing = self.state.rollers or self.state.treads
        if pushing is not None:
            return pushing.push[:, :2].copy()
        force, contacts = self.state.wheels["force"], self.state.contacts
        return np.column_stack((force * contacts["n_x"], force * contacts["n_y"]))

    @property
    def slip_velocity(self) -> quantities.FloatArray:
        """Sliding velocity of each wheel along its active direction [m/s], (N,).

        It is ``n_w . v_i - omega r_D (n_w . u_i)`` with the active direction ``n_w``, the velocity
        of the hub ``v_i``, the wheel speed ``omega``, the rolling radius ``r_D`` and the rolling
        direction ``u_i``.
        """
        v_x, v_y, rate = self.twist
        g_x, g_y = self.masses.center
        hub = along_active(self.state, np.array([v_x - rate * g_y, v_y + rate * g_x, rate]))
        speed = self.state.wheels["speed"] * rolling_radius(self.state)
        return np.asarray(hub - speed * self.state.contacts["rim"], dtype=np.float64)

    @property
    def energies(self) -> layout.Energies:
        """Kinetic energies, elastic energy of the tires and potential energy [J]."""
        return dynamics.energies(self.state)

    @property
    def overloaded_steps(self) -> int:
        """Number of steps with overload since the vehicle was placed, summed over the wheels."""
        return int(self.state.counters["overloaded_steps"][0])

    @property
    def tipping_steps(self) -> int:
        """Number of steps since the vehicle was placed in which it would have tipped over."""
        return int(self.state.counters["tipping_steps"][0])


def _finite(name: str, value: ArrayLike, shape: tuple[int, ...]) -> quantities.FloatArray:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise VehicleInputError(f"{name} {value!r} must be {shape or 'a number'} and finite")
    return array
