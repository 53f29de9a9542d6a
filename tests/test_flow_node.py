"""Flow sensors over topics: messages of drivers give a twist, or reasons for its absence."""

from __future__ import annotations

import math
from contextlib import closing
from pathlib import Path

import numpy as np
from bystander import Bystander
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from omni_process import WORKSPACE

from omni_core.sensors import FlowSensor, sensor_matrix
from omni_core.signals import Flow
from omni_ros.environment import node_environment
from omni_ros.messages import to_nanoseconds, twist_of
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup
from omni_sim.messages import flow_message

TWIST = np.array((0.8, -0.3, 0.5))
PERIOD_NS = 10_000_000


class Boards(Bystander):
    """Drivers of flow sensors, and a subscriber of the odometry."""

    def __init__(self, domain: int, sensors: dict[str, FlowSensor]) -> None:
        super().__init__("boards", domain)
        self.sensors = sensors
        self.publishers = {
            name: self.node.create_publisher(
                TwistWithCovarianceStamped, f"flow/{name}/twist", RELIABLE
            )
            for name in sensors
        }
        self.twists: list[TwistWithCovarianceStamped] = []
        self.values: dict[str, str] = {}
        self.node.create_subscription(
            TwistWithCovarianceStamped, "odometry/twist", self.twists.append, RELIABLE
        )
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, RELIABLE)
        self.stamp_ns = 0

    def _on_report(self, message: DiagnosticArray) -> None:
        self.values |= {value.key: value.value for value in message.status[0].values}

    def description(self) -> str:
        return f"said so far: {self.values}"

    def step(self, **velocities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Publish a measurement of each sensor and return the resulting twist."""
        self.stamp_ns += PERIOD_NS
        true = (sensor_matrix(self.sensors) @ TWIST).reshape(-1, 2)
        for (name, publisher), velocity in zip(self.publishers.items(), true, strict=True):
            reading = Flow(self.stamp_ns, velocities.get(name, velocity), 1e-4 * np.eye(2))
            publisher.publish(flow_message(name, reading))
        self.wait(
            lambda: self.twists and to_nanoseconds(self.twists[-1].header.stamp) == self.stamp_ns
        )
        return twist_of(self.twists[-1])[1:3]


def test_drivers_are_received_and_one_that_fails_is_named(tmp_path: Path) -> None:
    configuration = ExperimentLibrary(WORKSPACE / "config").load("flow_sensors", "assisted")
    process = graph.Nodes(configuration, tmp_path, lockstep=True).odometry(listeners=1)
    sensors = dict(configuration.flow_sensors)
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        group.start(process)
        with closing(Boards(domain, sensors)) as boards:
            publishers = boards.publishers.values()
            boards.wait(lambda: all(p.get_subscription_count() == 1 for p in publishers))
            boards.wait(lambda: boards.node.count_publishers("odometry/twist") == 1)
            twist, covariance = boards.step()
            np.testing.assert_allclose(twist, TWIST, atol=1e-12)
            assert np.linalg.eigvalsh(covariance)[0] > 0.0
            twist, _ = boards.step(left=np.full(2, math.nan))
            np.testing.assert_allclose(twist, TWIST, atol=1e-12)
            boards.wait(lambda: "not finite" in boards.values.get("left", ""))
            assert "m/s along its axis" in boards.values["front"]
            nothing = np.full(2, math.nan)
            twist, covariance = boards.step(left=nothing, front=nothing)
            np.testing.assert_array_equal(twist, np.zeros(3))
            assert covariance[0, 0] == 1e6
