"""Conversion of ROS messages to inputs of the brake assistant."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from omni_platform.signals import ImuSample, WheelSample
from omni_ros.messages import to_nanoseconds


def wheel_speeds_of(message: Any, wheels: Sequence[str]) -> WheelSample | None:
    """Return the wheel speeds in a `JointState`; None if the speed of a wheel is missing.

    Args:
        message: contains all wheels, in any order.
        wheels: names of the wheels in the order of the result.
    """
    if len(message.velocity) != len(message.name):
        return None
    speeds = dict(zip(message.name, message.velocity, strict=True))
    stamp_ns = to_nanoseconds(message.header.stamp)
    return WheelSample(stamp_ns, np.array([float(speeds[name]) for name in wheels]))


def imu_reading_of(message: Any) -> ImuSample:
    """Return yaw rate and specific force of a `sensor_msgs/Imu` with the axes of `base_link`."""
    force = message.linear_acceleration
    return ImuSample(
        to_nanoseconds(message.header.stamp),
        float(message.angular_velocity.z),
        np.array([force.x, force.y]),
    )
