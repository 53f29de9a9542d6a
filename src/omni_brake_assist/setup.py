"""Installs omni_brake_assist as an ament_python package."""

import sys

sys.path.insert(0, "../omni_platform")
from ament_package import install

install(
    requires=["numpy", "omni_platform"],
    nodes={"brake_assist": "omni_brake_assist.brake_assist_node"},
)
