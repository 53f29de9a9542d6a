"""The simulator as a ROS node: what a vehicle's sensors would see out, brake enables in.

Lockstep: after publishing a step the node waits for the `brake/enable` of the same stamp. Real
time: the same steps are paced to the wall clock and never wait; an enable that is late or missing
means all brakes on. The contract (topics, types, QoS, parameters, timeouts) is in the README of
this package.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped, TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from visualization_msgs.msg import MarkerArray

from omni_platform.configuration import Configuration, parameter
from omni_ros.messages import (
    diagnostics,
    joint_state,
    line_image,
    planar_twist,
    planar_twist_with_covariance,
    to_nanoseconds,
    to_time,
)
from omni_ros.parameters import declare_configuration
from omni_ros.process import NodeError, Spinner, await_subscribers, run_process
from omni_ros.qos import LATCHED, RELIABLE
from omni_ros.startup import StartupConfiguration
from omni_sim.messages import camera_info, ground_truth, scene_markers
from omni_sim.run_progress import RunProgress
from omni_sim.simulator import Observation, Simulator, SimulatorConfiguration

FloatArray = NDArray[np.float64]

_SECOND = 1_000_000_000
_MARKER_PERIOD = 5  # control periods; a picture does not need every step


@dataclasses.dataclass(frozen=True, kw_only=True)
class LoopConfiguration(Configuration):
    """How the simulator keeps step with the nodes around it."""

    mode: str = parameter(
        "lockstep",
        description="Wait for each reply (lockstep), or pace the steps to the wall clock",
        choices=("lockstep", "real_time"),
    )
    reply_timeout: float = parameter(
        10.0, description="Lockstep: longest wait for a reply", unit="s", above=0.0
    )
    enable_timeout: float = parameter(
        0.05,
        description="Real time: age at which an enable no longer counts and all brakes are on",
        unit="s",
        above=0.0,
    )
    progress: bool = parameter(
        False, description="Write progress and the final counts as lines of JSON on stdout"
    )


class SimulatorNode(Node):
    """Publishes the simulation step by step and brakes with the enables it receives."""

    def __init__(self) -> None:
        super().__init__("simulator")
        self.startup = declare_configuration(self, StartupConfiguration)
        self.loop = declare_configuration(self, LoopConfiguration)
        self.configuration = declare_configuration(self, SimulatorConfiguration)
        self.simulator = Simulator(self.configuration)
        self._wheels = tuple(self.configuration.vehicle.wheels)
        self._all_on = np.ones(len(self._wheels))
        self._enable = self._all_on
        self._enable_stamp_ns = -1
        self._twist_stamp_ns = -1
        self.sent: dict[str, int] = {}
        self._make_publishers()
        self.create_subscription(JointState, "brake/enable", self._on_enable, RELIABLE)
        # Only its stamp is used: to tell which node is silent.
        self.create_subscription(
            TwistWithCovarianceStamped, "odometry/twist", self._on_twist, RELIABLE
        )

    def _make_publishers(self) -> None:
        create = self.create_publisher
        self._clock = create(Clock, "/clock", RELIABLE)
        self._wheel_states = create(JointState, "wheel_states", RELIABLE)
        self._pedal = create(JointState, "brake/pedal", RELIABLE)
        self._command = create(TwistStamped, "cmd_vel", RELIABLE)
        self._truth = create(Odometry, "ground_truth/odom", RELIABLE)
        self._velocity = create(TwistWithCovarianceStamped, "velocity_sensor/twist", RELIABLE)
        self._markers = create(MarkerArray, "markers", RELIABLE)
        self._diagnostics = create(DiagnosticArray, "/diagnostics", RELIABLE)
        self._told_overload = False
        self._lines = {}
        self._camera_infos = {}
        for name in self.configuration.sensors:
            self._lines[name] = create(Image, f"line_scan/{name}/lines", RELIABLE)
            info = create(CameraInfo, f"line_scan/{name}/camera_info", LATCHED)
            self._camera_infos[name] = info
        self.outputs = (
            self._wheel_states,
            self._pedal,
            *self._lines.values(),
        )

    def publish_camera_infos(self) -> None:
        """Say once what the line cameras see."""
        for name, sensor in self.configuration.sensors.items():
            self._send(self._camera_infos[name], camera_info(name, sensor))

    def publish(self, observation: Observation) -> None:
        """Publish one step; the pedal last, so that what it is answered with is under way."""
        stamp_ns = observation.stamp_ns
        self._send(self._clock, Clock(clock=to_time(stamp_ns)))
        for name, batch in observation.line_batches.items():
            self._send(self._lines[name], line_image(batch.stamp_ns, name, batch.lines))
        self._send(
            self._wheel_states,
            joint_state(
                stamp_ns,
                self._wheels,
                position=observation.wheel_angle,
                velocity=observation.wheel_speed,
                effort=observation.brake_torque,
            ),
        )
        self._send(
            self._velocity,
            planar_twist_with_covariance(
                stamp_ns, observation.velocity_sensor, observation.velocity_sensor_covariance
            ),
        )
        pedal = joint_state(stamp_ns, ("brake_pedal",), position=np.array([observation.pedal]))
        self._send(self._pedal, pedal)
        self._send(self._command, planar_twist(stamp_ns, observation.command))
        self._send(self._truth, ground_truth(observation))
        if (stamp_ns // self.simulator.control_period_ns) % _MARKER_PERIOD == 0:
            self._send(self._markers, scene_markers(self.configuration, observation))

        if self.simulator.overloaded != self._told_overload:
            self._tell_overload(stamp_ns)

    def _tell_overload(self, stamp_ns: int) -> None:
        """Say that wheels begin or cease to carry more than their tyre model covers."""
        self._told_overload = self.simulator.overloaded
        overload = self.simulator.overload
        words = overload.sentence() if overload is not None else ""
        if self._told_overload:
            self.get_logger().warning(words)
            status = diagnostics(stamp_ns, self.get_name(), 1, words, {"state": "overload"})
        else:
            status = diagnostics(
                stamp_ns, self.get_name(), 0, "the overload has ended", {"state": "ok"}
            )
        self._send(self._diagnostics, status)

    def enable_for(self, stamp_ns: int) -> FloatArray:
        """Return the enables (N,) to brake with; all on where they are missing or too old."""
        age = stamp_ns - self._enable_stamp_ns
        if self._enable_stamp_ns < 0 or age > self.loop.enable_timeout * _SECOND:
            return self._all_on
        return self._enable

    def has_reply(self, stamp_ns: int) -> bool:
        """Tell whether the enables of this step have come."""
        return self._enable_stamp_ns == stamp_ns

    def silent_node(self, stamp_ns: int) -> str:
        """Name the node whose message of this step is missing."""
        if self._twist_stamp_ns <= stamp_ns - self.simulator.control_period_ns:
            return "linescan_odometry (nothing on odometry/twist)"
        return "brake_assist (nothing on brake/enable)"

    def _send(self, publisher: object, message: object) -> None:
        publisher.publish(message)  # type: ignore[attr-defined]
        topic = publisher.topic_name  # type: ignore[attr-defined]
        self.sent[topic] = self.sent.get(topic, 0) + 1

    def _on_enable(self, message: JointState) -> None:
        values = dict(zip(message.name, message.effort, strict=False))
        if set(values) == set(self._wheels):
            enable = np.array([values[name] for name in self._wheels])
        else:
            self.get_logger().error(
                f"brake/enable names {', '.join(message.name) or 'no wheel'} and must name "
                f"{', '.join(self._wheels)}: all brakes on",
                throttle_duration_sec=1.0,
            )
            enable = self._all_on
        # What is not a number must not release a brake.
        self._enable = np.where(np.isfinite(enable), np.clip(enable, 0.0, 1.0), 1.0)
        self._enable_stamp_ns = to_nanoseconds(message.header.stamp)

    def _on_twist(self, message: TwistWithCovarianceStamped) -> None:
        self._twist_stamp_ns = to_nanoseconds(message.header.stamp)


def run(node: SimulatorNode, spinner: Spinner) -> None:
    """Simulate until the vehicle has stopped, the time is over, or a signal asks to stop.

    Raises:
        NodeError: in lockstep a reply does not come within the limit; names the silent node.
    """
    simulator = node.simulator
    await_subscribers(node.outputs, node.startup.subscribers, spinner, node.startup.match_timeout)
    node.publish_camera_infos()
    progress = RunProgress(node.configuration)
    started = time.monotonic()
    while not spinner.stop:
        observation = simulator.observe()
        node.publish(observation)
        progress.update(observation)
        if node.loop.progress and progress.is_news:
            print(json.dumps(progress.report()), flush=True)
        if node.loop.mode == "lockstep":
            # Also at the last step: what is recorded then does not depend on who is faster.
            _await_reply(node, spinner, observation.stamp_ns)
        if progress.finished:
            break
        if node.loop.mode == "real_time":
            _pace(spinner, started + (observation.stamp_ns + simulator.control_period_ns) / _SECOND)
        simulator.advance(node.enable_for(observation.stamp_ns))
    if node.loop.progress:
        wall = time.monotonic() - started
        final = {"finished": progress.outcome, "wall": wall, "sent": node.sent}
        overload = simulator.overload
        if overload is not None:
            final["overload"] = {"time": overload.time, "sentence": overload.sentence()}
        print(json.dumps(progress.report() | final), flush=True)


def _await_reply(node: SimulatorNode, spinner: Spinner, stamp_ns: int) -> None:
    timeout = node.loop.reply_timeout
    replied = spinner.spin_until(lambda: node.has_reply(stamp_ns), timeout)
    if not replied and not spinner.stop:
        raise NodeError(
            f"no reply at {stamp_ns / _SECOND:.3f} s within {timeout:g} s: "
            f"{node.silent_node(stamp_ns)} is silent"
        )


def _pace(spinner: Spinner, deadline: float) -> None:
    while not spinner.stop:
        remaining = deadline - time.monotonic()
        if remaining <= 0.0:
            return
        spinner.spin_once(remaining)


def main() -> None:
    """Run the node to its end or until SIGINT or SIGTERM."""
    sys.exit(run_process(SimulatorNode, run))


if __name__ == "__main__":
    main()
