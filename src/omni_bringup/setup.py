"""Installs omni_bringup as an ament_python package."""

import sys
from pathlib import Path

sys.path.insert(0, "../omni_platform")
from ament_package import install

# The configuration is installed too, so that launch files find it from any folder.
CONFIG = sorted(path for path in Path("../../config").iterdir() if path.is_dir())

install(
    nodes={
        "driver": "omni_bringup.drive.driver_node",
        "player": "omni_bringup.replay.player_node",
    },
    programs=["omni = omni_bringup.cli:main"],
    data=["drive/page/*", "commands/completion.bash"],
    shared=[
        ("launch", sorted(map(str, Path("launch").glob("*.launch.py")))),
        *((f"config/{folder.name}", sorted(map(str, folder.glob("*.yaml")))) for folder in CONFIG),
    ],
)
