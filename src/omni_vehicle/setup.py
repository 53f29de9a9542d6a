"""Installs omni_vehicle as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

NODES = ("brake_adapter", "twist_adapter", "flow_sensor")

install(
    requires=["numpy", "omni_core"],
    nodes={
        "camera": "omni_vehicle.camera.camera_node",
        **{name: f"omni_vehicle.{name}_node" for name in NODES},
    },
)
