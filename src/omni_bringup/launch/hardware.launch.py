"""Start odometry and brake assistant of a real vehicle, as docs/real_vehicle.md describes.

``ros2 launch omni_bringup hardware.launch.py parameters:=/etc/my_vehicle`` starts them with the
parameter files in this folder, which ``./omni ros-params`` has written.
"""

import sys
from functools import partial
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler, TimerAction
from launch.event_handlers import OnProcessExit
from launch_ros.actions import Node

from omni_core.configuration import check_choice
from omni_runs.graph.hardware import ARGUMENTS, HardwareNode, hardware_nodes, starts_again

RESPAWN_DELAY = 1.0  # [s]


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the nodes."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=words)
        for name, (default, words) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def given_arguments(context: LaunchContext) -> dict[str, str]:
    """Return the values of the launch arguments, keyed by name.

    Raises:
        ConfigurationError: the command line of this launch file has an unknown argument.
    """
    # A launch file that includes this one has its own arguments, which are not checked here.
    directly = any(Path(word).name == Path(__file__).name for word in sys.argv)
    for word in context.argv if directly else ():
        name, assigned, _ = word.partition(":=")
        if assigned:
            check_choice("", name, ARGUMENTS)
    return {name: context.launch_configurations[name] for name in ARGUMENTS}


def start(context: LaunchContext) -> list[Any]:
    """Return the nodes that the launch arguments select, and the exit handler of each node."""
    given = given_arguments(context)
    nodes = hardware_nodes(given)
    for node in nodes:
        get_package_prefix(node.package)  # this call raises its errors before any node starts
    return [action for node in nodes for action in started(node, given)]


def started(node: HardwareNode, given: dict[str, str]) -> list[Any]:
    """Return the launch actions of a node: its exit handler, and the start of the node.

    Args:
        node: the node to start.
        given: values of the launch arguments, keyed by name.
    """
    process = Node(
        package=node.package,
        executable=node.executable,
        name=node.name,
        namespace=given["namespace"],
        parameters=[str(path) for path in node.files],
        remappings=list(node.remappings),
        ros_arguments=list(node.ros_arguments),
        output="screen",
    )
    on_exit = partial(ended, node, given)
    return [RegisterEventHandler(OnProcessExit(target_action=process, on_exit=on_exit)), process]


def ended(node: HardwareNode, given: dict[str, str], event: Any, context: Any) -> list[Any]:
    """Handle the end of a node: return the actions that restart it, or nothing at shutdown.

    Raises:
        RuntimeError: the node is not restarted; the error ends the launch.
    """
    if context.is_shutdown:
        return []
    if starts_again(event.returncode, given):
        return [TimerAction(period=RESPAWN_DELAY, actions=started(node, given))]
    reason = f"{node.name} ended with exit code {event.returncode}"
    raise RuntimeError(reason)
