"""Start a run in lockstep, as `omni run` does: the nodes wait for each other in each step.

``ros2 launch omni_bringup lockstep.launch.py out:=/tmp/run``
"""

from launch import LaunchDescription

from omni_bringup.launching import run_description


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the nodes."""
    return run_description("lockstep")
