"""Simulator of vehicle, driver and sensors, advanced by one control period at a time.

`observe` returns the measurements of the sensors at the present stamp; `advance` applies brake
enables for one control period. The module depends neither on ROS nor on a clock.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from omni_core import quantities, signals
from omni_sim import flow_sensor, measurement
from omni_sim.camera import batches
from omni_sim.camera.camera import LineCameraArray
from omni_sim.configuration import SimulatorConfiguration
from omni_sim.driver.scripted import Driver, ScriptedDriver
from omni_sim.ground.friction import FrictionMap
from omni_sim.texture.cache import TextureCache
from omni_sim.vehicle.mujoco_vehicle import build_vehicle
from omni_sim.vehicle.suspension import swaying


@dataclasses.dataclass(frozen=True, eq=False)
class Observation:
    """State of the vehicle at a control stamp, with the measurements of its sensors.

    Attributes:
        stamp_ns: time since the start of the run [ns].
        wheel_angle: true angle of each wheel [rad], shape (N,).
        wheel_speed: true speed of each wheel [rad/s], shape (N,).
        brake_torque: brake torque on each wheel [N m], shape (N,).
        pedal: brake demand of the driver, 0 to 1.
        command: drive demand of the driver in the body frame [m/s, m/s, rad/s], shape (3,).
        pose: true x, y, yaw of `base_link` in `odom` [m, m, rad], shape (3,).
        attitude: true height [m], roll, pitch [rad] of `base_link` on uneven ground, shape (3,).
        twist: true twist of `base_link` in the body frame [m/s, m/s, rad/s], shape (3,).
        velocity_sensor: reading of the velocity sensor.
        imu: IMU readings since the last stamp; NaN if the vehicle has no IMU.
        steering_angle: steering angle of each wheel, 0 if not steered [rad], shape (N,).
        steering_rate: rate of the steering angles [rad/s], shape (N,).
        encoder_speed: wheel speeds measured by the encoders [rad/s], shape (N,).
        wheel_force_body: forces of the wheels in the body frame [N], shape (N, 2).
        line_batches: lines of each camera since the last stamp, keyed by camera name.
        flows: measurements of the flow sensors at this stamp, keyed by sensor name.
    """

    stamp_ns: int
    wheel_angle: quantities.FloatArray
    wheel_speed: quantities.FloatArray
    brake_torque: quantities.FloatArray
    pedal: float
    command: quantities.FloatArray
    pose: quantities.FloatArray
    attitude: quantities.FloatArray
    twist: quantities.FloatArray
    velocity_sensor: signals.TwistSample
    imu: tuple[signals.ImuSample, ...]
    steering_angle: quantities.FloatArray
    steering_rate: quantities.FloatArray
    encoder_speed: quantities.FloatArray
    wheel_force_body: quantities.FloatArray
    line_batches: Mapping[str, signals.LineBatch]
    flows: Mapping[str, signals.Flow]


class Overload:
    """Records wheel loads above the largest load of the tire model during a run.

    Attributes:
        time: total time of overload since the start, summed over the wheels [s].
    """

    def __init__(
        self, wheel_names: Sequence[str], model: str, limit: float, physics_step: float
    ) -> None:
        """Create a monitor that has recorded no overload.

        Args:
            wheel_names: wheel names in the order of all wheel arrays.
            model: name of the tire model.
            limit: largest load for which the model is valid [N].
            physics_step: length of a step [s].
        """
        self.time = 0.0
        self._names, self._model, self._limit = tuple(wheel_names), model, limit
        self._step = physics_step
        self._largest = np.zeros(len(self._names))

    def update(self, load: quantities.FloatArray, overloaded_steps: int) -> bool:
        """Record the wheel loads at the end of a control period.

        Args:
            load: wheel loads at the end of the period [N], shape (N,).
            overloaded_steps: number of physics steps with overload since the start, summed over
                wheels.

        Returns:
            Whether a wheel was overloaded within the period.
        """
        self._largest = np.maximum(self._largest, load)
        before, self.time = self.time, overloaded_steps * self._step
        return self.time > before

    @property
    def largest_load(self) -> dict[str, float]:
        """Largest load of each overloaded wheel at the ends of the control periods [N], by name."""
        loads = zip(self._names, self._largest.tolist(), strict=True)
        return {name: load for name, load in loads if load > self._limit}

    def sentence(self) -> str:
        """Return a sentence that describes the overload."""
        wheels = ", ".join(f"{name} up to {load:.0f} N" for name, load in self.largest_load.items())
        return (
            f"overload: wheels carried more than the {self._limit:.0f} N that the tire model "
            f"{self._model} covers, for {self.time:.3g} s in total"
            f"{f' ({wheels})' if wheels else ''}; their forces were computed at "
            f"{self._limit:.0f} N"
        )


class Simulator:
    """Simulated vehicle with its driver and sensors.

    Attributes:
        configuration: configuration of the simulator.
        vehicle: the simulated vehicle.
        control_period_ns: simulated time that a call of `advance` takes [ns].
        overload: record of the wheel loads that exceeded the limit of the tire model in this run.
        overloaded: whether a wheel load exceeded this limit in the last control period.
        tipping: whether a real vehicle would have begun to tip over in the last control period.
    """

    def __init__(
        self,
        configuration: SimulatorConfiguration,
        textures: TextureCache | None = None,
        driver: Driver | None = None,
    ) -> None:
        """Place the vehicle at the start of its maneuver.

        Args:
            configuration: configuration of the simulator.
            textures: source of ground textures; the user's cache by default.
            driver: driver of the vehicle; by default the script of the maneuver.
        """
        self.configuration = configuration
        simulation = configuration.simulation
        self.control_period_ns = simulation.control_period_ns
        self._steps = simulation.steps_per_period
        self._driver: Driver = driver or ScriptedDriver(configuration.maneuver)
        # Only the scripted driver keeps a direction that is fixed in the world.
        self._hold_world = driver is None and configuration.maneuver.hold_world_direction
        vehicle, ground = configuration.vehicle, configuration.ground
        friction = FrictionMap(ground.friction, ground.patches)
        step, start = simulation.physics_step, (self._driver.start_pose, self._driver.start_twist)
        self.vehicle = build_vehicle(vehicle, friction, step, *start, ground.elevation)
        self._sprung = vehicle.suspension.stiffness > 0.0
        tire = vehicle.tire
        self.overload = Overload(self.vehicle.wheel_names, tire.model, tire.largest_load, step)
        self.overloaded = self.tipping = False
        # Load the kernel without a step, so that the first real step is as fast as all others.
        motion = self.vehicle.advance(0, 0.0, np.ones(len(vehicle.wheels)), np.zeros(3))
        self._stamp_ns = 0
        self._make_sensors(textures, motion)

    def _make_sensors(self, textures: TextureCache | None, motion: quantities.FloatArray) -> None:
        """Create all sensors.

        Args:
            textures: source of ground textures; the user's cache by default.
            motion: motion of the vehicle at the start, from `Vehicle.advance`, shape (1, 6).
        """
        configuration, simulation = self.configuration, self.configuration.simulation
        # Each stream is separate, so that an additional random value in one does not change the
        # others.
        sensor_seed, camera_seed, instrument_seed, flow_seed = np.random.SeedSequence(
            configuration.seed
        ).spawn(4)
        self._sensors = measurement.Sensors(configuration, sensor_seed, instrument_seed)
        self._flow_sensors = flow_sensor.FlowSensorArray(
            configuration.flow_sensors if simulation.render_lines else {},
            configuration.flow,
            np.random.default_rng(flow_seed),
            self._driver.start_twist,
        )
        self._flows = self._flow_sensors.measure(0)
        self._lines: batches.LineExposures | None = None
        if simulation.render_lines and configuration.sensors:
            texture = (textures or TextureCache.of_user()).texture(configuration.ground.texture)
            cameras = LineCameraArray(
                configuration.sensors, texture, configuration.camera, camera_seed
            )
            step_ns = self.control_period_ns / self._steps
            blurred = configuration.camera.exposure_time > 0.0
            self._lines = batches.LineExposures(cameras, step_ns, blurred=blurred)
        self._batches = self._expose(motion, -1, self.vehicle.steering[0])

    def observe(self) -> Observation:
        """Return state and measurements at the present stamp; repeated calls give equal results."""
        vehicle = self.vehicle
        motion, wheels = vehicle.motion, vehicle.state.wheels.copy()
        pose, twist = motion[:3], motion[3:]
        steering_angle, steering_rate = vehicle.steering
        self._sensors.measure(self._stamp_ns, motion, vehicle.state)
        pedal, command = self._driver.demand(self._stamp_ns, float(pose[2]))
        return Observation(
            stamp_ns=self._stamp_ns,
            wheel_angle=wheels["angle"],
            wheel_speed=wheels["speed"],
            brake_torque=wheels["brake"],
            pedal=pedal,
            command=command,
            pose=pose,
            attitude=vehicle.attitude,
            twist=twist,
            velocity_sensor=self._sensors.twist,
            imu=self._sensors.imu,
            steering_angle=steering_angle,
            steering_rate=steering_rate,
            encoder_speed=self._sensors.wheel_speed,
            wheel_force_body=vehicle.wheel_force_body,
            line_batches=self._batches,
            flows=self._flows,
        )

    def advance(self, brake_enable: quantities.FloatArray) -> None:
        """Advance vehicle and sensors by one control period.

        Args:
            brake_enable: share of the brake pressure that reaches each wheel, 0 to 1, shape (N,).
        """
        start_ns = self._stamp_ns
        if self.vehicle.brake_fault_onsets.any():
            self.vehicle.apply_brake_faults(start_ns * 1e-9)
        if self.configuration.vehicle.fork.time:
            self.vehicle.lift(start_ns * 1e-9)
        ride = self.vehicle.ride if self._sprung else None
        steering = self.vehicle.steering[0]
        pedal, command = self._driver.demand(start_ns, float(self.vehicle.pose[2]))
        trajectory = self.vehicle.advance(
            self._steps, pedal, brake_enable, command, hold_world_direction=self._hold_world
        )
        if self.configuration.imu.rate > 0.0:
            self._sensors.path = trajectory[1:]
        loads = self.vehicle.state.wheels["load"]
        self.overloaded = self.overload.update(loads, self.vehicle.overloaded_steps)
        self.tipping = self.vehicle.tipping
        self._stamp_ns = start_ns + self.control_period_ns
        if ride is not None:
            height = self.vehicle.height
            period = self.configuration.simulation.control_period
            trajectory = swaying(trajectory, ride, self.vehicle.ride, height, period)
        self._flows = self._flow_sensors.measure(self._stamp_ns, trajectory)
        self._batches = self._expose(trajectory, start_ns, steering)

    def _expose(
        self, trajectory: quantities.FloatArray, start_ns: int, before: quantities.FloatArray
    ) -> Mapping[str, signals.LineBatch]:
        """Return the lines that each camera exposes between a start time and the present stamp.

        Args:
            trajectory: x, y, yaw of base_link [m, m, rad] and their time derivatives in the world
                frame, from the start time to the present stamp, shape (n + 1, 6).
            start_ns: start time [ns], not included; -1 to include the line at time 0.
            before: steering angles at the start time [rad], shape (N,).
        """
        if self._lines is None:
            return {}
        angles = zip(before.tolist(), self.vehicle.steering[0].tolist(), strict=True)
        steering = dict(zip(self.vehicle.wheel_names, angles, strict=True))
        return self._lines.expose(
            trajectory, start_ns, self._stamp_ns, steering, self.vehicle.clearance
        )

    def place(self, pose: quantities.FloatArray) -> None:
        """Place the vehicle at rest in another pose; the time does not change.

        Args:
            pose: x, y [m], yaw [rad] of base_link in the world frame, shape (3,).
        """
        self.vehicle.place(pose, np.zeros(3))

    @property
    def tipping_time(self) -> float:
        """Time for which the weight was on a single edge of the support polygon [s].

        During this time a real vehicle would begin to tip over, which the planar model does not
        simulate.
        """
        return self.vehicle.tipping_steps * self.configuration.simulation.physics_step
