"""`check-node`: the project's nodes meet their contract, and each violation is named."""

from __future__ import annotations

import json
import shlex
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bystander import Bystander
from omni_process import omni, omni_command, omni_here
from rclpy.duration import Duration
from rclpy.serialization import serialize_message

from omni_core import topics
from omni_ros.messages import joint_state, message_class, planar_twist_with_covariance, to_time
from omni_ros.qos import RELIABLE
from omni_runs.graph.domain import reserved_domain
from omni_tools.node_check.contract import CONTRACT, simulator_breaches
from omni_tools.node_check.enables_node import Enables
from omni_tools.node_check.exchange_node import Exchange, Partner

ROOT = Path(__file__).resolve().parents[1]
PERIOD_NS = 10_000_000
# Subscriptions of a check: `Enables` subscribes to the pedal twice, `BusyPartner` to the clock.
READERS = {topics.CLOCK: 2, topics.WHEEL_STATES: 1, topics.PEDAL: 2, topics.TWIST: 1}
WRONG = """
import sys

import rclpy
from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import Image, JointState

rclpy.init()
node = rclpy.create_node("wrong")
print("the output of a node is no part of the report")
if sys.argv[1] == "odometry":
    kind = TwistWithCovarianceStamped
    twist = node.create_publisher(kind, "odometry/twist", qos_profile_sensor_data)
else:
    enable = node.create_publisher(JointState, "brake/enable", 10)
if sys.argv[1] == "simulator":
    node.create_publisher(JointState, "brake/pedal", 10)


def answer(message):
    enable.publish(JointState(header=message.header, name=["left"], effort=[2.0]))


def measure(message):
    header = message.header
    header.stamp.sec += 3600
    twist.publish(TwistWithCovarianceStamped(header=header))


node.create_subscription(JointState, "brake/pedal", answer, 10)
lasting = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(JointState, "wheel_states", print, lasting)
node.create_subscription(Image, "line_scan/front/lines", measure, 10)
try:
    rclpy.spin(node)
except ExternalShutdownException:
    pass
"""


def check(node: str, start: Sequence[str], *words: str) -> tuple[int, dict[str, Any]]:
    """Check a node, which the command `start` starts."""
    finished = omni(["check-node", node, "--start", shlex.join(start), *words, "--json"])
    assert finished.stdout, finished.stderr
    return finished.returncode, json.loads(finished.stdout)


@pytest.fixture(scope="module")
def parameters(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("parameters")
    configuration = ROOT / "bags" / "small_stop" / "assisted" / "configuration.yaml"
    assert omni_here(["ros-params", str(configuration), "--out", str(folder)]).returncode == 0
    return folder


@pytest.mark.parametrize(
    ("node", "module"),
    [
        ("brake_assist", "omni_brake_assist.brake_assist_node"),
        ("odometry", "linescan_odometry.odometry_node"),
    ],
)
def test_our_nodes_keep_their_contract(node: str, module: str, parameters: Path) -> None:
    name = {"odometry": "linescan_odometry"}.get(node, node)
    file = parameters / f"{name}.yaml"
    start = [sys.executable, "-m", module, "--ros-args", "--params-file", str(file)]
    _, document = check(node, start)
    # Delay and number of the answers depend on the load of the machine. Other tests require all
    # brakes on without inputs (test_brake_assist_node.py) and recovery (test_odometry.py).
    late = (
        "% of the answers",
        "were answered",
        "s after the last input",
        "later than 0.5 s",
        "gap of",
    )
    assert [one for one in document["breaches"] if not any(word in one for word in late)] == []
    assert document["metrics"]["answers.all"]["value"] > 100


@pytest.mark.parametrize(
    ("node", "breaches"),
    [
        (
            "brake_assist",
            (
                "brake/enable names left; must be",
                "one share of 0 to 1 per wheel",
                "a subscription to /wheel_states receives nothing: ",
            ),
        ),
        (
            "odometry",
            (
                "is published with best effort",
                "a stamp is later than that of the newest input",
                "frame_id 'front' must be base_link",
            ),
        ),
    ],
)
def test_breaches_of_a_foreign_node_are_named(
    node: str, breaches: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "wrong.py").write_text(WRONG)
    code, document = check(node, [sys.executable, str(tmp_path / "wrong.py"), node])
    assert code == 1
    found = " | ".join(document["breaches"])
    assert [one for one in breaches if one not in found] == []


def test_a_twist_of_another_message_type_is_refused(tmp_path: Path) -> None:
    (tmp_path / "odometry.py").write_text(
        "import rclpy\n"
        "from nav_msgs.msg import Odometry\n"
        "rclpy.init()\n"
        "node = rclpy.create_node('other')\n"
        "node.create_publisher(Odometry, 'odometry/twist', 10)\n"
        "rclpy.spin(node)\n"
    )
    code, document = check("odometry", [sys.executable, str(tmp_path / "odometry.py")])
    assert code == 1
    assert document["error"].startswith("/odometry/twist is published as nav_msgs/msg/Odometry")


@pytest.mark.parametrize("command", ["no-such-program", "sh -c 'unclosed"])
def test_a_command_that_cannot_start_is_refused(command: str) -> None:
    finished = omni_here(["check-node", "brake_assist", "--start", command])
    assert finished.returncode == 2
    assert "--start: cannot start" in finished.stderr


def test_the_simulator_of_a_run_keeps_its_contract(tmp_path: Path) -> None:
    words = "run small_stop --variant assisted --replace brake_assist=external"
    changes = "--set feedback=velocity_sensor --set simulation.render_lines=false"
    start = omni_command([*words.split(), *changes.split(), "--out", str(tmp_path)])
    code, document = check("simulator", start, "--duration", "150")
    assert document["breaches"] == []
    assert code == 0


class Simulator(Bystander):
    """Publishes messages that meet the contract of a simulator without an IMU."""

    def __init__(self, domain: int) -> None:
        super().__init__("simulator", domain)
        self.publishers = {
            topic: self.node.create_publisher(message_class(topic.type), topic.path, RELIABLE)
            for topic in READERS
        }

    def description(self) -> str:
        return f"{[p.get_subscription_count() for p in self.publishers.values()]} subscriptions"

    def drive(self, steps: int) -> None:
        """Publish steps in quick succession, with two ticks of the clock in each."""
        found = self.publishers.items()
        self.wait(lambda: all(p.get_subscription_count() == READERS[t] for t, p in found))
        clock = message_class(topics.CLOCK.type)
        for stamp_ns in range(0, steps * PERIOD_NS, PERIOD_NS):
            for topic, message in (
                (topics.CLOCK, clock(clock=to_time(stamp_ns))),
                (topics.WHEEL_STATES, joint_state(stamp_ns, ("left",), velocity=np.ones(1))),
                (topics.PEDAL, joint_state(stamp_ns, ("brake_pedal",), position=np.zeros(1))),
                (topics.TWIST, planar_twist_with_covariance(stamp_ns, np.ones(3), np.eye(3))),
                (topics.CLOCK, clock(clock=to_time(stamp_ns + PERIOD_NS // 2))),
            ):
                self.publishers[topic].publish(message)
        for publisher in self.publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=30))


class BusyPartner(Partner):
    """A receiver that processes no message until the simulator has published all of them."""

    steps = 90  # with two ticks each, they fit into the queue of the clock

    def __init__(self, domain: int, simulator: Simulator) -> None:
        super().__init__(domain)
        self.simulator = simulator
        self.ticks: list[Any] = []

    def spin(self, until: float) -> None:
        if not self.ticks:
            # The last subscription: waiting messages of all others are taken before its own.
            kind = message_class(topics.CLOCK.type)
            self.node.create_subscription(kind, topics.CLOCK.path, self.ticks.append, RELIABLE)
            self.simulator.drive(self.steps)
        while len(self.ticks) < 2 * self.steps:  # one message of each topic at a time
            super().spin(time.monotonic() + 0.01)
        super().spin(until)


def test_waiting_messages_of_a_simulator_are_no_difference_from_its_clock() -> None:
    with (
        reserved_domain() as domain,
        closing(Simulator(domain)) as simulator,
        closing(BusyPartner(domain, simulator)) as partner,
    ):
        seen = Enables(partner.node, ("left",)).watch(
            partner, CONTRACT.longest_gap, alive=lambda: True
        )
    assert len(seen["clock"].messages) == 2 * partner.steps
    assert len(seen["twist"].messages) == partner.steps
    found = simulator_breaches(seen, ("left",))
    assert [one for one in found if "no message in the last" not in one] == []


def test_an_answer_is_no_older_for_waiting_in_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Exchange(topics.ENABLE, [True])
    monkeypatch.setattr("time.time_ns", lambda: 10 * PERIOD_NS)
    made.note(0)
    answer = serialize_message(joint_state(0, ("left",), effort=np.ones(1)))
    made.keep(answer, {"source_timestamp": 11 * PERIOD_NS})
    (kept,) = made.answers
    assert (kept.age, kept.silence) == (0.01, 0.01)


def test_a_run_with_its_own_assistant_is_refused_as_a_simulator(tmp_path: Path) -> None:
    (tmp_path / "wrong.py").write_text(WRONG)
    code, document = check("simulator", [sys.executable, str(tmp_path / "wrong.py"), "simulator"])
    assert code == 1
    assert document["error"].startswith("wrong publishes /brake/enable, which this check sends")
    assert "--replace brake_assist=external" in document["error"]
