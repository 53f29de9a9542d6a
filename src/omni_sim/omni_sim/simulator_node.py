"""ROS node of the simulator: publishes sensor data and subscribes to brake enables.

The driver is either a script or another node that publishes `driver/pedal` and `cmd_vel`. In the
second case, the vehicle brakes fully while no messages arrive.

In lockstep, the node publishes a step and then waits for the message on `brake/enable` with the
same stamp. In real time, the same steps follow the wall clock without waiting; if an enable is late
or missing, all brakes are on. The README of this package describes the contract: topics, types, QoS
settings, parameters and timeouts.
"""

import math
import time
import warnings
from functools import partial

import numpy as np
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from omni_core import topics
from omni_core.configuration import Configuration, ConfigurationWarning, parameter
from omni_core.description import IMU_FRAME, urdf
from omni_core.quantities import SECOND_NS, FloatArray
from omni_core.sensors import Mount
from omni_ros import clocks, line_images, messages, parameters, process
from omni_ros.environment import report
from omni_ros.frames import FrameConfiguration, prefix_frames
from omni_ros.qos import RECENT, RELIABLE, advertise, subscribe
from omni_sim import run_control_node, run_progress
from omni_sim.configuration import SimulatorConfiguration
from omni_sim.driver.manual import DemandInbox, ManualDriver, ManualDriverConfiguration
from omni_sim.messages import (
    flow_message,
    ground_truth,
    imu_message,
    joint_angles,
    scene_markers,
    wheel_forces,
)
from omni_sim.simulator import Observation, Simulator

_INPUTS = 4  # number of subscribed topics at most
# Largest delay that the simulation makes up in real time, by running faster than the clock [s]. If
# it ran faster for long, replies would seem late, and a person could not steer.
_LARGEST_LAG = 0.02
_MARKER_NS = 50_000_000  # shortest time between two updates of the markers [ns]


class LoopConfiguration(Configuration):
    """Synchronization of the simulator with other nodes."""

    mode: str = parameter("lockstep", choices=("lockstep", "real_time"))
    """`lockstep`: the simulator waits for each reply; `real_time`: it follows the wall clock"""
    reply_timeout: float = parameter(10.0, unit="s", above=0.0, maximum=3600.0)
    """In lockstep, limit on the time to wait for a reply"""
    await_odometry: bool = parameter(False)
    """In lockstep, whether the simulator also waits for the odometry of each step; set this for a
    brake assistant that does not wait for the odometry itself"""
    publish_clock: bool = parameter(True)
    """Whether the simulated time is published on /clock; in a ROS domain, only one simulator may
    publish it"""
    driver: str = parameter("scripted", choices=("scripted", "topics", "cmd_vel"))
    """Source of the demands. `scripted`: the script of the maneuver; `topics`: the topics
    driver/pedal and cmd_vel; `cmd_vel`: cmd_vel alone, as long as no pedal is published"""
    stamped_cmd_vel: bool = parameter(True)
    """Whether cmd_vel has the type TwistStamped; otherwise the type is Twist"""
    lines_recorded: bool = parameter(True)
    """Whether a recorder is one of the subscribers of the lines"""
    answered: tuple[str, ...] = parameter(())
    """Further outputs to which the brake assistant replies, as to wheel_states: imu, for example"""
    enable_timeout: float = parameter(0.05, unit="s", above=0.0, maximum=10.0)
    """In real time, age at which an enable becomes invalid, so that all brakes are on"""


class SimulatorNode(Node):
    """Publishes the sensor data of each step and applies the received enables."""

    def __init__(self) -> None:
        super().__init__("simulator")
        self.startup = parameters.declare_configuration(self, process.StartupConfiguration)
        self.loop = parameters.declare_configuration(self, LoopConfiguration)
        self._prefix = parameters.declare_configuration(self, FrameConfiguration).frame_prefix
        self.configuration = parameters.declare_configuration(self, SimulatorConfiguration)
        manual = parameters.declare_configuration(self, ManualDriverConfiguration)
        self.manual_driver: ManualDriver | None = None
        if self.loop.driver != "scripted":
            self.manual_driver = ManualDriver(manual, self.configuration.maneuver)
            self._inbox = DemandInbox(manual.driver_timeout, self.loop.driver == "topics")
            subscribe(self, topics.DRIVER_PEDAL, self._on_driver_pedal)
            command = topics.cmd_vel(stamped=self.loop.stamped_cmd_vel)
            subscribe(self, command, self._on_driver_command, type_parameter="stamped_cmd_vel")
        # The command that writes the parameters reports implausible values.
        warnings.simplefilter("ignore", ConfigurationWarning)
        self.simulator = Simulator(self.configuration, driver=self.manual_driver)
        start = self.manual_driver.start_pose if self.manual_driver is not None else None
        self.control = run_control_node.RunControl(self, start, f"{self._prefix}odom")
        self._wheels = tuple(self.configuration.vehicle.wheels)
        self._all_on = np.ones(len(self._wheels))
        self._enable = self._all_on
        self._enable_stamp_ns = -1
        self._twist_stamp_ns = -1
        self._last_message: dict[str, float] = {}  # arrival time of each node's last message [s]
        self.silence: dict[str, float] = {}  # real time: longest time without messages [s]
        self.sent: dict[str, int] = {}
        self._make_publishers()
        qos = RELIABLE if self.loop.mode == "lockstep" else RECENT
        self.enables = subscribe(self, topics.ENABLE, self._on_enable, qos)
        # Only the stamp is used: to wait for the odometry, and to identify a node that does not
        # answer.
        subscribe(self, topics.TWIST, self._on_twist, raw=True)

    def _make_publishers(self) -> None:
        self._shared_clock: clocks.SharedClock | None = None
        if self.loop.publish_clock:
            self._shared_clock = clocks.SharedClock(self, alone=self.loop.mode == "lockstep")
        cameras, flow_sensors = self.configuration.sensors, self.configuration.flow_sensors
        lines, flows = map(topics.lines, cameras), map(topics.flow, flow_sensors)
        declared = [*topics.published_by("simulator"), topics.DIAGNOSTICS]
        if not self.configuration.vehicle.is_steered:
            declared.remove(topics.STEERING)
        own = {one: advertise(self, one) for one in (*declared, *lines, *flows)}
        self._plain = tuple(one for one in own if one.is_plain)
        infos = {one: advertise(self, one) for one in map(topics.camera_info, cameras)}
        self._advertised = own | infos
        self._reported_limits: frozenset[str] = frozenset()
        # No node replies to the other topics, so one subscriber less is awaited for them.
        answered = {topics.WHEEL_STATES, topics.PEDAL, *map(topics.flow, flow_sensors)}
        answered |= {one for one in own if one.name in self.loop.answered}
        answered |= set(map(topics.lines, cameras)) if self.loop.lines_recorded else set()
        self.outputs = tuple(own[one] for one in own if one in answered)
        clock = self._shared_clock.publisher() if self._shared_clock else None
        others = (own[one] for one in own if one.recorded and one not in answered)
        self.recorded_outputs = (*((clock,) if clock else ()), *others)

    def publish_descriptions(self) -> None:
        """Publish the vehicle description and the geometry of the line cameras, once."""
        vehicle = self.configuration.vehicle
        chassis = (*vehicle.chassis_center, vehicle.chassis_length, vehicle.chassis_width)
        mounts: dict[str, Mount] = {**self.configuration.sensors, **self.configuration.flow_sensors}
        imu = self.configuration.imu
        if imu.enabled:
            mounts[IMU_FRAME] = Mount(x=imu.x, y=imu.y, heading_deg=0.0)
        self._advertised[topics.ROBOT_DESCRIPTION].publish(
            String(data=urdf("vehicle", vehicle.wheels, mounts, chassis))
        )
        for name, sensor in self.configuration.sensors.items():
            info = line_images.camera_info(name, sensor.pixels, sensor.length, sensor.width)
            self._send(topics.camera_info(name), info)

    def publish(self, observation: Observation) -> None:
        """Publish the messages of one step.

        The message of the pedal triggers the replies of other nodes, so it is published after the
        measurements that these nodes need.
        """
        stamp_ns = observation.stamp_ns
        for name, batch in observation.line_batches.items():  # first, as matching takes longest
            image = line_images.line_image(batch.stamp_ns, self._prefix + name, batch.lines)
            self._send(topics.lines(name), image)
        clock = self._shared_clock.publisher() if self._shared_clock else None
        if clock is not None:
            self._publish(clock, Clock(clock=messages.to_time(stamp_ns)))
        for name, flow in observation.flows.items():
            self._send(topics.flow(name), flow_message(name, flow))
        plain = {topic: messages.packed(topic, observation, self._wheels) for topic in self._plain}
        wheels = plain.pop(topics.WHEEL_STATES)
        self._send(topics.WHEEL_STATES, wheels)
        if self.configuration.imu.enabled:
            for reading in observation.imu:
                period_ns = self.simulator.control_period_ns
                self._send(topics.IMU, imu_message(reading, self.configuration.imu, period_ns))
        twist = observation.velocity_sensor
        velocity = messages.planar_twist_with_covariance(
            twist.stamp_ns, twist.value, twist.covariance
        )
        self._send(topics.VELOCITY_SENSOR, velocity)
        for topic, message in plain.items():
            self._send(topic, message)
        self._send(topics.GROUND_TRUTH, ground_truth(observation))
        if stamp_ns % _MARKER_NS < self.simulator.control_period_ns:
            # for robot_state_publisher
            steering = plain.get(topics.STEERING)
            joints = joint_angles(self.configuration.vehicle.wheels, wheels, steering)
            self._advertised[topics.JOINT_STATES].publish(joints)
            self._send(topics.MARKERS, scene_markers(self.configuration, observation))
            self._send(topics.WHEEL_FORCES, wheel_forces(self._wheels, observation))

        simulator = self.simulator
        states = {"overload": simulator.overloaded, "tipping": simulator.tipping}
        exceeded = frozenset(state for state, holds in states.items() if holds)
        if exceeded != self._reported_limits:
            self._report_limits(stamp_ns, exceeded)

    def limits_exceeded(self) -> dict[str, tuple[float, str]]:
        """Return the limits of the model that the run has exceeded so far.

        Returns:
            Total duration [s] and description, keyed by the limit, ``overload`` or ``tipping``.
        """
        exceeded = {}
        overload, tipping_time = self.simulator.overload, self.simulator.tipping_time
        if overload.time > 0.0:
            exceeded["overload"] = overload.time, overload.sentence()
        if tipping_time > 0.0:
            exceeded["tipping"] = (
                tipping_time,
                f"tipping: for {tipping_time:.3g} s one edge of the support polygon carried the "
                "vehicle, so a real one would tip over; the planar model keeps it upright",
            )
        return exceeded

    def _report_limits(self, stamp_ns: int, exceeded: frozenset[str]) -> None:
        """Report that the vehicle has left or re-entered the valid range of its model.

        Args:
            stamp_ns: time of the step [ns].
            exceeded: limits that are exceeded in this step: ``overload``, ``tipping``, or neither.
        """
        self._reported_limits = exceeded
        sentences = self.limits_exceeded()
        words = "; ".join(sentences[state][1] for state in sorted(exceeded))
        if exceeded:
            self.get_logger().warning(words)
        status = messages.diagnostics(
            stamp_ns,
            self.get_fully_qualified_name().removeprefix("/"),
            1 if exceeded else 0,
            words or "back within the limits of the model",
            {"state": ", ".join(sorted(exceeded)) or "ok"},
        )
        self._send(topics.DIAGNOSTICS, status)

    def take_demand(self) -> None:
        """Pass the latest demand of an external driver to the simulator for the next step."""
        if self.manual_driver is None:
            return
        pose = self.control.take_pose()
        if pose is not None:
            self.simulator.place(pose)
            self.manual_driver.halt()
        pedal, target = self._inbox.demand(time.monotonic())
        twist = self.simulator.vehicle.twist
        period = self.simulator.control_period_ns / SECOND_NS
        self.manual_driver.steer(pedal, target, twist, period)

    def enable_for(self, stamp_ns: int) -> FloatArray:
        """Return the received brake enables, shape (N,), or ones (all brakes on) if not valid.

        Enables are valid if they have one publisher and are neither too old nor from the future.
        """
        age = stamp_ns - self._enable_stamp_ns
        if self.enables.get_publisher_count() > 1:
            self.get_logger().error(
                "brake/enable has more than one publisher: all brakes on", throttle_duration_sec=1.0
            )
            return self._all_on
        # An enable from the future would remain valid too long and could keep brakes released.
        if self._enable_stamp_ns < 0 or not 0 <= age <= self.loop.enable_timeout * SECOND_NS:
            return self._all_on
        return self._enable

    def note_silence(self, now: float) -> None:
        """Update the longest time without a message for each node that sends replies.

        Args:
            now: present time on the monotonic clock [s].
        """
        nodes = ["brake_assist"]
        if self.configuration.simulation.render_lines:
            nodes.append("linescan_odometry")
        for node in nodes:
            age = now - self._last_message.setdefault(node, now)
            self.silence[node] = max(age, self.silence.get(node, 0.0))

    def has_reply(self, stamp_ns: int) -> bool:
        """Return whether the enables of this step, and the odometry if required, have arrived."""
        awaited = self.loop.await_odometry
        return self._enable_stamp_ns == stamp_ns and (not awaited or self._has_twist(stamp_ns))

    def silent_node(self, stamp_ns: int) -> str:
        """Return the node whose message for this step is missing, and the topic, as a text."""
        rendered = self.configuration.simulation.render_lines
        if not rendered or self._has_twist(stamp_ns):
            return "brake_assist (nothing on brake/enable)"
        return "linescan_odometry (nothing on odometry/twist)"

    def _has_twist(self, stamp_ns: int) -> bool:
        # The newest line may be older than the step, but not as old as the previous step.
        newest_ns = self._twist_stamp_ns
        return newest_ns >= 0 and newest_ns > stamp_ns - self.simulator.control_period_ns

    def _send(self, topic: topics.Topic, message: object) -> None:
        self._publish(self._advertised[topic], message)

    def _publish(self, publisher: Publisher, message: object) -> None:
        prefix_frames(message, self._prefix)
        publisher.publish(message)
        self.count(publisher.topic_name)

    def count(self, topic: str) -> None:
        """Count a published message, for comparison with the number of recorded messages."""
        self.sent[topic] = self.sent.get(topic, 0) + 1

    def _on_driver_pedal(self, message: JointState) -> None:
        pedal = float(message.position[0]) if message.position else math.nan
        self._inbox.take_pedal(pedal, time.monotonic())

    def _on_driver_command(self, message: TwistStamped | Twist) -> None:
        twist = message.twist if isinstance(message, TwistStamped) else message
        values = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
        self._inbox.take_twist(values, time.monotonic())

    def _on_enable(self, message: JointState) -> None:
        names = list(message.name)
        if sorted(names) == sorted(self._wheels) and len(message.effort) == len(names):
            values = dict(zip(names, message.effort, strict=True))
            enable = np.array([values[name] for name in self._wheels])
        else:
            self.get_logger().error(
                f"brake/enable has {len(message.effort)} efforts for {len(names)} names, "
                f"{', '.join(names[: len(self._wheels)]) or 'no wheel'}; it must have one for each "
                f"of {', '.join(self._wheels)}: all brakes on",
                throttle_duration_sec=1.0,
            )
            enable = self._all_on
        # An invalid value must not release a brake; the comparison is false for NaN.
        self._enable = np.where((enable >= 0.0) & (enable <= 1.0), enable, 1.0)
        self._enable_stamp_ns = messages.to_nanoseconds(message.header.stamp)
        self._last_message["brake_assist"] = time.monotonic()

    def _on_twist(self, wire: bytes) -> None:
        self._twist_stamp_ns = messages.leading_stamp(wire) or 0
        self._last_message["linescan_odometry"] = time.monotonic()


def run(node: SimulatorNode, spinner: process.Spinner) -> None:
    """Simulate until the vehicle stops, the duration limit is reached, or a signal ends the node.

    Raises:
        NodeError: in lockstep a reply exceeds the time limit; the message names the node.
    """
    simulator = node.simulator
    node.startup.await_subscribers(node.outputs, spinner)
    recorders = max(0, node.startup.subscribers - 1)
    node.startup.await_subscribers(node.recorded_outputs, spinner, recorders)
    if node.loop.mode == "lockstep":
        node.startup.await_publisher(node.enables, spinner)
    node.publish_descriptions()
    progress = run_progress.RunProgress(node.configuration)
    started = time.monotonic()
    late = 0.0  # delay that is not made up [s]
    while not spinner.stop:
        started += node.control.wait(spinner)
        node.take_demand()
        observation = simulator.observe()
        node.publish(observation)
        progress.update(observation)
        if progress.is_news:
            report(progress.report())
        if node.loop.mode == "lockstep":
            # Also wait after the last step, so that the recording does not depend on the speed of
            # the nodes.
            _await_reply(node, spinner, observation.stamp_ns)
        if progress.finished and node.manual_driver is None:
            break
        if node.loop.mode == "real_time":
            next_ns = observation.stamp_ns + simulator.control_period_ns
            deadline = started + late + next_ns / SECOND_NS
            late += max(0.0, time.monotonic() - deadline - _LARGEST_LAG)
            _pace(spinner, deadline)
            node.note_silence(time.monotonic())
        simulator.advance(node.enable_for(observation.stamp_ns))
    wall = time.monotonic() - started
    final: dict[str, object] = {"finished": progress.outcome, "wall": wall, "sent": node.sent}
    final |= {"limits": node.limits_exceeded(), "silence": node.silence}
    report(progress.report() | final)


def _await_reply(node: SimulatorNode, spinner: process.Spinner, stamp_ns: int) -> None:
    timeout = node.loop.reply_timeout
    if spinner.spin_until(lambda: node.has_reply(stamp_ns), timeout):
        # Another node may publish before it has discovered the recorder.
        node.count(node.enables.topic_name)
    elif not spinner.stop:
        raise process.NodeError(
            f"no reply at {stamp_ns / SECOND_NS:.3f} s within {timeout:g} s: "
            f"{node.silent_node(stamp_ns)} has not replied"
        )


def _pace(spinner: process.Spinner, deadline: float) -> None:
    # Process messages even if the simulation is late; otherwise their delay would keep growing.
    for _ in range(_INPUTS):
        spinner.spin_once(0.0)
    spinner.spin_until(lambda: False, deadline - time.monotonic())


main = partial(process.run_process, SimulatorNode, run)


if __name__ == "__main__":
    raise SystemExit(main())
