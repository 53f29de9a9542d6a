"""Messages of line cameras: images whose rows are lines, and the scale of a camera."""

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image

from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch
from omni_ros.messages import LITTLE_ENDIAN, Cdr, stamped, to_nanoseconds

LineArray = NDArray[Any]  # uint8 or uint16

_ENCODINGS: dict[str, np.dtype[Any]] = {"mono8": np.dtype("<u1"), "mono16": np.dtype("<u2")}
_SAME_SCALE = 0.005  # limit on the relative difference between measured and configured camera scale


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
    written = Cdr()
    written.stamp(stamp_ns)
    written.text(frame)
    written.numbers(*lines.shape)
    written.text(encoding)
    written.append(0)  # not big-endian
    written.numbers(lines.shape[1] * little.itemsize, little.nbytes)
    gap = bytes(-(len(written) + little.nbytes) % 4)
    return b"".join((LITTLE_ENDIAN, written, little.data, gap))


def read_line_image(wire: bytes) -> LineImage | Image:
    """Return an image from its serialized form, four times as fast as rclpy.

    Raises:
        ValueError: the message is incomplete.
    """
    if not wire.startswith(LITTLE_ENDIAN):
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


def line_batch_of(message: Image | LineImage) -> LineBatch:
    """Return the lines of an image; for an unusable image, a batch with a reason and no lines."""
    stamp_ns = to_nanoseconds(message.header.stamp)
    try:
        return LineBatch(stamp_ns, lines_of(message))
    except ValueError as error:
        return LineBatch.unusable(stamp_ns, str(error))


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
