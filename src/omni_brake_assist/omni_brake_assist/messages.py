"""Conversion of ROS messages to inputs of the brake assistant, and of decisions to messages."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from omni_brake_assist.conditions import Decision
from omni_platform import topics
from omni_platform.signals import ImuSample, PedalSample, TwistSample, WheelSample
from omni_ros.messages import joint_state, planar_twist_of, to_nanoseconds


def pedal_of(message: Any) -> PedalSample:
    """Return the pedal position in a `JointState`; NaN (full braking) if it is missing."""
    position = float(message.position[0]) if len(message.position) else math.nan
    return PedalSample(to_nanoseconds(message.header.stamp), position)


def twist_of(message: Any) -> TwistSample:
    """Return the body twist in a `TwistWithCovarianceStamped`."""
    return TwistSample(to_nanoseconds(message.header.stamp), *planar_twist_of(message))


def wheel_speeds_of(message: Any, wheels: Sequence[str]) -> WheelSample | None:
    """Return the wheel speeds in a `JointState`; None if the speed of a wheel is missing.

    Args:
        message: message that contains all wheels, in any order.
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


def decision_messages(decision: Decision, wheels: Sequence[str]) -> dict[str, Any]:
    """Return enables and errors of a decision as `JointState` messages, keyed by topic name."""
    stamp_ns = decision.stamp_ns
    return {
        topics.ENABLE.name: joint_state(stamp_ns, wheels, effort=decision.enable),
        topics.SLIDING.name: joint_state(stamp_ns, wheels, velocity=decision.error),
    }
