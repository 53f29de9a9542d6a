"""Installs linescan_odometry as an ament_python package."""

import sys

sys.path.insert(0, "../omni_platform")
from ament_package import install

install(
    requires=["numpy", "omni_platform", "rocket-fft", "scipy"],
    programs=[
        "odometry = linescan_odometry.start_odometry_node:main",
        "camera = linescan_odometry.start_camera_node:main",
    ],
)
