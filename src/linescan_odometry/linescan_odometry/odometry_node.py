"""ROS node that converts batches of lines to the body twist.

The README of this package describes the contract: topics, types, QoS settings, parameters and
timeouts.
"""

import math
from collections.abc import Iterable, Mapping
from copy import copy
from functools import partial
from typing import Any

from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, JointState

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import FlowReading, SensorReading
from linescan_odometry.odometry import TwistEstimate
from linescan_odometry.port import OdometryPort
from linescan_odometry.sideslip import SideslipEstimate, angles
from omni_core import topics
from omni_core.configuration import Configuration, parameter
from omni_core.pose import PoseIntegrator
from omni_core.sensors import LineSensor
from omni_core.signals import Flow, LineBatch
from omni_ros import line_images, messages
from omni_ros.frames import FrameConfiguration, prefix_frames
from omni_ros.parameters import declare_configuration
from omni_ros.pose_publisher import PosePublisher
from omni_ros.process import Spinner, StartupConfiguration, run_process, spin_until_stopped
from omni_ros.qos import BEST_EFFORT, LATCHED, RELIABLE, advertise, subscribe
from omni_ros.status import ERROR, OK, WARN, Status, StatusReporter

_WAITING_BATCHES = 2  # in real time, length of the queue of a camera
_ASSUMED = "sideways velocity not measured, but computed for an axle that does not slip"


class InterfaceConfiguration(Configuration):
    """Parameters for the odometry class, and for the inputs and outputs of the node."""

    own_odometry: str = parameter("")
    """Your own odometry class as `my_module:MyOdometry`, see docs/extending.md; empty for the
    line-scan odometry"""
    lockstep: bool = parameter(False)
    """Whether the node processes all batches. Otherwise, if it is slower than the cameras, it drops
    all batches but the newest ones, so that the twist is not late"""
    best_effort_cameras: bool = parameter(False)
    """Whether cameras may publish with best-effort QoS (sensor data); lines may then be lost, but
    are not delayed"""
    publish_tf: bool = parameter(True)
    """Whether to publish odom -> base_link on /tf and the frames of the cameras on /tf_static;
    requires tf2_msgs"""


class OdometryNode(Node):
    """Receives batches of lines and flow measurements, and publishes the twist."""

    def __init__(self) -> None:
        super().__init__("linescan_odometry")
        self.startup = declare_configuration(self, StartupConfiguration)
        configuration = declare_configuration(self, OdometryConfiguration)
        interface = declare_configuration(self, InterfaceConfiguration)
        self._prefix = declare_configuration(self, FrameConfiguration).frame_prefix
        self._odometry = OdometryPort(interface.own_odometry, configuration)
        self._odometry.warm_up()
        twist = advertise(self, topics.TWIST)
        self._estimates = {topics.TWIST.name: twist}
        pose = PoseIntegrator(configuration.maximum_speed, configuration.maximum_yaw_rate)
        self._pose = PosePublisher(self, advertise(self, topics.ODOM), self._prefix, pose)
        if interface.publish_tf:
            mounts = configuration.all_sensors.items()
            self._pose.publish_transforms({name: one for name, one in mounts if not one.carrier})
        sensors = ", ".join(configuration.all_sensors)
        self._status = StatusReporter(
            self, Status(ERROR, f"no lines yet; waiting for a batch from {sensors}")
        )
        self.outputs, self.further_outputs = (twist,), [self._pose.publisher]
        if configuration.sideslip:
            angles = advertise(self, topics.SIDESLIP)
            self._estimates[topics.SIDESLIP.name] = angles
            self.further_outputs.append(angles)
        qos = BEST_EFFORT if interface.best_effort_cameras else RELIABLE
        newest = copy(qos)
        newest.depth = qos.depth if interface.lockstep else _WAITING_BATCHES
        self._contradictions: dict[str, str] = {}
        for name, sensor in configuration.sensors.items():
            subscribe(self, topics.lines(name), partial(self._on_lines, name), newest, raw=True)
            received = partial(self._on_camera_info, name, sensor)
            subscribe(self, topics.camera_info(name), received, LATCHED)
        if configuration.is_steered:
            subscribe(self, topics.STEERING, self._on_steering, qos)
        for name in configuration.flow_sensors:
            subscribe(self, topics.flow(name), partial(self._on_flow, name), qos)

    def _on_lines(self, sensor: str, wire: bytes) -> None:
        try:
            batch = line_images.line_batch_of(line_images.read_line_image(wire))
        except (ValueError, RuntimeError) as error:
            self.get_logger().warning(
                f"{topics.lines(sensor).name}: ignored an invalid image: {error}",
                throttle_duration_sec=1.0,
            )
            return
        self._take(sensor, batch)

    def _on_flow(self, sensor: str, message: TwistWithCovarianceStamped) -> None:
        self._take(sensor, messages.flow_of(message))

    def _on_steering(self, message: JointState) -> None:
        angles = dict(zip(message.name, message.position, strict=False))
        stamp_ns = messages.to_nanoseconds(message.header.stamp)
        self._publish(self._odometry.steer(stamp_ns, angles))

    def _on_camera_info(self, name: str, sensor: LineSensor, message: CameraInfo) -> None:
        self._contradictions[name] = line_images.contradiction_of(message, sensor)

    def _take(self, sensor: str, batch: LineBatch | Flow) -> None:
        self._publish(self._odometry.take(sensor, batch))

    def _publish(
        self, estimates: Iterable[tuple[TwistEstimate, dict[str, SideslipEstimate]]]
    ) -> None:
        for estimate, sideslip in estimates:
            for topic, message in estimate_messages(estimate, sideslip).items():
                prefix_frames(message, self._prefix)
                self._estimates[topic].publish(message)
            self._pose.publish(estimate.stamp_ns, estimate.twist, estimate.covariance)
            self._report(estimate, sideslip)

    def _report(self, estimate: TwistEstimate, sideslip: Mapping[str, SideslipEstimate]) -> None:
        """Update the status of the sensors for the diagnostics."""
        each: dict[str, SensorReading | FlowReading] = {**estimate.readings, **estimate.flows}
        # A change of any of these values is reported.
        key = (
            *(reading.measured for reading in each.values()),
            estimate.assumed,
            bool(estimate.skid),
            *(wheel.measured for wheel in sideslip.values()),
            *self._contradictions.values(),
        )
        values = {
            name: reading.reason or reading.remark or f"correlation {reading.correlation:.3f}"
            for name, reading in estimate.readings.items()
        }
        values |= {name: reading.in_words() for name, reading in estimate.flows.items()}
        values |= {
            f"sideslip {name}": wheel.reason or f"{math.degrees(wheel.angle):.2f} deg"
            for name, wheel in sideslip.items()
        }
        blind = [name for name, reading in each.items() if not reading.measured]
        if estimate.assumed or estimate.skid:
            values["kinematics"] = estimate.skid or _ASSUMED
        unlike = {name: words for name, words in self._contradictions.items() if words}
        values |= {f"camera_info {name}": words for name, words in unlike.items()}
        words = "measuring" if estimate.measured else "the twist cannot be measured"
        if estimate.skid:
            words += ", the platform skids"
        if unlike:
            words += f", camera_info differs from the configuration of {', '.join(unlike)}"
        level = WARN if blind or estimate.skid or unlike else OK
        words += f", without {', '.join(blind)}" if blind else ""
        status = Status(level if estimate.measured else ERROR, words, values)
        self._status.update(estimate.stamp_ns, key, status)


def estimate_messages(
    estimate: TwistEstimate, sideslip: Mapping[str, SideslipEstimate]
) -> dict[str, Any]:
    """Return the messages with sideslip angles and twist, keyed by topic.

    The twist is the last entry, because other nodes wait for this message.
    """
    stamp_ns, answers = estimate.stamp_ns, {}
    if sideslip:
        angle = messages.joint_state(stamp_ns, list(sideslip), position=angles(sideslip))
        answers[topics.SIDESLIP.name] = angle
    twist = messages.planar_twist_with_covariance(stamp_ns, estimate.twist, estimate.covariance)
    return {**answers, topics.TWIST.name: twist}


def run(node: OdometryNode, spinner: Spinner) -> None:
    """Spin the node until a signal requests shutdown."""
    node.startup.await_subscribers(node.outputs, spinner)
    # Pose and angles are optional: wait only for the subscribers that already exist.
    for publisher in node.further_outputs:
        listeners = node.count_subscribers(publisher.topic_name)
        node.startup.await_subscribers((publisher,), spinner, listeners)
    spin_until_stopped(node, spinner)


main = partial(run_process, OdometryNode, run)


if __name__ == "__main__":
    raise SystemExit(main())
