"""Two vehicles in one ROS domain: separate names and frames, and one publisher of the time."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from bystander import Bystander
from nav_msgs.msg import Odometry
from omni_process import WORKSPACE
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from omni_ros.environment import node_environment
from omni_ros.messages import to_nanoseconds
from omni_ros.qos import LATCHED, RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup

ROBOTS = ("robot1", "robot2")
SHARED = {"/clock", "/diagnostics", "/parameter_events", "/rosout"}


class Onlooker(Bystander):
    """Receives the time and the poses of the vehicles."""

    def __init__(self, domain: int) -> None:
        super().__init__("onlooker", domain)
        listen = self.node.create_subscription
        self.times: list[int] = []
        self.poses: dict[str, list[Odometry]] = {robot: [] for robot in ROBOTS}
        self.descriptions: dict[str, list[String]] = {robot: [] for robot in ROBOTS}
        listen(Clock, "/clock", self._on_clock, RELIABLE)
        for robot in ROBOTS:
            listen(Odometry, f"{robot}/ground_truth/odom", self.poses[robot].append, RELIABLE)
            said = self.descriptions[robot]
            listen(String, f"{robot}/robot_description", said.append, LATCHED)

    def _on_clock(self, message: Clock) -> None:
        self.times.append(to_nanoseconds(message.clock))

    def description(self) -> str:
        return f"{len(self.times)} times, poses { ({k: len(v) for k, v in self.poses.items()}) }"


@pytest.fixture
def onlooker(tmp_path: Path) -> Iterator[Onlooker]:
    """Two simulators of the same vehicle, started one after the other, and an observer."""
    overrides = ["feedback=velocity_sensor", "simulation.render_lines=false"]
    configuration = ExperimentLibrary(WORKSPACE / "config").load(
        "straight_line", "assisted", overrides
    )
    process = graph.Nodes(configuration, tmp_path).simulator(driven=True, listeners=0)
    with (
        reserved_domain() as domain,
        ProcessGroup(node_environment(domain)) as group,
        closing(Onlooker(domain)) as onlooker,
    ):
        for robot in ROBOTS:
            names = ["-r", f"__ns:=/{robot}", "-p", f"frame_prefix:={robot}/"]
            group.start(dataclasses.replace(process, arguments=[*process.arguments, *names]))
            poses = onlooker.poses[robot]
            onlooker.wait(lambda poses=poses: len(poses) > 50)  # type: ignore[misc]
        yield onlooker


def test_they_share_one_time_and_nothing_else(onlooker: Onlooker) -> None:
    # On a busy machine the second simulator may publish the time until it discovers the first.
    onlooker.wait(lambda: onlooker.node.count_publishers("/clock") == 1)
    onlooker.times.clear()
    onlooker.wait(lambda: len(onlooker.times) > 100)
    assert onlooker.times == sorted(onlooker.times)
    for robot, poses in onlooker.poses.items():
        frames = {(pose.header.frame_id, pose.child_frame_id) for pose in poses}
        assert frames == {(f"{robot}/odom", f"{robot}/base_link")}
        onlooker.wait(lambda robot=robot: onlooker.descriptions[robot])  # type: ignore[misc]
        for link in ("front_left_wheel", "imu"):
            assert f'name="{link}"' in onlooker.descriptions[robot][0].data
    topics = {name for name, _ in onlooker.node.get_topic_names_and_types()}
    own = {topic for topic in topics if topic.startswith(tuple(f"/{robot}/" for robot in ROBOTS))}
    assert topics - own == SHARED
    assert len(own) % 2 == 0
