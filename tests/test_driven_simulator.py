"""A simulator driven over ROS: cmd_vel alone, pause, step, reset and placement."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from bystander import Bystander
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from omni_process import WORKSPACE
from std_srvs.srv import SetBool, Trigger

from omni_ros.environment import node_environment
from omni_ros.messages import to_nanoseconds
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup

PERIOD_NS = 10_000_000
SPEED = 0.8  # [m/s]


class Teleoperator(Bystander):
    """Publishes only cmd_vel."""

    def __init__(self, domain: int, kind: Any) -> None:
        super().__init__("teleoperator", domain)
        self.stamp = -1
        self.pose = (math.nan, math.nan)
        self.speed = math.nan
        self.kind = kind
        self._command = self.node.create_publisher(kind, "cmd_vel", RELIABLE)
        self.node.create_subscription(Odometry, "ground_truth/odom", self._on_truth, RELIABLE)

    def description(self) -> str:
        return f"{self.speed} m/s at {self.pose}, {self.stamp} ns"

    def _on_truth(self, message: Odometry) -> None:
        self.stamp = to_nanoseconds(message.header.stamp)
        self.pose = (message.pose.pose.position.x, message.pose.pose.position.y)
        self.speed = message.twist.twist.linear.x

    def drive(self) -> bool:
        """Publish the speed once, and return whether the vehicle has reached it."""
        message = self.kind()
        twist = message.twist if self.kind is TwistStamped else message
        twist.linear.x = SPEED
        self._command.publish(message)
        return self.speed > 0.9 * SPEED

    def ask(self, service: str, **request: Any) -> bool:
        kind = SetBool if request else Trigger
        answer = self.call(kind, f"/simulator/{service}", kind.Request(**request))
        return bool(answer.success)


@pytest.fixture
def teleoperator(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Teleoperator]:
    """A simulator that is driven by cmd_vel, in a separate domain."""
    overrides = ["feedback=velocity_sensor", "simulation.render_lines=false", "maneuver.x=2"]
    configuration = ExperimentLibrary(WORKSPACE / "config").load(
        "small_stop", "assisted", overrides
    )
    process = graph.Nodes(configuration, tmp_path).simulator(listeners=0)
    stamped = str(request.param is TwistStamped).lower()
    driven = ["-p", "driver:=cmd_vel", "-p", f"stamped_cmd_vel:={stamped}"]
    process = dataclasses.replace(process, arguments=[*process.arguments, *driven])
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        group.start(process)
        with closing(Teleoperator(domain, request.param)) as teleoperator:
            teleoperator.wait(lambda: teleoperator.stamp > 0)
            yield teleoperator


@pytest.mark.parametrize("teleoperator", [TwistStamped, Twist], indirect=True)
def test_cmd_vel_drives_and_its_silence_stops(teleoperator: Teleoperator) -> None:
    teleoperator.wait(teleoperator.drive)
    assert not teleoperator.node.get_publishers_info_by_topic("/cmd_vel")[1:]  # it is ours alone
    teleoperator.wait(lambda: abs(teleoperator.speed) < 0.01)
    assert teleoperator.pose[0] > 2.0


@pytest.mark.parametrize("teleoperator", [TwistStamped], indirect=True)
def test_time_halts_and_goes_on_and_the_vehicle_is_put_elsewhere(
    teleoperator: Teleoperator,
) -> None:
    assert not teleoperator.ask("step")  # not paused
    assert teleoperator.ask("pause", data=True)
    teleoperator.catch_up(lambda: teleoperator.stamp)
    halted = teleoperator.stamp
    for count in (1, 2):
        assert teleoperator.ask("step")
        teleoperator.wait(lambda count=count: teleoperator.stamp >= halted + count * PERIOD_NS)  # type: ignore[misc]
        teleoperator.catch_up(lambda: teleoperator.stamp)
        assert teleoperator.stamp == halted + count * PERIOD_NS
    assert teleoperator.ask("pause", data=False)
    teleoperator.wait(lambda: teleoperator.stamp > halted + 10 * PERIOD_NS)

    place = PoseWithCovarianceStamped()
    place.header.frame_id = "odom"
    place.pose.pose.position.x, place.pose.pose.position.y = 1e20, 5.0
    viewer = teleoperator.node.create_publisher(PoseWithCovarianceStamped, "initialpose", RELIABLE)
    teleoperator.wait(viewer.get_subscription_count)
    viewer.publish(place)  # too far from the origin for the pattern of a ground
    asked = teleoperator.stamp
    teleoperator.wait(lambda: teleoperator.stamp > asked + 10 * PERIOD_NS)
    assert teleoperator.pose == pytest.approx((2.0, 0.0))
    place.pose.pose.position.x = -3.0
    viewer.publish(place)
    teleoperator.wait(lambda: math.dist(teleoperator.pose, (-3.0, 5.0)) < 1e-3)
    before = teleoperator.stamp
    assert teleoperator.ask("reset")
    teleoperator.wait(lambda: math.dist(teleoperator.pose, (2.0, 0.0)) < 1e-3)
    assert teleoperator.stamp > before
