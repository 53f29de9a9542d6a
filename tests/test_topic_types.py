"""A publisher of another message type than that of a subscription is reported by its subscriber."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from bystander import Bystander, vehicle_node
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from omni_process import WORKSPACE
from std_msgs.msg import Float64

from omni_ros.environment import node_environment
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup


class Onlooker(Bystander):
    """A node that receives `/diagnostics`."""

    def __init__(self, domain: int) -> None:
        super().__init__("onlooker", domain)
        self.words: list[str] = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._read, RELIABLE)

    def _read(self, message: DiagnosticArray) -> None:
        self.words += [
            status.message for status in message.status if status.name.endswith("topic types")
        ]

    def description(self) -> str:
        return f"{self.words}"


ADAPTER = "wheels:=[left,right]", "kind:=spring"


@pytest.mark.parametrize(
    ("name", "parameters", "topic", "found", "expected", "parameter"),
    [
        ("brake_adapter", (*ADAPTER, "pedal:=twist"), "cmd_vel", TwistStamped, Twist, "pedal"),
        (
            "twist_adapter",
            ("input_type:=odometry",),
            "input",
            TwistStamped,
            Odometry,
            "input_type",
        ),
    ],
)
def test_topic_types_and_parameter_are_named_until_the_publisher_is_gone(
    name: str,
    parameters: tuple[str, ...],
    topic: str,
    found: type[Any],
    expected: type[Any],
    parameter: str,
) -> None:
    words = [word for given in parameters for word in ("-p", given)]
    with (
        reserved_domain() as domain,
        vehicle_node(domain, name, *words),
        closing(Onlooker(domain)) as onlooker,
    ):
        wrong = onlooker.node.create_publisher(found, topic, RELIABLE)
        sentence = (
            f"/{topic} is published as {ros_name(found)} by node onlooker, must be "
            f"{ros_name(expected)}: correct the parameter {parameter} or the publisher"
        )
        onlooker.wait(lambda: sentence in onlooker.words)
        onlooker.node.destroy_publisher(wrong)
        onlooker.wait(lambda: onlooker.words[-1] == "as expected")


def test_the_simulator_reports_commands_and_pedals_of_another_type(tmp_path: Path) -> None:
    configuration = ExperimentLibrary(WORKSPACE / "config").load(
        "straight_line", "assisted", ["feedback=velocity_sensor", "simulation.render_lines=false"]
    )
    process = graph.Nodes(configuration, tmp_path).simulator(driven=True, listeners=0)
    with (
        reserved_domain() as domain,
        ProcessGroup(node_environment(domain)) as group,
        closing(Onlooker(domain)) as onlooker,
    ):
        group.start(process)
        onlooker.node.create_publisher(Twist, "driver/cmd_vel", RELIABLE)
        onlooker.node.create_publisher(Float64, "driver/pedal", RELIABLE)
        sentences = (
            "/driver/cmd_vel is published as geometry_msgs/msg/Twist by node onlooker, must be "
            "geometry_msgs/msg/TwistStamped: correct the parameter stamped_cmd_vel or the",
            "/driver/pedal is published as std_msgs/msg/Float64 by node onlooker, must be "
            "sensor_msgs/msg/JointState: correct or remap the publisher",
        )
        for sentence in sentences:
            onlooker.wait(lambda part=sentence: any(part in words for words in onlooker.words))  # type: ignore[misc]


def ros_name(kind: type[Any]) -> str:
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
