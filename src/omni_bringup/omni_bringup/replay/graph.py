"""A replay over real processes: player, the nodes themselves, recorder."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omni_bringup.graph import nodes as graph
from omni_bringup.graph import process_group as processes
from omni_bringup.graph.domain import reserved_domain
from omni_bringup.replay.plan import BRAKE_ASSIST, ODOMETRY, ReplayPlan, node_listeners
from omni_platform.topics import CLOCK
from omni_ros.environment import node_environment


def replay_over_graph(bag: Path, plan: ReplayPlan, folder: Path, rate: float) -> None:
    """Run the nodes of a plan on the recorded inputs and record their outputs.

    Args:
        bag: the recording.
        plan: nodes and topics.
        folder: rosbag2 folder to make for the results and the clock.
        rate: speed as a multiple of the recorded one, 0 for as fast as the nodes follow.

    Raises:
        ProcessError: a node ended, stopped sending or lost data; the message names it.
        NoFreeDomainError: all ROS domains are taken.
    """
    with reserved_domain() as domain, tempfile.TemporaryDirectory(prefix="omni-") as scratch:
        place = Path(scratch)
        topics = {CLOCK.path: CLOCK.type, **plan.outputs}
        with processes.process_group(node_environment(domain)) as group:
            recorder = group.start(graph.recorder(plan.configuration, folder, place, chosen=topics))
            _start_nodes(group, plan, place)
            player = group.start(graph.player(bag, plan.inputs, plan.outputs, rate, place))
            report = _follow(group, player)
        group.raise_if_failed()
        processes.check_counts(recorder.new_reports(), report["results"])


def _start_nodes(group: processes.ProcessGroup, plan: ReplayPlan, scratch: Path) -> None:
    if ODOMETRY in plan.nodes:
        listeners = node_listeners(plan, ODOMETRY)
        group.start(graph.odometry(plan.configuration, scratch, lockstep=True, listeners=listeners))
    if BRAKE_ASSIST in plan.nodes:
        listeners = node_listeners(plan, BRAKE_ASSIST)
        group.start(
            graph.brake_assist(plan.configuration, scratch, lockstep=True, listeners=listeners)
        )


def _follow(group: processes.ProcessGroup, player: processes.RunningProcess) -> Mapping[str, Any]:
    while processes.wait_for(player) is None:
        group.raise_if_ended(besides=player)
    reports = player.new_reports()
    if player.returncode != 0 or not reports:
        raise processes.ProcessError(processes.describe_end(player))
    return reports[-1]
