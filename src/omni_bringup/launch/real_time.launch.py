"""Start a run paced to the wall clock, as `omni run --real-time` does.

``ros2 launch omni_bringup real_time.launch.py out:=/tmp/run``
"""

from launch import LaunchDescription

from omni_bringup.launching import run_description


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the nodes."""
    return run_description("real_time")
