"""Start a vehicle that a person drives, as `omni drive` does.

The node `driver` logs the address of the driving page.

``ros2 launch omni_bringup drive.launch.py experiment:=small_stop``
"""

from launch import LaunchDescription

from omni_bringup.launching import run_description


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the nodes."""
    return run_description("drive")
