"""Installs linescan_odometry as an ament_python package."""

import sys

sys.path.insert(0, "../omni_platform")
from ament_package import install

install(
    requires=["numpy", "omni_platform", "rocket-fft"],
    nodes={
        "odometry": "linescan_odometry.odometry_node",
        "camera": "linescan_odometry.camera.camera_node",
    },
)
