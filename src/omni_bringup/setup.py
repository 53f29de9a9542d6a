"""Installs omni_bringup as an ament_python package."""

import sys
from pathlib import Path

sys.path.insert(0, "../omni_core")
from ament_package import install

install(
    nodes={"driver": "omni_tools.drive.driver_node"},  # its package until release 0.1.0
    commands={name: f"omni_bringup.commands.{name}" for name in ("completion", "doctor", "list")},
    programs=["omni = omni_bringup.cli:main"],
    data=["commands/completion.bash"],
    shared=[("launch", sorted(str(path) for path in Path("launch").iterdir()))],
)
