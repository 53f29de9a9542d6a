"""Functions shared by the launch files; only this module requires `launch`.

`launch` is part of a ROS installation, but not of the ROS wheels. Therefore only launch files
import this module.
"""

import atexit
import shutil
from functools import partial
from typing import Any

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch_ros.actions import Node
from rich.console import Console

from omni_bringup.graph.launch_plan import ARGUMENTS, LaunchPlan, launch_plan
from omni_figures.comparison_table import ComparisonTable
from omni_ros.environment import REPORT_FILE_VARIABLE


def run_description(mode: str) -> LaunchDescription:
    """Return the arguments and the nodes of a launch file; the end of one node ends all nodes.

    A failed node or an invalid run ends the launch with an error.

    Args:
        mode: `LOCKSTEP`, `REAL_TIME` or `DRIVE`.
    """
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=words)
        for name, (default, words) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=partial(_start, mode))])


def _start(mode: str, context: Any) -> list[Any]:
    plan = launch_plan(mode, {name: context.launch_configurations[name] for name in ARGUMENTS})
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
        actions += [
            RegisterEventHandler(OnProcessExit(target_action=node, on_exit=on_exit)),
            node,
        ]
    return actions


def _on_exit(plan: LaunchPlan, ended: list[str], name: str, event: Any, _context: Any) -> list[Any]:
    """Handle the end of a node; an exception ends the launch with an error."""
    if event.returncode != 0:
        raise RuntimeError(f"{name} ended with exit code {event.returncode}")
    ended.append(name)
    if plan.is_run and len(ended) == len(plan.nodes):
        result = plan.finish()
        Console(width=100).print(ComparisonTable({result.variant: result.metrics}))
        if problem := result.still_moving():
            raise RuntimeError(problem)
    return [EmitEvent(event=Shutdown(reason=f"{name} has ended"))]
