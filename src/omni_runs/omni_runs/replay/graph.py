"""Replay as a graph of node processes: player, replayed nodes, recorder."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omni_core.topics import CLOCK
from omni_ros.environment import node_environment
from omni_runs.graph import nodes as graph
from omni_runs.graph import process_group as processes
from omni_runs.graph.domain import reserved_domain
from omni_runs.replay.plan import BRAKE_ASSIST, ODOMETRY, ReplayPlan, node_listeners


def replay_over_graph(bag: Path, plan: ReplayPlan, folder: Path, rate: float) -> int:
    """Run the nodes of a plan on the recorded inputs and record their outputs.

    Args:
        bag: recording to replay.
        plan: nodes and topics of the replay.
        folder: empty folder for the rosbag2 recording of the results and the clock.
        rate: speed as a multiple of the recorded one; 0 for as fast as the nodes can follow.

    Returns:
        Number of rounds that the player sent although the result of an earlier round was missing.

    Raises:
        ProcessError: a node ended, stopped sending or lost data; the message names it.
        NoFreeDomainError: all ROS domains are in use.
    """
    with reserved_domain() as domain, tempfile.TemporaryDirectory(prefix="omni-") as scratch:
        nodes = graph.Nodes(plan.configuration, Path(scratch), lockstep=True)
        topics = {CLOCK.path: CLOCK.type, **plan.outputs}
        with processes.ProcessGroup(node_environment(domain)) as group:
            recorder = group.start(nodes.recorder(folder, chosen=topics))
            for name, node in ((ODOMETRY, nodes.odometry), (BRAKE_ASSIST, nodes.brake_assist)):
                if name in plan.nodes:
                    group.start(node(node_listeners(plan, name)))
            player = group.start(nodes.player(bag, plan.inputs, plan.outputs, rate))
            report = _follow(group, player)
        group.raise_if_failed()
        processes.check_counts(recorder.new_reports(), report["results"])
    return int(report["timeouts"])


def _follow(group: processes.ProcessGroup, player: processes.RunningProcess) -> Mapping[str, Any]:
    while processes.wait_for(player) is None:
        group.raise_if_ended(besides=player)
        for process in group.running:
            process.raise_if_halted()
    reports = player.new_reports()
    if player.returncode != 0 or not reports:
        raise processes.ProcessError(processes.describe_end(player))
    return reports[-1]
