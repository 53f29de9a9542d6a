"""Conversion of ROS messages to inputs of the odometry, and of estimates to ROS messages."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, Image

from linescan_odometry.measurements import TwistEstimate
from linescan_odometry.sideslip import SideslipEstimate, angles
from omni_platform import topics
from omni_platform.sensors import LineSensor
from omni_platform.signals import Flow, LineBatch
from omni_ros.messages import (
    LineImage,
    joint_state,
    lines_of,
    planar_twist_with_covariance,
    to_nanoseconds,
)

_SAME_SCALE = 0.005  # limit on the relative difference between measured and configured camera scale


def line_batch_of(message: Image | LineImage) -> LineBatch:
    """Return the lines of an image; for an unusable image, a batch with a reason and no lines."""
    stamp_ns = to_nanoseconds(message.header.stamp)
    try:
        return LineBatch(stamp_ns, lines_of(message))
    except ValueError as error:
        return LineBatch.unusable(stamp_ns, str(error))


def flow_of(message: TwistWithCovarianceStamped) -> Flow:
    """Return the velocity that a flow sensor measured at its position, in the sensor's axes.

    The driver software of a sensor marks a missing measurement by NaN, or by a variance of at least
    1e6 m^2/s^2.
    """
    twist = message.twist.twist
    covariance = np.asarray(message.twist.covariance, np.float64).reshape(6, 6)[:2, :2]
    velocity = np.array([twist.linear.x, twist.linear.y])
    return Flow(to_nanoseconds(message.header.stamp), velocity, covariance.copy())


def contradiction_of(message: CameraInfo, sensor: LineSensor) -> str:
    """Return how the ``camera_info`` differs from a camera's configuration; empty if they agree.

    The scale ``k[0]`` [px/m on the ground] is compared only if the message contains one.
    """
    if message.width not in (0, sensor.pixels):
        return (
            f"camera_info has a width of {message.width} px, but {sensor.pixels} px are "
            "configured: set sensors.<name>.pixels"
        )
    scale = float(message.k[0])
    if message.height == 1 and scale > 0.0 and abs(scale * sensor.pixel_pitch - 1.0) > _SAME_SCALE:
        return (
            f"camera_info has a scale of {scale:.6g} px/m, but {1.0 / sensor.pixel_pitch:.6g} px/m "
            "are configured: set sensors.<name>.length"
        )
    return ""


def estimate_messages(
    estimate: TwistEstimate, sideslip: Mapping[str, SideslipEstimate]
) -> dict[str, Any]:
    """Return the messages with sideslip angles and twist, keyed by topic.

    The twist is the last entry, because other nodes wait for this message.
    """
    stamp_ns, messages = estimate.stamp_ns, {}
    if sideslip:
        angle = joint_state(stamp_ns, list(sideslip), position=angles(sideslip))
        messages[topics.SIDESLIP.name] = angle
    twist = planar_twist_with_covariance(stamp_ns, estimate.twist, estimate.covariance)
    return {**messages, topics.TWIST.name: twist}
