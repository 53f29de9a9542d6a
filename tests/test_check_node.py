"""`check-node`: the project's nodes meet their contract, and each violation is named."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from omni_process import omni_command, omni_environment

ROOT = Path(__file__).resolve().parents[1]
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


def check(*words: str) -> tuple[int, dict[str, Any]]:
    finished = subprocess.run(
        omni_command(["check-node", *words, "--json"]),
        env=omni_environment(),
        capture_output=True,
        text=True,
        timeout=200.0,
        check=False,
    )
    assert finished.stdout, finished.stderr
    return finished.returncode, json.loads(finished.stdout)


@pytest.fixture(scope="module")
def parameters(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("parameters")
    configuration = ROOT / "bags" / "small_stop" / "assisted" / "configuration.yaml"
    command = omni_command(["ros-params", str(configuration), "--out", str(folder)])
    subprocess.run(command, env=omni_environment(), check=True, capture_output=True)
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
    start = f"{sys.executable} -m {module} --ros-args --params-file {file}"
    _, document = check(node, "--start", start)
    # Delay and number of the answers depend on the load of the machine. Other tests require all
    # brakes on without inputs (test_brake_assist_node.py) and recovery (test_odometry.py).
    late = ("% of the answers", "were answered", "s after the last input", "later than 0.5 s")
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
    start = f"{sys.executable} {tmp_path / 'wrong.py'} {node}"
    code, document = check(node, "--start", start)
    assert code == 1
    found = " | ".join(document["breaches"])
    assert [one for one in breaches if one not in found] == []


@pytest.mark.parametrize("command", ["no-such-program", "sh -c 'unclosed"])
def test_a_command_that_cannot_start_is_refused(command: str) -> None:
    finished = subprocess.run(
        omni_command(["check-node", "brake_assist", "--start", command]),
        env=omni_environment(),
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert finished.returncode == 2
    assert "--start: cannot start" in finished.stderr


def test_the_simulator_of_a_run_keeps_its_contract(tmp_path: Path) -> None:
    words = "run small_stop --variant assisted --replace brake_assist=external"
    changes = "--set feedback=velocity_sensor --set simulation.render_lines=false"
    start = shlex.join(omni_command([*words.split(), *changes.split(), "--out", str(tmp_path)]))
    code, document = check("simulator", "--start", start, "--duration", "5")
    assert document["breaches"] == []
    assert code == 0


def test_a_run_with_its_own_assistant_is_refused_as_a_simulator(tmp_path: Path) -> None:
    (tmp_path / "wrong.py").write_text(WRONG)
    start = f"{sys.executable} {tmp_path / 'wrong.py'} simulator"
    code, document = check("simulator", "--start", start)
    assert code == 1
    assert document["error"].startswith("wrong publishes /brake/enable, which this check sends")
    assert "--replace brake_assist=external" in document["error"]
