"""Installs omni_recording as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(
    nodes={"recorder": "omni_recording.recorder_node"},
    commands={"bag": "omni_recording.commands"},
)
