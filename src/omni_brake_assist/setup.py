"""Installs omni_brake_assist as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(
    requires=["numpy", "omni_core"],
    nodes={"brake_assist": "omni_brake_assist.brake_assist_node"},
)
