"""ROS node that converts a body twist from any source to a stamped twist with covariance.

The README of this package describes the contract: topics, types and parameters.
"""

from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node

from omni_platform import topics
from omni_platform.configuration import Configuration, ConfigurationError, parameter
from omni_ros.messages import planar_twist_with_covariance, to_nanoseconds, twist_of
from omni_ros.parameters import declare_configuration
from omni_ros.process import run_process, spin_until_stopped
from omni_ros.qos import BEST_EFFORT, advertise, subscribe
from omni_ros.status import ERROR, OK, Status, StatusReporter

_TYPES = {
    "odometry": topics.ODOMETRY,
    "twist_stamped": topics.TWIST_STAMPED,
    "twist_with_covariance": topics.TWIST_WITH_COVARIANCE,
}


class TwistAdapterConfiguration(Configuration):
    """Message type, standard deviations and frame of the received body twist."""

    input_type: str = parameter(choices=tuple(_TYPES))
    """Message type of the topic 'input'"""
    deviation: tuple[float, ...] = parameter((), minimum=0.0, maximum=1000.0)
    """Standard deviations of v_x, v_y [m/s] and yaw rate [rad/s], which replace the covariance
    of the source; required if the source has none"""
    base_frame: str = parameter("base_link")
    """Frame that the message of the twist must name; empty for any frame"""

    def check_consistency(self) -> None:
        """Check that the standard deviations are valid."""
        if self.deviation and (len(self.deviation) != 3 or min(self.deviation) <= 0.0):
            raise ConfigurationError("deviation", "must be three numbers above 0")
        if self.input_type == "twist_stamped" and not self.deviation:
            raise ConfigurationError("deviation", "is needed: a TwistStamped has no covariance")


class TwistAdapterNode(Node):
    """Receives a body twist and publishes it with a covariance."""

    def __init__(self) -> None:
        super().__init__("twist_adapter")
        self._configuration = declare_configuration(self, TwistAdapterConfiguration)
        self._twist = advertise(self, topics.TWIST)
        # best effort is compatible with both kinds of publishers
        source = topics.Topic("input", _TYPES[self._configuration.input_type], "user's node")
        subscribe(self, source, self._on_input, BEST_EFFORT)
        self._status = StatusReporter(self, Status(ERROR, "no twist yet"))

    def _on_input(self, message: Any) -> None:
        stamp_ns = to_nanoseconds(message.header.stamp)
        frame = message.child_frame_id if isinstance(message, Odometry) else message.header.frame_id
        problem = ""
        if isinstance(message, TwistStamped):
            given = message.twist
            twist = np.array([given.linear.x, given.linear.y, given.angular.z])
            covariance = np.zeros((3, 3))
        else:
            _, twist, covariance, _ = twist_of(message)
        if self._configuration.deviation:
            covariance = np.diag(np.square(self._configuration.deviation))
        expected = self._configuration.base_frame
        if expected and frame != expected:
            problem = f"the twist is given in {frame!r}, not in {expected!r}"
        elif not (np.isfinite(twist).all() and np.isfinite(covariance).all()):
            problem = "twist or covariance is not finite"
        elif np.linalg.eigvalsh(covariance)[0] <= 0.0:
            problem = "the source has no covariance; set deviation"
        if not problem:
            self._twist.publish(planar_twist_with_covariance(stamp_ns, twist, covariance))
        words = Status(ERROR if problem else OK, problem or "passes the twist on")
        self._status.update(stamp_ns, problem, words)


main = partial(run_process, TwistAdapterNode, spin_until_stopped)


if __name__ == "__main__":
    raise SystemExit(main())
