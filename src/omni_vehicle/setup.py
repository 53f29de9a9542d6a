"""Installs omni_vehicle as an ament_python package."""

import sys

sys.path.insert(0, "../omni_platform")
from ament_package import install

install(
    requires=["numpy", "omni_platform"],
    programs=[
        "brake_adapter = omni_vehicle.start_brake_adapter_node:main",
        "twist_adapter = omni_vehicle.start_twist_adapter_node:main",
        "flow_sensor = omni_vehicle.start_flow_sensor_node:main",
    ],
)
