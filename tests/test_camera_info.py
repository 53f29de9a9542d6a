"""A camera whose ``camera_info`` differs from the configuration is named."""

from __future__ import annotations

import pytest
from sensor_msgs.msg import CameraInfo

from omni_core.sensors import LineSensor
from omni_ros.line_images import contradiction_of

CAMERA = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=1000, length=0.05)


@pytest.mark.parametrize(
    ("width", "height", "scale", "words"),
    [
        (1000, 1, 20_000.0, ""),
        (1000, 1, 20_050.0, ""),
        (1000, 1, 0.0, ""),
        (0, 0, 0.0, ""),  # a driver without calibration
        (1000, 480, 800.0, ""),  # an area camera's focal length
        (500, 1, 20_000.0, "width of 500 px, but 1000 px are configured"),
        (1000, 1, 19_000.0, "scale of 19000 px/m, but 20000 px/m are configured"),
    ],
)
def test_width_and_scale_are_compared(width: int, height: int, scale: float, words: str) -> None:
    info = CameraInfo(width=width, height=height)
    info.k[0] = scale
    found = contradiction_of(info, CAMERA)
    assert (words in found) if words else found == ""
