"""Conversions between the arrays of the cores and standard messages."""

from __future__ import annotations

import importlib
import math
import struct
from array import array
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs import msg as geometry
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Header

from omni_platform.configuration import ConfigurationError
from omni_platform.quantities import SECOND_NS, FloatArray
from omni_platform.signals import UNMEASURED_VARIANCE

LineArray = NDArray[Any]  # uint8 or uint16
_Message = TypeVar("_Message")

BASE_FRAME = "base_link"
WORLD_FRAME = "odom"

_ENCODINGS: dict[str, np.dtype[Any]] = {"mono8": np.dtype("<u1"), "mono16": np.dtype("<u2")}
_STAMP_OFFSET = 4  # after the encapsulation header
_LITTLE_ENDIAN_STAMP = struct.Struct("<iI")
_BIG_ENDIAN_STAMP = struct.Struct(">iI")
_LENGTH = struct.Struct("<I")  # length of a list
_LITTLE_ENDIAN = b"\0\1\0\0"  # the first bytes of a serialized message
_UNMEASURED = UNMEASURED_VARIANCE * np.eye(6)
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


def planar_twist_of(message: geometry.TwistWithCovarianceStamped) -> tuple[FloatArray, FloatArray]:
    """Return the body twist (3,) [m/s, m/s, rad/s] in a message, and its covariance (3, 3)."""
    twist = message.twist.twist
    values = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
    return values, np.asarray(message.twist.covariance, dtype=np.float64)[_PLANAR]


class _Stamp(NamedTuple):
    sec: int
    nanosec: int


class _Header(NamedTuple):
    stamp: _Stamp
    frame_id: str


class LineImage(NamedTuple):
    """Fields of an `Image` message with camera lines, read from its serialized form."""

    header: _Header
    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: bytearray


def line_image(stamp_ns: int, frame: str, lines: LineArray) -> bytes:
    """Return a batch of lines as a serialized image; each row is a line, oldest first.

    This function serializes the message itself, so that the padding is zero and the recordings of
    equal runs are equal.

    Args:
        stamp_ns: stamp of the newest line [ns].
        frame: frame of the sensor.
        lines: gray values, shape (m, pixels), 8 or 16 bit.
    """
    encoding = "mono8" if lines.dtype == np.uint8 else "mono16"
    little = np.ascontiguousarray(lines, dtype=_ENCODINGS[encoding])
    written = _Cdr()
    written.stamp(stamp_ns)
    written.text(frame)
    written.numbers(*lines.shape)
    written.text(encoding)
    written.append(0)  # not big-endian
    written.numbers(lines.shape[1] * little.itemsize, little.nbytes)
    gap = bytes(-(len(written) + little.nbytes) % 4)
    return b"".join((_LITTLE_ENDIAN, written, little.data, gap))


def read_line_image(wire: bytes) -> LineImage | Image:
    """Return an image from its serialized form, four times as fast as rclpy.

    Raises:
        ValueError: the message is incomplete.
    """
    if not wire.startswith(_LITTLE_ENDIAN):
        return deserialize_message(wire, Image)
    try:
        *stamp, length = struct.unpack_from("<iII", wire, 4)
        frame, at = _text_at(wire, 16, length)
        height, width, length = struct.unpack_from("<III", wire, at)
        encoding, at = _text_at(wire, at + 12, length, gap=False)
        big, at = wire[at], at + 1
        step, size = struct.unpack_from("<II", wire, at + -at % 4)
    except (struct.error, IndexError):
        raise ValueError(f"an image of {len(wire)} bytes is cut off") from None
    # A copy is made because the kernels are compiled for writable arrays.
    data = bytearray(memoryview(wire)[at + -at % 4 + 8 :][:size])
    return LineImage(_Header(_Stamp(*stamp), frame), height, width, encoding, big, step, data)


def _text_at(wire: bytes, start: int, length: int, gap: bool = True) -> tuple[str, int]:
    """Return a text in a serialized message, and the byte offset of the field that follows it.

    Args:
        wire: the serialized message.
        start: byte offset of the text.
        length: number of bytes of the text with its terminating zero.
        gap: whether the padding up to a multiple of four bytes is skipped, because the next field
            is aligned.
    """
    end = start + length
    return wire[start : end - 1].decode(errors="replace"), end + (-end % 4 if gap else 0)


def camera_info(frame: str, pixels: int, length: float, width: float = 0.0) -> CameraInfo:
    """Return a message with the size and scale of a line camera.

    The image has one row. ``k[0]`` is the scale along the axis, in pixels per meter on the ground.
    ``k[4]`` is the scale across the axis, one pixel per width of the field of view. ``k[2]`` is the
    center [px].

    Args:
        frame: frame of the sensor.
        pixels: number of pixels per line.
        length: field of view along the axis [m]; 0 if unknown, which makes all scales zero, as for
            an uncalibrated camera in ROS.
        width: field of view across the axis [m]; 0 if unknown.
    """
    info = stamped(CameraInfo, 0, frame)
    info.height, info.width = 1, pixels
    if length == 0.0:
        return info
    along, across = pixels / length, 1.0 / width if width > 0.0 else 0.0
    center = (pixels - 1) / 2.0
    info.distortion_model, info.d = "plumb_bob", [0.0] * 5
    info.k = [along, 0.0, center, 0.0, across, 0.0, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    info.p = [along, 0.0, center, 0.0, 0.0, across, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    return info


def lines_of(message: Image | LineImage) -> LineArray:
    """Return the lines of an image, shape (height, width), if possible without copying them.

    Raises:
        ValueError: the encoding is not mono8 or mono16, or the size does not fit the data.
    """
    dtype = _ENCODINGS.get(message.encoding)
    if dtype is None:
        raise ValueError(f"the encoding {message.encoding!r} must be mono8 or mono16")
    if message.is_bigendian:
        dtype = dtype.newbyteorder(">")
    row = message.width * dtype.itemsize
    if message.step < row or len(message.data) < message.step * message.height:
        raise ValueError(
            f"an image of {message.height} lines of {message.step} bytes needs at least {row} "
            f"bytes a line and has {len(message.data)} bytes in all"
        )
    rows = np.frombuffer(message.data, np.uint8, message.step * message.height)
    pixels = rows.reshape(message.height, message.step)[:, :row].view(dtype)
    return np.ascontiguousarray(pixels).astype(dtype.newbyteorder("="), copy=False)


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
    written = _Cdr()
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
    return _LITTLE_ENDIAN + bytes(written) + bytes(-len(written) % 4)


class _Cdr(bytearray):
    """Serialized message (CDR, little endian) without its encapsulation header of four bytes."""

    def numbers(self, *values: int) -> None:
        for value in values:
            self.extend(bytes(-len(self) % 4) + value.to_bytes(4, "little"))

    def stamp(self, stamp_ns: int) -> None:
        stamp = to_time(stamp_ns)
        self.numbers(stamp.sec & 0xFFFFFFFF, stamp.nanosec)

    def text(self, text: str) -> None:
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
