"""Publication of the pose that is integrated from measured twists, on `odom` and `/tf`."""

from collections.abc import Mapping

import numpy as np
from rclpy.node import Node

from omni_core import topics
from omni_core.pose import PoseIntegrator
from omni_core.quantities import FloatArray
from omni_core.sensors import Mount
from omni_ros import messages
from omni_ros.frames import MISSING, TransformPublisher, prefix_frames
from omni_ros.qos import advertise


class PosePublisher:
    """Integrates twists of a vehicle, and publishes each pose.

    Attributes:
        publisher: publisher of the topic `odom`.
    """

    def __init__(self, node: Node, prefix: str, pose: PoseIntegrator) -> None:
        """Create the publisher of the topic `odom`.

        Args:
            node: the node that publishes.
            prefix: prefix of all frame names.
            pose: integrator at the start of the integration.
        """
        self.publisher = advertise(node, topics.ODOM)
        self._node, self._prefix, self._pose = node, prefix, pose
        self._transforms: TransformPublisher | None = None

    def publish_transforms(self, sensors: Mapping[str, Mount]) -> None:
        """Also publish `odom` -> `base_link` on /tf from now on, and fixed frames on /tf_static.

        Args:
            sensors: sensors whose frames are fixed to the platform, keyed by the frames' names.
        """
        fixed = [
            messages.fixed_transform(name, np.array([sensor.x, sensor.y, sensor.heading]))
            for name, sensor in sensors.items()
        ]
        for transform in fixed:
            prefix_frames(transform, self._prefix)
        self._transforms = TransformPublisher(self._node, fixed)
        if not self._transforms.available:
            self._node.get_logger().debug(MISSING)

    def publish(self, stamp_ns: int, twist: FloatArray, covariance: FloatArray) -> None:
        """Integrate a twist of `base_link`, and publish the pose.

        Args:
            stamp_ns: stamp of the twist [ns].
            twist: v_x, v_y [m/s] and yaw rate [rad/s], shape (3,).
            covariance: covariance of the twist, in the squares of its units, shape (3, 3).
        """
        pose = self._pose.update(stamp_ns, twist, covariance)
        odometry = messages.planar_odometry(
            pose.stamp_ns, pose.value, pose.covariance, twist, covariance
        )
        prefix_frames(odometry, self._prefix)
        self.publisher.publish(odometry)
        if self._transforms is not None:
            self._transforms.follow(odometry)
