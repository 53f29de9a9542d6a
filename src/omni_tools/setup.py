"""Installs omni_tools as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(
    nodes={"driver": "omni_tools.drive.driver_node"},
    commands={
        "calibrate-sensors": "omni_tools.line_files.calibrate_command",
        "check-node": "omni_tools.node_check.command",
        "check-vehicle": "omni_tools.commissioning.command",
        "compare": "omni_tools.report.compare_command",
        "design-sensors": "omni_tools.placement.command",
        "drive": "omni_tools.drive.command",
        "estimate-load": "omni_tools.load_estimate.command",
        "fit-brakes": "omni_tools.brakes.command",
        "fit-tire": "omni_tools.tires.command",
        "limit": "omni_tools.limit.command",
        "lines": "omni_tools.line_files.commands",
        "nav2-polygons": "omni_tools.stopping_area.command",
        "new-vehicle": "omni_tools.vehicles.command",
        "report": "omni_tools.report.command",
        "ros-params": "omni_tools.ros_params.command",
        "show": "omni_tools.vehicles.show_command",
    },
    data=["drive/page/*", "report/page/*"],
)
