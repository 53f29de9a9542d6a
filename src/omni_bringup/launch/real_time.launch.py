"""A run paced to the wall clock, as `omni run --real-time`.

``ros2 launch omni_bringup real_time.launch.py out:=/tmp/run``
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from omni_bringup.graph.launch_plan import ARGUMENTS, REAL_TIME, planned_nodes


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes; the end of one ends all."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=words)
        for name, (default, words) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def start(context: LaunchContext) -> list[Node]:
    """Return the nodes that the arguments ask for."""
    given = {name: context.launch_configurations[name] for name in ARGUMENTS}
    return [
        Node(
            package=node.package,
            executable=node.executable,
            arguments=list(node.arguments),
            output="screen",
            on_exit=Shutdown(),
        )
        for node in planned_nodes(REAL_TIME, given)
    ]
