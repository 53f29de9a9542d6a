"""Installs linescan_odometry as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(
    requires=["numpy", "omni_core", "rocket-fft"],
    nodes={
        "odometry": "linescan_odometry.odometry_node",
        "camera": "omni_vehicle.camera.camera_node",  # its package until release 0.1.0
    },
)
