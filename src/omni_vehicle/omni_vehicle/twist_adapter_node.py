"""ROS node that converts the twist of any source to a stamped twist of base_link with covariance.

The README of this package describes the contract: topics, types and parameters.
"""

import math
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import Imu

from omni_core import topics
from omni_core.pose import PoseIntegrator
from omni_core.quantities import FloatArray
from omni_core.sensors import rotation_matrix
from omni_core.signals import UNMEASURED_VARIANCE
from omni_ros.frames import FrameConfiguration, frame_problem, prefix_frames
from omni_ros.messages import imu_vectors_of, planar_twist_with_covariance, to_nanoseconds, twist_of
from omni_ros.parameters import declare_configuration
from omni_ros.pose_publisher import PosePublisher
from omni_ros.process import run_process, spin_until_stopped
from omni_ros.qos import BEST_EFFORT, advertise, subscribe
from omni_ros.status import ERROR, OK, WARN, Status, StatusReporter
from omni_vehicle.twist_adapter import (
    INPUT_TYPES,
    CovarianceCompletion,
    Mounting,
    TwistAdapterConfiguration,
    YawRates,
)


class TwistAdapterNode(Node):
    """Receives the twist of a sensor, and publishes that of base_link with a covariance."""

    def __init__(self) -> None:
        super().__init__("twist_adapter")
        self._configuration = given = declare_configuration(self, TwistAdapterConfiguration)
        self._prefix = declare_configuration(self, FrameConfiguration).frame_prefix
        self._completion = CovarianceCompletion(given)
        self._mounting = Mounting(given)
        self._yaw_rates = YawRates(given.gyro_timeout)
        self._gyro_variance = given.gyro_deviation**2
        self._twist = advertise(self, topics.TWIST)
        # best effort is compatible with both kinds of publishers
        source = topics.Topic("input", INPUT_TYPES[given.input_type], "user's node")
        if given.sensor:
            source = topics.flow(given.sensor)
        subscribe(self, source, self._on_input, BEST_EFFORT, type_parameter="input_type")
        if given.gyro == "imu":
            turned = given.imu_rotation_deg
            self._imu_axes = rotation_matrix(turned) if turned else None
            subscribe(self, topics.IMU, self._on_imu, BEST_EFFORT)
        self._pose: PosePublisher | None = None
        if given.odom:
            odom = advertise(self, topics.ODOM)
            self._pose = PosePublisher(self, odom, self._prefix, PoseIntegrator())
            self._pose.publish_transforms({})
        self._status = StatusReporter(self, Status(ERROR, "no twist yet"))

    def _on_imu(self, message: Imu) -> None:
        reading, _ = imu_vectors_of(message, self._imu_axes)
        if math.isfinite(reading.yaw_rate):
            self._yaw_rates.add(reading.stamp_ns, reading.yaw_rate)
        variance = float(message.angular_velocity_covariance[8])
        self._gyro_variance = variance if variance > 0.0 else self._configuration.gyro_deviation**2

    def _on_input(self, message: Any) -> None:
        stamp_ns = to_nanoseconds(message.header.stamp)
        frame = message.child_frame_id if isinstance(message, Odometry) else message.header.frame_id
        if isinstance(message, TwistStamped):
            given = message.twist
            value = np.array([given.linear.x, given.linear.y, given.angular.z])
            covariance = np.zeros((3, 3))
        else:
            _, value, covariance, _ = twist_of(message)
        problem = self._frame_problem(frame)
        if self._configuration.gyro == "imu":
            problem = problem or self._use_gyro(stamp_ns, value, covariance)
        twist = self._completion.complete(value, covariance)
        problem = problem or twist.problem or self._unusable(twist.value, twist.covariance)
        if not problem:
            self._publish(stamp_ns, *self._mounting.base_twist(twist.value, twist.covariance))
        status = Status(ERROR if problem else OK, problem or "passes the twist on")
        if twist.unset and not problem:
            names = ", ".join(twist.unset)
            status = Status(
                WARN,
                f"{names} has been 0 in every message and has no variance: passed on as not "
                f"measured until it changes; the source must set it and its variance",
            )
        self._status.update(stamp_ns, status.message, status)

    def _frame_problem(self, frame: str) -> str:
        base_frame = self._configuration.base_frame
        checked = base_frame and not self._configuration.sensor
        return frame_problem(frame, self._prefix + base_frame) if checked else ""

    def _use_gyro(self, stamp_ns: int, value: FloatArray, covariance: FloatArray) -> str:
        """Replace the yaw rate of a twist by that of the IMU; return the reason if there is none.

        Args:
            stamp_ns: stamp of the twist [ns].
            value: (v_x, v_y, yaw rate) [m/s, m/s, rad/s], changed in place, shape (3,).
            covariance: covariance of `value`, changed in place, shape (3, 3).
        """
        yaw_rate = self._yaw_rates.at(stamp_ns)
        if math.isnan(yaw_rate):
            limit = self._configuration.gyro_timeout
            return f"no yaw rate on the topic imu within {limit:g} s of the twist"
        value[2] = yaw_rate
        covariance[2, :] = covariance[:, 2] = 0.0
        covariance[2, 2] = self._gyro_variance
        return ""

    def _unusable(self, value: FloatArray, covariance: FloatArray) -> str:
        """Return why a twist with a complete covariance cannot be used; empty if it can."""
        given = self._configuration
        if self._mounting.is_off_center and covariance[2, 2] >= UNMEASURED_VARIANCE:
            return (
                f"angular.z is not measured, but the twist at ({given.x:g}, {given.y:g}) m depends "
                "on it: set the parameter gyro to imu"
            )
        speed = math.hypot(value[0], value[1])
        if speed > given.maximum_speed > 0.0:
            return f"{speed:.2f} m/s exceeds maximum_speed"
        return ""

    def _publish(self, stamp_ns: int, value: FloatArray, covariance: FloatArray) -> None:
        output = planar_twist_with_covariance(stamp_ns, value, covariance)
        prefix_frames(output, self._prefix)
        self._twist.publish(output)
        if self._pose is not None:
            self._pose.publish(stamp_ns, value, covariance)


main = partial(run_process, TwistAdapterNode, spin_until_stopped)


if __name__ == "__main__":
    raise SystemExit(main())
