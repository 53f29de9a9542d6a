"""Odometry and brake assistant of a real vehicle; docs/real_vehicle.md says how.

``ros2 launch omni_bringup hardware.launch.py parameters:=/etc/my_vehicle``, a folder that
``./omni ros-params`` has written.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from omni_bringup.graph.hardware import BRAKE_ASSIST, FRAMES, LOG_ONLY, ODOMETRY

ARGUMENTS = {
    "parameters": (None, "Folder of the parameter files"),
    "namespace": ("", "Namespace of the vehicle, such as robot1"),
    "frame_prefix": ("", "Before every frame, such as robot1/"),
    "twist": ("odometry/twist", "Topic of the body twist; another one starts no odometry"),
    "log_only": ("false", "true: decide and tell, but release no brake"),
    "robot_state_publisher": ("false", "true: tell the wheels' frames, from wheel_states"),
    "respawn": ("true", "Start a node that has died again; until then all brakes are on"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=words)
        for name, (default, words) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def start(context: LaunchContext) -> list[Node]:
    """Return the nodes that the arguments ask for."""
    given = context.launch_configurations
    folder = Path(given["parameters"]).resolve()
    shared = {
        "namespace": given["namespace"],
        "output": "screen",
        "respawn": given["respawn"] == "true",
        "respawn_delay": 1.0,
    }
    # Parameters given as mappings would become files that launch leaves in the temporary folder.
    prefix = ["-p", f"frame_prefix:={given['frame_prefix']}"] if given["frame_prefix"] else []
    # A file, as launch puts those after what stands on the command line: the last one holds.
    assistant = [BRAKE_ASSIST, *([LOG_ONLY] if given["log_only"] == "true" else [])]
    own = given["twist"] == "odometry/twist"
    nodes = []
    if own and (folder / f"{ODOMETRY}.yaml").exists():
        nodes.append(
            Node(
                package="linescan_odometry",
                executable="odometry",
                name=ODOMETRY,
                parameters=[str(folder / f"{ODOMETRY}.yaml")],
                ros_arguments=prefix,
                **shared,
            )
        )
    nodes.append(
        Node(
            package="omni_brake_assist",
            executable="brake_assist",
            name=BRAKE_ASSIST,
            parameters=[str(folder / f"{name}.yaml") for name in assistant],
            remappings=[] if own else [("odometry/twist", given["twist"])],
            **shared,
        )
    )
    if given["robot_state_publisher"] == "true":
        nodes.append(
            Node(
                package=FRAMES,
                executable=FRAMES,
                parameters=[str(folder / f"{FRAMES}.yaml")],
                ros_arguments=prefix,
                remappings=[("joint_states", "wheel_states")],
                **shared,
            )
        )
    return nodes
