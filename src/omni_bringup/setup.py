"""Installs omni_bringup as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(
    commands={name: f"omni_bringup.commands.{name}" for name in ("completion", "doctor", "list")},
    programs=["omni = omni_bringup.cli:main"],
    data=["commands/completion.bash"],
    shared=[("launch", ["launch/hardware.launch.py"])],
)
