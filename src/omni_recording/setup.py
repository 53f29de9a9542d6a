"""Installs omni_recording as an ament_python package."""

import sys

sys.path.insert(0, "../omni_platform")
from ament_package import install

install(programs=["recorder = omni_recording.start_recorder_node:main"])
