"""ROS node that converts a body twist from any source to a stamped twist with covariance.

The README of this package describes the contract: topics, types and parameters.
"""

from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node

from omni_core import topics
from omni_core.configuration import ConfigurationError, parameter
from omni_ros.frames import FrameConfiguration, frame_problem, prefix_frames
from omni_ros.messages import (
    BASE_FRAME,
    planar_twist_with_covariance,
    to_nanoseconds,
    twist_of,
)
from omni_ros.parameters import declare_configuration
from omni_ros.process import run_process, spin_until_stopped
from omni_ros.qos import BEST_EFFORT, advertise, subscribe
from omni_ros.status import ERROR, OK, WARN, Status, StatusReporter
from omni_vehicle.twist_adapter import CovarianceCompletion, CovarianceConfiguration

_TYPES = {
    "odometry": topics.ODOMETRY,
    "twist_stamped": topics.TWIST_STAMPED,
    "twist_with_covariance": topics.TWIST_WITH_COVARIANCE,
}


class TwistAdapterConfiguration(CovarianceConfiguration):
    """Message type, frame and covariance of the received body twist."""

    input_type: str = parameter(choices=tuple(_TYPES))
    """Message type of the topic 'input'"""
    base_frame: str = parameter(BASE_FRAME)
    """Frame that the message of the twist must name, after the parameter `frame_prefix`; empty for
    any frame"""

    def check_consistency(self) -> None:
        """Check that the standard deviations are valid, and given if the source has none."""
        super().check_consistency()
        if self.input_type == "twist_stamped" and not self.deviation:
            raise ConfigurationError("deviation", "is needed: a TwistStamped has no covariance")


class TwistAdapterNode(Node):
    """Receives a body twist and publishes it with a covariance."""

    def __init__(self) -> None:
        super().__init__("twist_adapter")
        configuration = declare_configuration(self, TwistAdapterConfiguration)
        self._prefix = declare_configuration(self, FrameConfiguration).frame_prefix
        self._base_frame = configuration.base_frame
        self._completion = CovarianceCompletion(configuration)
        self._twist = advertise(self, topics.TWIST)
        # best effort is compatible with both kinds of publishers
        source = topics.Topic("input", _TYPES[configuration.input_type], "user's node")
        subscribe(self, source, self._on_input, BEST_EFFORT, type_parameter="input_type")
        self._status = StatusReporter(self, Status(ERROR, "no twist yet"))

    def _on_input(self, message: Any) -> None:
        stamp_ns = to_nanoseconds(message.header.stamp)
        frame = message.child_frame_id if isinstance(message, Odometry) else message.header.frame_id
        if isinstance(message, TwistStamped):
            given = message.twist
            value = np.array([given.linear.x, given.linear.y, given.angular.z])
            covariance = np.zeros((3, 3))
        else:
            _, value, covariance, _ = twist_of(message)
        twist = self._completion.complete(value, covariance)
        problem = self._base_frame and frame_problem(frame, self._prefix + self._base_frame)
        problem = problem or twist.problem
        if not problem:
            output = planar_twist_with_covariance(stamp_ns, twist.value, twist.covariance)
            prefix_frames(output, self._prefix)
            self._twist.publish(output)
        status = Status(ERROR if problem else OK, problem or "passes the twist on")
        if twist.unset and not problem:
            names = ", ".join(twist.unset)
            status = Status(
                WARN,
                f"{names} has been 0 in every message and has no variance: passed on as not "
                f"measured until it changes; the source must set it and its variance",
            )
        self._status.update(stamp_ns, status.message, status)


main = partial(run_process, TwistAdapterNode, spin_until_stopped)


if __name__ == "__main__":
    raise SystemExit(main())
