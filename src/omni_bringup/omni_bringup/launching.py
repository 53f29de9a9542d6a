"""Functions shared by the launch files; only this module requires `launch`.

`launch` is part of a ROS installation, but not of the ROS wheels from PyPI. Therefore only
launch files import this module.
"""

import atexit
import shutil
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch_ros.actions import Node
from rich.console import Console

from omni_bringup.graph.launch_plan import ARGUMENTS, LaunchPlan, launch_plan
from omni_figures.tables.comparison_table import ComparisonTable
from omni_platform.configuration import check_choice
from omni_ros.environment import REPORT_FILE_VARIABLE


def run_description(mode: str) -> LaunchDescription:
    """Return the arguments and the nodes of a launch file; the end of one node ends all nodes.

    A failed node or an invalid run ends the launch with an error.

    Args:
        mode: `LOCKSTEP`, `REAL_TIME` or `DRIVE`.
    """
    start = partial(_start, mode)
    return LaunchDescription([*declared(ARGUMENTS), OpaqueFunction(function=start)])


def declared(arguments: Mapping[str, tuple[str | None, str]]) -> list[DeclareLaunchArgument]:
    """Return declarations of launch arguments from pairs (default, description), keyed by name."""
    return [
        DeclareLaunchArgument(name, default_value=default, description=words)
        for name, (default, words) in arguments.items()
    ]


def given_arguments(file: str, known: Mapping[str, Any], context: Any) -> dict[str, str]:
    """Return the values of the known launch arguments, keyed by name.

    Args:
        file: name of the launch file.
        known: launch arguments, keyed by name.
        context: context of the launch.

    Raises:
        ConfigurationError: the command line of this launch file has an unknown argument.
    """
    # A launch file that includes this one has its own arguments, which are not checked here.
    directly = any(Path(word).name == file for word in sys.argv)
    for word in context.argv if directly else ():
        name, assigned, _ = word.partition(":=")
        if assigned:
            check_choice("", name, known)
    return {name: context.launch_configurations[name] for name in known}


def _start(mode: str, context: Any) -> list[Any]:
    plan = launch_plan(mode, given_arguments(f"{mode}.launch.py", ARGUMENTS, context))
    atexit.register(shutil.rmtree, plan.scratch, ignore_errors=True)
    actions: list[Any] = []
    ended: list[str] = []
    for process in plan.nodes:
        node = Node(
            package=process.package,
            executable=process.executable,
            arguments=list(process.arguments),
            additional_env={REPORT_FILE_VARIABLE: str(plan.reports(process.name))},
            output="screen",
        )
        on_exit = partial(_on_exit, plan, ended, process.name)
        actions += [RegisterEventHandler(OnProcessExit(target_action=node, on_exit=on_exit)), node]
    return actions


def _on_exit(plan: LaunchPlan, ended: list[str], name: str, event: Any, _context: Any) -> list[Any]:
    """Handle the end of a node.

    Args:
        plan: processes of the launch.
        ended: names of the nodes that have ended; this function appends `name`.
        name: name of the node whose end is handled.
        event: event of `launch` with the exit code.

    Raises:
        RuntimeError: the node failed, or the vehicle still moves; the launch ends with an error.
        WorkError: the run ended early, or data were lost.
    """
    if event.returncode != 0:
        raise RuntimeError(f"{name} ended with exit code {event.returncode}")
    ended.append(name)
    if plan.is_run and len(ended) == len(plan.nodes):
        result = plan.finish()
        Console(width=100).print(ComparisonTable({result.variant: result.metrics}))
        if problem := result.still_moving():
            raise RuntimeError(problem)
    return [EmitEvent(event=Shutdown(reason=f"{name} has ended"))]
