"""Names of frames with the prefix of a vehicle, and transforms between frames.

Transforms require `tf2_msgs`, which the Python packages of ROS that pip installs do not include.
"""

import contextlib
from typing import Any

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_ros.messages import message_class
from omni_ros.qos import LATCHED

MISSING = "tf2_msgs is not installed: no live transforms"


class FrameConfiguration(Configuration):
    """Names of the frames in the messages of a node."""

    frame_prefix: str = parameter("")
    """Prefix of all frame names, such as robot1/, so that several vehicles can share one /tf; must
    equal the parameter `frame_prefix` of robot_state_publisher"""


def prefix_frames(message: Any, prefix: str) -> None:
    """Put a prefix before each frame that a message names.

    Args:
        message: message, changed in place; frames are named in its header, or in a list of markers
            or transforms.
        prefix: prefix such as ``robot1/``; an empty prefix changes nothing.
    """
    if not prefix:
        return
    for part in (message, *getattr(message, "markers", ()), *getattr(message, "transforms", ())):
        if hasattr(part, "header") and part.header.frame_id:
            part.header.frame_id = prefix + part.header.frame_id
        if hasattr(part, "child_frame_id"):
            part.child_frame_id = prefix + part.child_frame_id


def frame_problem(frame: str, expected: str) -> str:
    """Return a sentence if a twist is given in another frame than the expected one, else ''."""
    if frame == expected:
        return ""
    return (
        f"the twist is given in {frame!r}, not in {expected!r}: transform it, or, if both frames "
        "have the same position and axes, correct the parameters base_frame and frame_prefix"
    )


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
