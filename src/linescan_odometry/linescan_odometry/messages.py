"""ROS messages to batches of lines."""

from __future__ import annotations

from sensor_msgs.msg import CameraInfo, Image

from linescan_odometry.measurements import LineBatch
from omni_platform.sensors import LineSensor
from omni_ros.messages import lines_of, to_nanoseconds

_SAME_SCALE = 0.005  # of a camera's own scale and the configured one


def line_batch_of(message: Image) -> LineBatch:
    """Return the lines of an image; one that holds none says why, and so counts as unmeasured."""
    stamp_ns = to_nanoseconds(message.header.stamp)
    try:
        return LineBatch(stamp_ns, lines_of(message))
    except ValueError as error:
        return LineBatch.unusable(stamp_ns, str(error))


def contradiction_of(message: CameraInfo, sensor: LineSensor) -> str:
    """Say in what a camera's own description differs from its configuration; empty if in nothing.

    A scale is compared only where one is given for a line, ``k[0]`` [px/m on the ground].
    """
    if message.width not in (0, sensor.pixels):
        return (
            f"camera_info says {message.width} px a line, the configuration {sensor.pixels} px: "
            f"set sensors.<name>.pixels"
        )
    scale = float(message.k[0])
    if message.height == 1 and scale > 0.0 and abs(scale * sensor.pixel_pitch - 1.0) > _SAME_SCALE:
        return (
            f"camera_info says {scale:.6g} px/m, the configuration {1.0 / sensor.pixel_pitch:.6g} "
            "px/m: set sensors.<name>.length"
        )
    return ""
