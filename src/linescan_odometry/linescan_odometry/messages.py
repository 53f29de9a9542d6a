"""ROS messages to batches of lines."""

from __future__ import annotations

from sensor_msgs.msg import Image

from linescan_odometry.measurements import LineBatch
from omni_ros.messages import lines_of, to_nanoseconds


def line_batch_of(message: Image) -> LineBatch:
    """Return the lines of an image; one that holds none says why, and so counts as unmeasured."""
    stamp_ns = to_nanoseconds(message.header.stamp)
    try:
        return LineBatch(stamp_ns, lines_of(message))
    except ValueError as error:
        return LineBatch.unusable(stamp_ns, str(error))
