"""Conversions between the arrays of the cores and standard messages."""

from __future__ import annotations

import importlib
import math
import struct
from array import array
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs import msg as geometry
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from omni_core import signals
from omni_core.configuration import ConfigurationError
from omni_core.quantities import SECOND_NS, FloatArray
from omni_core.topics import JOINT_STATE, Topic

_Message = TypeVar("_Message")

BASE_FRAME = "base_link"
WORLD_FRAME = "odom"
LITTLE_ENDIAN = b"\0\1\0\0"
"""The first bytes of a serialized message in little endian."""

_STAMP_OFFSET = 4  # after the encapsulation header
_LITTLE_ENDIAN_STAMP = struct.Struct("<iI")
_BIG_ENDIAN_STAMP = struct.Struct(">iI")
_LENGTH = struct.Struct("<I")  # length of a list
_UNMEASURED = signals.UNMEASURED_VARIANCE * np.eye(6)
# Indices of the covariances of (v_x, v_y, yaw rate) in the flat covariance of a message.
_PLANAR = np.array([[6 * row + column for column in (0, 1, 5)] for row in (0, 1, 5)])


def message_class(kind: str, key: str = "type") -> Any:
    """Return the class of a message type, such as ``sensor_msgs/msg/Image``.

    Raises:
        ConfigurationError: the type is not installed; the error names `key`.
    """
    package, _, name = kind.rpartition("/msg/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, ValueError):
        raise ConfigurationError(
            key, f"{kind!r} is not an installed message type, such as sensor_msgs/msg/Image"
        ) from None


def to_time(stamp_ns: int) -> Time:
    """Return a stamp [ns] as the stamp of a message."""
    return Time(sec=stamp_ns // SECOND_NS, nanosec=stamp_ns % SECOND_NS)


def to_nanoseconds(stamp: Time) -> int:
    """Return the stamp of a message in [ns]."""
    return _nanoseconds(int(stamp.sec), int(stamp.nanosec))


def _nanoseconds(seconds: int, nanoseconds: int) -> int:
    """Return the sum [ns] of the two parts of a stamp.

    If `nanoseconds` is 1e9 or more, it is invalid and counts as the end of the second.
    """
    return seconds * SECOND_NS + min(nanoseconds, SECOND_NS - 1)


def leading_stamp(data: bytes, of_list: bool = False) -> int | None:
    """Return the stamp [ns] with which a serialized message begins.

    Args:
        data: message in CDR with its encapsulation header; the message type must begin with a
            `builtin_interfaces/Time`.
        of_list: whether the message begins with a list of such messages instead; if so, the stamp
            of the first one is returned.

    Returns:
        The stamp; None if the message is too short, or if the stamp is negative, because a
        recording cannot contain a negative stamp.
    """
    offset = _STAMP_OFFSET + (_LENGTH.size if of_list else 0)
    if len(data) < offset + _LITTLE_ENDIAN_STAMP.size:
        return None
    # The second byte of the encapsulation header is odd for little endian, in every version.
    layout = _LITTLE_ENDIAN_STAMP if data[1] & 1 else _BIG_ENDIAN_STAMP
    seconds, nanoseconds = layout.unpack_from(data, offset)
    return _nanoseconds(seconds, nanoseconds) if seconds >= 0 else None


def stamped(kind: type[_Message], stamp_ns: int, frame: str = "") -> _Message:
    """Return a new message whose header contains a stamp [ns] and a frame.

    A message always creates a header of its own. Filling in this header is faster than creating a
    second header and passing it to the message.
    """
    message = kind()
    head: Header = message.header  # type: ignore[attr-defined]
    head.stamp.sec, head.stamp.nanosec = divmod(stamp_ns, SECOND_NS)
    head.frame_id = frame
    return message


def joint_state(
    stamp_ns: int,
    names: Sequence[str],
    *,
    position: FloatArray | None = None,
    velocity: FloatArray | None = None,
    effort: FloatArray | None = None,
) -> JointState:
    """Return a `JointState` message for K named joints.

    Args:
        stamp_ns: stamp [ns].
        names: names of the joints.
        position: positions, shape (K,), in the unit that the topic requires; None leaves the field
            empty.
        velocity: velocities, shape (K,), in the unit that the topic requires; None leaves the field
            empty.
        effort: efforts, shape (K,), in the unit that the topic requires; None leaves the field
            empty.
    """
    message = stamped(JointState, stamp_ns)
    message.name = names
    if position is not None:
        message.position = _doubles(position)
    if velocity is not None:
        message.velocity = _doubles(velocity)
    if effort is not None:
        message.effort = _doubles(effort)
    return message


def packed(topic: Topic, sample: Any, wheels: Sequence[str]) -> Any:
    """Return the signals of a plain topic in a sample of its publisher as a message.

    Args:
        topic: topic with `is_plain`.
        sample: sample with a stamp and with the attributes that the signals name, such as the
            observation of the simulator.
        wheels: names of the wheels in the order of the values.
    """
    values = {one.field: getattr(sample, one.attribute or one.name) for one in topic.signals}
    if topic.type == JOINT_STATE:
        return joint_state(sample.stamp_ns, topic.joints or wheels, **values)
    (twist,) = values.values()
    return planar_twist(sample.stamp_ns, twist)


def planar_twist(stamp_ns: int, twist: FloatArray) -> geometry.TwistStamped:
    """Return a body twist (v_x, v_y, yaw rate) [m/s, m/s, rad/s] in `base_link` as a message."""
    message = stamped(geometry.TwistStamped, stamp_ns, BASE_FRAME)
    _set_planar(message.twist, twist)
    return message


def planar_twist_with_covariance(
    stamp_ns: int, twist: FloatArray, covariance: FloatArray
) -> geometry.TwistWithCovarianceStamped:
    """Return a message with a body twist and its covariance in `base_link`.

    Args:
        stamp_ns: stamp [ns].
        twist: (v_x, v_y, yaw rate) [m/s, m/s, rad/s], shape (3,).
        covariance: covariance of the twist, in the squares of its units, shape (3, 3).
    """
    message = stamped(geometry.TwistWithCovarianceStamped, stamp_ns, BASE_FRAME)
    _set_planar(message.twist.twist, twist)
    message.twist.covariance = _spatial(covariance)
    return message


def planar_odometry(
    stamp_ns: int,
    pose: FloatArray,
    pose_covariance: FloatArray,
    twist: FloatArray,
    twist_covariance: FloatArray,
) -> Odometry:
    """Return a message with a pose in `odom` and a twist in `base_link`.

    Args:
        stamp_ns: stamp [ns].
        pose: x, y [m] and yaw [rad], shape (3,).
        pose_covariance: covariance of the pose, in the squares of its units, shape (3, 3).
        twist: v_x, v_y [m/s] and yaw rate [rad/s], shape (3,); NaN becomes zero.
        twist_covariance: covariance of the twist, in the squares of its units, shape (3, 3).
    """
    message = stamped(Odometry, stamp_ns, WORLD_FRAME)
    message.child_frame_id = BASE_FRAME
    message.pose.pose = planar_pose(pose)
    message.pose.covariance = _spatial(pose_covariance)
    _set_planar(message.twist.twist, np.where(np.isfinite(twist), twist, 0.0))
    message.twist.covariance = _spatial(twist_covariance)
    return message


def planar_pose(pose: FloatArray) -> geometry.Pose:
    """Return x, y [m] and yaw [rad] as a pose message with zero height."""
    x, y, yaw = (float(value) for value in pose)
    turn = geometry.Quaternion(z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))
    return geometry.Pose(position=geometry.Point(x=x, y=y), orientation=turn)


def planar_pose_of(pose: geometry.Pose) -> FloatArray:
    """Return x, y [m] and yaw [rad] of a pose, shape (3,)."""
    place, turn = pose.position, pose.orientation
    yaw = math.atan2(
        2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z)
    )
    return np.array([place.x, place.y, yaw])


def fixed_transform(frame: str, pose: FloatArray) -> geometry.TransformStamped:
    """Return the transform of a frame that is fixed in `base_link` at x, y [m] and yaw [rad]."""
    place = planar_pose(pose)
    message = stamped(geometry.TransformStamped, 0, BASE_FRAME)
    message.child_frame_id = frame
    message.transform.translation.x = place.position.x
    message.transform.translation.y = place.position.y
    message.transform.rotation = place.orientation
    return message


def pedal_of(message: Any) -> signals.PedalSample:
    """Return the pedal position in a `JointState`; NaN (full braking) if it is missing."""
    position = float(message.position[0]) if len(message.position) else math.nan
    return signals.PedalSample(to_nanoseconds(message.header.stamp), position)


def twist_of(message: Any) -> signals.TwistSample:
    """Return the body twist in a `TwistWithCovarianceStamped`."""
    twist = message.twist.twist
    values = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
    covariance = np.asarray(message.twist.covariance, dtype=np.float64)[_PLANAR]
    return signals.TwistSample(to_nanoseconds(message.header.stamp), values, covariance)


def wheel_speeds_of(message: Any, wheels: Sequence[str]) -> signals.WheelSample | None:
    """Return the wheel speeds in a `JointState`; None if the speed of a wheel is missing.

    Args:
        message: message that contains all wheels, in any order.
        wheels: names of the wheels in the order of the result.
    """
    if len(message.velocity) != len(message.name):
        return None
    speeds = dict(zip(message.name, message.velocity, strict=True))
    stamp_ns = to_nanoseconds(message.header.stamp)
    return signals.WheelSample(stamp_ns, np.array([float(speeds[name]) for name in wheels]))


def imu_reading_of(message: Any) -> signals.ImuSample:
    """Return yaw rate and specific force of a `sensor_msgs/Imu` with the axes of `base_link`."""
    return imu_vectors_of(message)[0]


def imu_vectors_of(message: Any, axes: FloatArray | None = None) -> tuple[signals.ImuSample, float]:
    """Return the reading in a `sensor_msgs/Imu`, and its specific force upwards [m/s^2].

    Args:
        message: message of an IMU.
        axes: matrix from the axes of the message to those of `base_link`, shape (3, 3); None for
            equal axes.
    """
    rate, force = (
        np.array([vector.x, vector.y, vector.z])
        for vector in (message.angular_velocity, message.linear_acceleration)
    )
    if axes is not None:
        rate, force = axes @ rate, axes @ force
    stamp_ns = to_nanoseconds(message.header.stamp)
    return signals.ImuSample(stamp_ns, float(rate[2]), force[:2]), float(force[2])


def flow_of(message: Any) -> signals.Flow:
    """Return the velocity that a flow sensor measured at its position, in the sensor's axes.

    The driver software of a sensor marks a missing measurement by NaN, or by a variance of at least
    1e6 m^2/s^2.
    """
    twist = message.twist.twist
    covariance = np.asarray(message.twist.covariance, dtype=np.float64).reshape(6, 6)[:2, :2]
    velocity = np.array([twist.linear.x, twist.linear.y])
    return signals.Flow(to_nanoseconds(message.header.stamp), velocity, covariance.copy())


def diagnostics(
    stamp_ns: int, name: str, level: int, message: str, values: Mapping[str, str]
) -> bytes:
    """Return a `DiagnosticArray` with the status of one component, serialized in CDR.

    The padding of the result is zero. The middleware would not initialize the padding, so
    recordings of equal runs would differ.

    Args:
        stamp_ns: stamp [ns].
        name: name of the component.
        level: 0 OK, 1 warning, 2 error or 3 stale.
        message: one line of text.
        values: details as texts, keyed by name.
    """
    written = Cdr()
    written.stamp(stamp_ns)
    written.text("")  # frame
    written.numbers(1)  # component
    written.append(level)
    for text in (name, message, name):
        written.text(text)
    written.numbers(len(values))
    for pair in values.items():
        for text in pair:
            written.text(text)
    return LITTLE_ENDIAN + bytes(written) + bytes(-len(written) % 4)


class Cdr(bytearray):
    """Serialized message (CDR, little endian) without its encapsulation header of four bytes."""

    def numbers(self, *values: int) -> None:
        """Append unsigned integers of four bytes, each aligned to four bytes."""
        for value in values:
            self.extend(bytes(-len(self) % 4) + value.to_bytes(4, "little"))

    def stamp(self, stamp_ns: int) -> None:
        """Append a stamp [ns] as seconds and nanoseconds."""
        stamp = to_time(stamp_ns)
        self.numbers(stamp.sec & 0xFFFFFFFF, stamp.nanosec)

    def text(self, text: str) -> None:
        """Append a text with its length and a terminating zero."""
        encoded = text.encode() + b"\0"
        self.numbers(len(encoded))
        self.extend(encoded)


def _doubles(values: FloatArray) -> array[float]:
    return array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())


def _spatial(covariance: FloatArray) -> FloatArray:
    """Return a planar covariance, shape (3, 3), as the covariance in a message, shape (36,).

    The planar axes are x, y and rotation about z. The other three axes get the variance of
    unmeasured values, because a node that fuses the message, such as `robot_localization`, would
    treat a variance of zero as an exact measurement.
    """
    values = _UNMEASURED.flatten()
    values[_PLANAR] = covariance
    return values


def _set_planar(twist: object, values: FloatArray) -> None:
    v_x, v_y, yaw_rate = (float(value) for value in values)
    twist.linear.x = v_x  # type: ignore[attr-defined]
    twist.linear.y = v_y  # type: ignore[attr-defined]
    twist.angular.z = yaw_rate  # type: ignore[attr-defined]
