"""Publisher of transforms, which requires `tf2_msgs`.

The Python packages of ROS that pip installs do not include `tf2_msgs`.
"""

import contextlib
from typing import Any

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile

from omni_platform.configuration import ConfigurationError
from omni_ros.messages import message_class
from omni_ros.qos import LATCHED

MISSING = "tf2_msgs is not installed: no live transforms"


class TransformPublisher:
    """Publishes poses on `/tf`, and the frames that are fixed to the platform on `/tf_static`.

    Args:
        node: the node that publishes.
        fixed: transforms of the frames that are fixed to the platform.
    """

    def __init__(self, node: Node, fixed: list[TransformStamped]) -> None:
        self._message: Any = None
        with contextlib.suppress(ConfigurationError):
            self._message = message_class("tf2_msgs/msg/TFMessage")
        self.available = self._message is not None
        if self._message is not None:
            self._moving = node.create_publisher(self._message, "/tf", QoSProfile(depth=100))
            self._fixed = node.create_publisher(self._message, "/tf_static", LATCHED)
            if fixed:
                self._fixed.publish(self._message(transforms=fixed))

    def follow(self, odometry: Odometry) -> None:
        """Publish the pose of an odometry message, if `tf2_msgs` is installed."""
        if self._message is None:
            return
        place = odometry.pose.pose.position
        transform = TransformStamped(header=odometry.header, child_frame_id=odometry.child_frame_id)
        transform.transform.translation.x = place.x
        transform.transform.translation.y = place.y
        transform.transform.translation.z = place.z
        transform.transform.rotation = odometry.pose.pose.orientation
        self._moving.publish(self._message(transforms=[transform]))
