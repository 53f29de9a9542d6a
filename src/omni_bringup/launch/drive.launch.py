"""Start a vehicle that a person drives, as `omni drive` does; the driver logs the page's address.

``ros2 launch omni_bringup drive.launch.py experiment:=small_stop``
"""

from launch import LaunchDescription

from omni_bringup.launching import run_description


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    return run_description("drive")
