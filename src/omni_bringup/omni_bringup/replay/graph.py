"""A replay over real processes: player, the nodes themselves, recorder."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omni_bringup.graph import nodes as graph
from omni_bringup.graph.domain import reserved_domain
from omni_bringup.graph.process_group import (
    ProcessError,
    ProcessGroup,
    RunningProcess,
    describe_end,
    process_group,
    wait_for,
)
from omni_bringup.replay.plan import BRAKE_ASSIST, ODOMETRY, ReplayPlan, node_listeners
from omni_platform.topics import CLOCK
from omni_ros.environment import node_environment

_POLL = 0.05  # [s]


def replay_over_graph(bag: Path, plan: ReplayPlan, folder: Path, rate: float) -> None:
    """Run the nodes of a plan on the recorded inputs and record their outputs.

    Args:
        bag: the recording.
        plan: nodes and topics.
        folder: rosbag2 folder to make; holds the results and the clock.
        rate: speed as a multiple of the recorded one, 0 for as fast as the nodes follow.

    Raises:
        ProcessError: a node ended, stopped sending or lost data; the message names it.
        NoFreeDomainError: all ROS domains are taken.
    """
    with reserved_domain() as domain, tempfile.TemporaryDirectory(prefix="omni-") as scratch:
        place = Path(scratch)
        topics = {CLOCK.path: CLOCK.type, **plan.outputs}
        with process_group(node_environment(domain)) as group:
            recorder = group.start(graph.recorder(plan.configuration, folder, place, chosen=topics))
            _start_nodes(group, plan, place)
            player = group.start(graph.player(bag, plan.inputs, plan.outputs, rate, place))
            report = _follow(group, player)
        group.raise_if_failed()
        _check_counts(recorder, report)


def _start_nodes(group: ProcessGroup, plan: ReplayPlan, scratch: Path) -> None:
    if ODOMETRY in plan.nodes:
        listeners = node_listeners(plan, ODOMETRY)
        group.start(graph.odometry(plan.configuration, scratch, lockstep=True, listeners=listeners))
    if BRAKE_ASSIST in plan.nodes:
        listeners = node_listeners(plan, BRAKE_ASSIST)
        group.start(
            graph.brake_assist(plan.configuration, scratch, lockstep=True, listeners=listeners)
        )


def _follow(group: ProcessGroup, player: RunningProcess) -> Mapping[str, Any]:
    while wait_for(player, _POLL) is None:
        group.raise_if_ended(besides=player)
    reports = player.new_reports()
    if player.returncode != 0 or not reports:
        raise ProcessError(describe_end(player))
    return reports[-1]


def _check_counts(recorder: RunningProcess, report: Mapping[str, Any]) -> None:
    """Check that the recorder has stored every result that the player has received."""
    reports = recorder.new_reports()
    if not reports:
        raise ProcessError(describe_end(recorder))
    recorded: Mapping[str, int] = reports[-1]["recorded"]
    for topic, seen in report["results"].items():
        if recorded.get(topic, 0) < seen:
            raise ProcessError(f"the recorder kept {recorded.get(topic, 0)} of {seen} of {topic}")
