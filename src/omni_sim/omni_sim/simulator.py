"""The simulated machine: vehicle, driver and sensors, advanced by one control period at a time.

`observe` tells what the sensors see at the current stamp, `advance` applies brake enables for one
control period. Nothing here knows of ROS, of clocks or of who decides the enables.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from omni_platform.aside import aside
from omni_platform.configuration import Configuration, ConfigurationError, parameter, section
from omni_platform.quantities import SECOND_NS, FloatArray
from omni_platform.sensors import FlowSensor, LineSensor
from omni_platform.signals import Flow, Twist
from omni_sim.camera.camera import CameraConfiguration, LineCameraArray
from omni_sim.camera.clock import LineClock
from omni_sim.camera.optics import check_exposure
from omni_sim.camera.poses import interpolate_poses, interpolate_velocities
from omni_sim.camera.sway import swaying
from omni_sim.driver.scripted import Driver, ManeuverConfiguration, ScriptedDriver
from omni_sim.encoders import EncoderConfiguration
from omni_sim.faults import FaultConfiguration
from omni_sim.flow_sensor import FlowConfiguration, FlowSensorArray, check_flow_sensors
from omni_sim.ground.elevation import ElevationConfiguration
from omni_sim.ground.friction import FrictionMap, FrictionPatch
from omni_sim.imu import ImuConfiguration
from omni_sim.measurement import Readings, Truth, build_instruments, draws, measure
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.texture import TextureConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.overload import Overload, OverloadWatch
from omni_sim.vehicle.vehicle import Vehicle
from omni_sim.velocity_sensor import VelocitySensor, VelocitySensorConfiguration

__all__ = [
    "CameraConfiguration",
    "GroundConfiguration",
    "LineBatch",
    "ManeuverConfiguration",
    "Observation",
    "SimulationConfiguration",
    "Simulator",
    "SimulatorConfiguration",
    "VehicleConfiguration",
    "VelocitySensorConfiguration",
]

LineArray = NDArray[np.uint8] | NDArray[np.uint16]


@dataclasses.dataclass(frozen=True, kw_only=True)
class GroundConfiguration(Configuration):
    """What the vehicle drives on and what its line cameras look at."""

    texture: TextureConfiguration = section(TextureConfiguration, description="Look of the ground")
    friction: float = parameter(
        1.0,
        description="Friction factor mu/mu_0 of the ground, relative to the tire's own data",
        minimum=0.0,
        maximum=2.0,
    )
    patches: Mapping[str, FrictionPatch] = section(
        dict, description="Patches with another friction"
    )
    elevation: ElevationConfiguration = section(
        ElevationConfiguration, description="Height of the ground, flat by default"
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimulationConfiguration(Configuration):
    """Steps and end of a simulation."""

    physics_step: float = parameter(
        0.0005, description="Fixed step of the physics", unit="s", minimum=1e-6, maximum=0.01
    )
    control_period: float = parameter(
        0.01, description="Time between two control steps", unit="s", minimum=1e-4, maximum=1.0
    )
    duration_limit: float = parameter(
        30.0, description="Time at which a run ends at the latest", unit="s", above=0.0
    )
    settling_time: float = parameter(
        0.5,
        description="Time that the vehicle must stand still before the run ends",
        unit="s",
        minimum=0.0,
    )
    rest_speed: float = parameter(
        0.05, description="Speed below which the vehicle stands still", unit="m/s", above=0.0
    )
    render_lines: bool = parameter(
        True,
        description="Render the line cameras and read the flow sensors; without, there is no "
        "optical odometry",
    )

    @property
    def control_period_ns(self) -> int:
        """Control period [ns]."""
        return round(self.control_period * SECOND_NS)

    @property
    def steps_per_period(self) -> int:
        """Physics steps in a control period."""
        return round(self.control_period / self.physics_step)

    def check_consistency(self) -> None:
        """Refuse a control period that is no multiple of the physics step.

        Raises:
            ConfigurationError: names both.
        """
        if abs(self.steps_per_period * self.physics_step - self.control_period) > 1e-12:
            raise ConfigurationError(
                "control_period",
                f"{self.control_period:g} s is no multiple of the physics step of "
                f"{self.physics_step:g} s",
            )


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimulatorConfiguration(Configuration):
    """Everything that the simulated machine depends on."""

    seed: int = parameter(1, description="Seed of every random draw", minimum=0)
    vehicle: VehicleConfiguration = parameter(description="Vehicle")
    ground: GroundConfiguration = section(GroundConfiguration, description="Ground")
    sensors: Mapping[str, LineSensor] = parameter(description="Line cameras by name")
    camera: CameraConfiguration = section(
        CameraConfiguration, description="Exposure common to the line cameras"
    )
    flow_sensors: Mapping[str, FlowSensor] = section(
        dict, description="Optical-flow sensors by name"
    )
    flow: FlowConfiguration = section(
        FlowConfiguration, description="Errors common to the flow sensors"
    )
    maneuver: ManeuverConfiguration = section(
        ManeuverConfiguration, description="What the scripted driver does"
    )
    velocity_sensor: VelocitySensorConfiguration = section(
        VelocitySensorConfiguration, description="Noisy sampled velocity sensor"
    )
    imu: ImuConfiguration = section(ImuConfiguration, description="Inertial measurement unit")
    encoders: EncoderConfiguration = section(EncoderConfiguration, description="Wheel encoders")
    faults: Mapping[str, FaultConfiguration] = section(
        dict, description="Faults of velocity sensor, IMU and encoders by name"
    )
    simulation: SimulationConfiguration = section(
        SimulationConfiguration, description="Steps and end of the simulation"
    )

    def check_consistency(self) -> None:
        """Refuse a camera that is too slow to deliver a pair of lines in every control period.

        Nor may a line be exposed for longer than there is time, nor may a run end before the
        driver's demands do.

        Raises:
            ConfigurationError: names the sensor.
        """
        for name, sensor in self.sensors.items():
            if sensor.line_rate * self.simulation.control_period < 2.0:
                raise ConfigurationError(
                    f"sensors.{name}.line_rate",
                    f"{sensor.line_rate:g} 1/s gives fewer than two lines in a control period of "
                    f"{self.simulation.control_period:g} s",
                )
        check_exposure(self.sensors, self.camera)
        check_flow_sensors(self.flow_sensors, self.flow, self.simulation.control_period)
        last = self.maneuver.earliest_end
        if last > self.simulation.duration_limit:
            raise ConfigurationError(
                "simulation.duration_limit",
                f"{self.simulation.duration_limit:g} s end before the driver's demands, at "
                f"{last:g} s; set it higher",
            )


@dataclasses.dataclass(frozen=True)
class LineBatch:
    """Consecutive lines of one camera.

    Attributes:
        stamp_ns: exposure of the newest line [ns].
        lines: grey levels, uint8 or uint16, oldest line first, shape (m, pixels).
    """

    stamp_ns: int
    lines: LineArray


@dataclasses.dataclass(frozen=True, eq=False)
class Observation:
    """The state of the machine at a control stamp, and what its sensors say of it.

    Attributes:
        stamp_ns: time since the start of the run [ns].
        wheel_angle: [rad], shape (N,).
        wheel_speed: [rad/s], shape (N,).
        brake_torque: acting on each wheel [N m], shape (N,).
        pedal: the driver's brake demand 0..1.
        command: the driver's drive demand in the body frame [m/s, m/s, rad/s], shape (3,).
        pose: true x, y, yaw of `base_link` in `odom` [m, m, rad], shape (3,).
        attitude: true height [m], roll, pitch [rad] of `base_link` on uneven ground, shape (3,).
        twist: true twist of `base_link` in the body frame [m/s, m/s, rad/s], shape (3,).
        velocity_sensor: reading of the noisy sampled sensor.
        imu: what it reads: yaw rate [rad/s], specific force along x and y at the mounting [m/s^2],
            shape (3,); no numbers without one.
        encoder_speed: wheel speeds as the encoders read them [rad/s], shape (N,).
        wheel_load: [N], shape (N,).
        wheel_force_body: the same as vectors in the body frame [N], shape (N, 2).
        slip: of the contact patches, Eq. (20) [1], shape (N,).
        line_batches: lines since the last stamp, by camera.
        flows: what flow sensors measure at this stamp, by name.
    """

    stamp_ns: int
    wheel_angle: FloatArray
    wheel_speed: FloatArray
    brake_torque: FloatArray
    pedal: float
    command: FloatArray
    pose: FloatArray
    attitude: FloatArray
    twist: FloatArray
    velocity_sensor: Twist
    imu: FloatArray
    encoder_speed: FloatArray
    wheel_load: FloatArray
    wheel_force_body: FloatArray
    slip: FloatArray
    line_batches: Mapping[str, LineBatch]
    flows: Mapping[str, Flow]


class Simulator:
    """A vehicle with its driver and sensors.

    Attributes:
        configuration: everything that it depends on.
        vehicle: the vehicle, to look into.
        control_period_ns: time that one `advance` takes [ns].
        overloaded: whether a wheel carried more than its tire model covers in the last period.
        tipping: whether the vehicle would have tipped over in the last period.
    """

    def __init__(
        self,
        configuration: SimulatorConfiguration,
        textures: TextureCache | None = None,
        driver: Driver | None = None,
    ) -> None:
        """Place the vehicle at the start of its maneuver.

        Args:
            configuration: everything that the machine depends on.
            textures: where the ground comes from; the user's cache by default.
            driver: who drives; the one that follows the script of the maneuver by default.
        """
        self.configuration = configuration
        simulation = configuration.simulation
        self.control_period_ns = simulation.control_period_ns
        self._driver: Driver = driver or ScriptedDriver(configuration.maneuver)
        # What the maneuver says of the world is not meant by who drives in its place.
        self._hold_world = driver is None and configuration.maneuver.hold_world_direction
        ground = configuration.ground
        self.vehicle = Vehicle(
            configuration.vehicle,
            FrictionMap(ground.friction, ground.patches),
            simulation.physics_step,
            self._driver.start_pose,
            self._driver.start_twist,
            ground.elevation,
        )
        self._sprung = configuration.vehicle.suspension.stiffness > 0.0
        tire = configuration.vehicle.tire
        self._overload_watch = OverloadWatch(
            self.vehicle.wheel_names, tire.model, tire.largest_load, simulation.physics_step
        )
        self.overloaded = self.tipping = False
        # No step, but the kernel is loaded: the first real step is as fast as the others.
        self.vehicle.advance(0, 0.0, np.ones(len(configuration.vehicle.wheels)), np.zeros(3))
        self._stamp_ns = 0
        # Streams of their own, so that one draw more of one does not change the other.
        sensor_seed, camera_seed, instrument_seed, flow_seed = np.random.SeedSequence(
            configuration.seed
        ).spawn(4)
        self._velocity_sensor = VelocitySensor(
            configuration.velocity_sensor, np.random.default_rng(sensor_seed)
        )
        wheels = len(configuration.vehicle.wheels)
        self._instruments = build_instruments(
            configuration.imu,
            configuration.encoders,
            configuration.faults,
            wheels,
            simulation.control_period,
        )
        self._noise = np.random.default_rng(instrument_seed)
        self._measured_ns = -1
        self._reading, self._covariance = np.zeros(3), np.zeros((3, 3))
        self._imu, self._encoder = np.zeros(3), np.zeros(wheels)
        self._cameras: LineCameraArray | None = None
        self._batches = _Batches({}, self._render)
        self._flow_sensors = FlowSensorArray(
            configuration.flow_sensors if simulation.render_lines else {},
            configuration.flow,
            np.random.default_rng(flow_seed),
            self._driver.start_twist,
        )
        self._flows = self._flow_sensors.measure(0)
        if simulation.render_lines and configuration.sensors:
            texture = (textures or TextureCache.of_user()).texture(ground.texture)
            self._cameras = LineCameraArray(
                configuration.sensors, texture, configuration.camera, camera_seed
            )
            rates = {sensor.line_rate for sensor in configuration.sensors.values()}
            self._clocks = {rate: LineClock(rate) for rate in rates}
            start = np.zeros((1, 6))
            start[0, :3] = self._driver.start_pose
            start[0, 3:] = _in_world(self._driver.start_twist, start[0, 2])
            self._batches = self._expose(start, -1, 0)

    def observe(self) -> Observation:
        """Return state and measurements at the current stamp; repeated calls return the same."""
        vehicle = self.vehicle
        twist = vehicle.twist
        pose = vehicle.pose
        wheels = vehicle.wheels
        self._measure()
        return Observation(
            stamp_ns=self._stamp_ns,
            wheel_angle=wheels["angle"],
            wheel_speed=wheels["speed"],
            brake_torque=wheels["brake"],
            pedal=self._driver.pedal(self._stamp_ns),
            command=self._driver.command_twist(self._stamp_ns, float(pose[2])),
            pose=pose,
            attitude=vehicle.attitude,
            twist=twist,
            velocity_sensor=Twist(self._taken_ns, self._reading.copy(), self._covariance.copy()),
            imu=self._imu.copy(),
            encoder_speed=self._encoder.copy(),
            wheel_load=wheels["load"],
            wheel_force_body=vehicle.wheel_force_body,
            slip=wheels["slip"],
            line_batches=self._batches,
            flows=self._flows,
        )

    def _measure(self) -> None:
        """Read all sensors but the cameras, once per stamp."""
        if self._measured_ns == self._stamp_ns:
            return
        self._measured_ns = self._stamp_ns
        vehicle = self.vehicle
        motion, tilt_x, tilt_y = vehicle.motion
        sample = self._velocity_sensor.measure(self._stamp_ns, motion[3:])
        self._taken_ns, self._reading = sample.stamp_ns, sample.value
        wheels = vehicle.wheels
        measure(
            self._instruments,
            Truth(
                self._stamp_ns // self.control_period_ns,
                self.control_period_ns,
                motion,
                (tilt_x, tilt_y),
                wheels["angle"].copy(),  # contiguous, as the compiled loop hands them over
                wheels["speed"].copy(),
            ),
            self._noise.standard_normal(draws(len(self._encoder))),
            Readings(self._reading, self._imu, self._encoder),
        )
        self._velocity_sensor.state_covariance(self._reading, self._covariance)

    def advance(self, brake_enable: FloatArray) -> None:
        """Go on by one control period.

        Args:
            brake_enable: share of the brake pressure that reaches each wheel, 0..1, shape (N,).
        """
        start_ns = self._stamp_ns
        ride = self.vehicle.ride
        trajectory = self.vehicle.advance(
            self.configuration.simulation.steps_per_period,
            self._driver.pedal(start_ns),
            brake_enable,
            self._driver.command_twist(start_ns, float(self.vehicle.pose[2])),
            hold_world_direction=self._hold_world,
        )
        self.overloaded = self._overload_watch.update(
            self.vehicle.wheels["load"], self.vehicle.overloaded_steps
        )
        self.tipping = self.vehicle.tipping
        self._stamp_ns = start_ns + self.control_period_ns
        if self._sprung:
            trajectory = swaying(
                trajectory,
                ride,
                self.vehicle.ride,
                self.vehicle.masses.height,
                self.configuration.simulation.control_period,
            )
        self._flow_sensors.advance(trajectory)
        self._flows = self._flow_sensors.measure(self._stamp_ns)
        if self._cameras is not None:
            self._batches = self._expose(trajectory, start_ns, self._stamp_ns)

    def place(self, pose: FloatArray) -> None:
        """Put the vehicle somewhere at rest, while time goes on.

        Args:
            pose: x, y [m], yaw [rad] of base_link in the world frame, shape (3,).
        """
        self.vehicle.place(pose, np.zeros(3))

    @property
    def overload(self) -> Overload | None:
        """Overload of the tire model since the start of the run, None if there was none."""
        return self._overload_watch.overload

    @property
    def tipping_time(self) -> float:
        """For how long the load has lain on one edge of the wheels' polygon [s].

        A real vehicle would have begun to tip over there; the planar model ends.
        """
        return self.vehicle.tipping_steps * self.configuration.simulation.physics_step

    def _expose(self, trajectory: FloatArray, start_ns: int, end_ns: int) -> _Batches:
        """Return the lines of every camera with times in (start, end]."""
        self._batches.complete()
        step_ns = self.control_period_ns / self.configuration.simulation.steps_per_period
        blurred = self.configuration.camera.exposure_time > 0.0
        taken: dict[float, _Exposure] = {}
        for rate, clock in self._clocks.items():
            first, last = clock.lines_in(start_ns, end_ns)
            times = clock.times_ns(first, last)
            poses = interpolate_poses(trajectory, max(start_ns, 0), step_ns, times)
            velocities = None
            if blurred:
                velocities = interpolate_velocities(trajectory, max(start_ns, 0), step_ns, times)
            taken[rate] = _Exposure(clock.stamp_ns(last - 1), poses, velocities)
        sensors = self.configuration.sensors.items()
        exposures = {name: taken[sensor.line_rate] for name, sensor in sensors}
        if self._cameras is not None and (self._sprung or self.vehicle.uneven):
            for camera in self._cameras.cameras.values():
                camera.rise = self.vehicle.clearance(camera.sensor.x, camera.sensor.y)
        return _Batches(exposures, self._render)

    def _render(self, name: str, exposure: _Exposure) -> LineBatch:
        assert self._cameras is not None
        lines = self._cameras.render_next(name, exposure.poses, exposure.velocities)
        return LineBatch(exposure.stamp_ns, lines)


@dataclasses.dataclass(frozen=True)
class _Exposure:
    """How a camera moved while it took a batch of m lines.

    Attributes:
        stamp_ns: of the newest line [ns].
        poses: of base_link in the middle of each exposure [m, m, rad], shape (m, 3).
        velocities: rates of these, None where they do not blur.
    """

    stamp_ns: int
    poses: FloatArray
    velocities: FloatArray | None


class _Batches(Mapping[str, LineBatch]):
    """Batches of the cameras, the first rendered when it is asked for, others meanwhile.

    Who sends one on has it matched elsewhere while the next is rendered.
    """

    def __init__(
        self,
        exposures: Mapping[str, _Exposure],
        render: Callable[[str, _Exposure], LineBatch],
    ) -> None:
        # The last one first: whoever asks in turn begins at the other end.
        self._rendering = {
            name: aside(partial(render, name, exposures[name]))
            for name in reversed(tuple(exposures))
        }
        self._names = tuple(exposures)
        self._made: dict[str, LineBatch] = {}

    def __getitem__(self, name: str) -> LineBatch:
        if name not in self._made:
            self._made[name] = self._rendering[name]()
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def complete(self) -> None:
        """Render what nobody has asked for: the cameras count their lines."""
        for name in self:
            self[name]


def _in_world(twist: FloatArray, yaw: float) -> FloatArray:
    """Return a body twist as rates of x, y, yaw in the world, shape (3,)."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.array(
        [cosine * twist[0] - sine * twist[1], sine * twist[0] + cosine * twist[1], twist[2]]
    )
