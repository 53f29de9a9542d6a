"""Installs omni_bringup as an ament_python package."""

import sys

sys.path.insert(0, "../omni_platform")
from ament_package import install

install(
    nodes={
        "driver": "omni_bringup.drive.driver_node",
        "player": "omni_bringup.replay.player_node",
    },
    programs=["omni = omni_bringup.cli:main"],
    data=["drive/page/*", "commands/completion.bash"],
    shared=[("launch", ["launch/hardware.launch.py"])],
)
