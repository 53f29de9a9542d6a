"""A command can use ROS in its own process without a home folder."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

PROGRAM = """
import rclpy
from omni_bringup.cli import main
try:
    main(["list"])
finally:
    rclpy.init()
"""


@pytest.mark.parametrize("home", [{}, {"HOME": "/dev/null"}])
def test_ros_starts_in_a_command_without_a_usable_home(home: dict[str, str]) -> None:
    unset = {"HOME", "ROS_HOME", "ROS_LOG_DIR"}
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    finished = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=environment | home,
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
