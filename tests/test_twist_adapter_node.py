"""A twist from any source is converted to the assistant's message, or not published."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import numpy as np
import pytest
from bystander import Bystander, vehicle_node
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped, TwistWithCovarianceStamped
from nav_msgs.msg import Odometry

from omni_core.signals import UNMEASURED_VARIANCE
from omni_ros.messages import (
    planar_odometry,
    planar_twist,
    planar_twist_with_covariance,
    twist_of,
)
from omni_ros.qos import BEST_EFFORT, RELIABLE
from omni_runs.graph.domain import reserved_domain

TWIST = np.array([1.2, -0.3, 0.5])


class Vehicle(Bystander):
    """A source that publishes with best effort, and a subscriber like the assistant."""

    def __init__(self, domain: int, kind: type[Any] = Odometry, topic: str = "input") -> None:
        super().__init__("vehicle", domain)
        self.source = self.node.create_publisher(kind, topic, BEST_EFFORT)
        self.twists: list[TwistWithCovarianceStamped] = []
        self.status = ""
        listen = self.node.create_subscription
        listen(TwistWithCovarianceStamped, "odometry/twist", self.twists.append, RELIABLE)
        listen(DiagnosticArray, "/diagnostics", self._read, RELIABLE)
        self.frame, self.value = "base_link", TWIST
        self.node.create_timer(0.01, self._step)

    def _read(self, message: DiagnosticArray) -> None:
        self.status = message.status[0].message

    def _step(self) -> None:
        now_ns = self.node.get_clock().now().nanoseconds
        zeros = np.zeros((3, 3))
        message: Any = planar_odometry(now_ns, np.zeros(3), zeros, self.value, zeros)
        message.child_frame_id = self.frame
        if self.source.msg_type is TwistStamped:
            message = planar_twist(now_ns, self.value)
        elif self.source.msg_type is TwistWithCovarianceStamped:
            message = planar_twist_with_covariance(now_ns, self.value, 0.04 * np.eye(3))
        self.source.publish(message)

    def description(self) -> str:
        return f"{len(self.twists)} twists, {self.status}"


def test_an_odometry_without_covariance_gets_the_one_that_is_configured() -> None:
    words = ["-p", "input_type:=odometry", "-p", "deviation:=[0.1, 0.1, 0.2]"]
    with (
        reserved_domain() as domain,
        vehicle_node(domain, "twist_adapter", *words),
        closing(Vehicle(domain)) as vehicle,
    ):
        vehicle.wait(lambda: vehicle.twists)
        _, twist, covariance, _ = twist_of(vehicle.twists[-1])
        np.testing.assert_array_equal(twist, TWIST)
        np.testing.assert_allclose(covariance, np.diag([0.01, 0.01, 0.04]))
        vehicle.frame = "camera_link"
        vehicle.wait(lambda: "'camera_link', not in 'base_link'" in vehicle.status)
        assert "base_frame" in vehicle.status
        vehicle.catch_up(lambda: len(vehicle.twists))
        vehicle.twists.clear()
        vehicle.catch_up(lambda: len(vehicle.twists))
        assert not vehicle.twists


def test_a_yaw_rate_that_is_never_set_is_passed_on_as_not_measured() -> None:
    words = ["-p", "input_type:=odometry", "-p", "deviation:=[0.1, 0.1, 0.2]"]
    prefix = "-p", "frame_prefix:=robot1/"
    with (
        reserved_domain() as domain,
        vehicle_node(domain, "twist_adapter", *words, *prefix),
        closing(Vehicle(domain)) as vehicle,
    ):
        vehicle.frame, vehicle.value = "robot1/base_link", np.array([0.5, -0.1, 0.0])
        vehicle.wait(lambda: "angular.z has been 0 in every message" in vehicle.status)
        vehicle.wait(lambda: vehicle.twists)
        _, _, covariance, _ = twist_of(vehicle.twists[-1])
        np.testing.assert_allclose(np.diag(covariance), [0.01, 0.01, UNMEASURED_VARIANCE])
        assert vehicle.twists[-1].header.frame_id == "robot1/base_link"


@pytest.mark.parametrize(
    ("kind", "words", "deviations"),
    [
        (TwistStamped, ("twist_stamped", "-p", "deviation:=[0.1, 0.1, 0.2]"), (0.1, 0.1, 0.2)),
        (TwistWithCovarianceStamped, ("twist_with_covariance",), (0.2, 0.2, 0.2)),
    ],
)
def test_a_twist_of_another_type_passes_with_its_covariance_or_the_configured_one(
    kind: type[Any], words: tuple[str, ...], deviations: tuple[float, ...]
) -> None:
    node = "twist_adapter", "-r", "input:=radar/twist"
    with (
        reserved_domain() as domain,
        vehicle_node(domain, *node, "-p", f"input_type:={words[0]}", *words[1:]),
        closing(Vehicle(domain, kind, "radar/twist")) as vehicle,
    ):
        vehicle.wait(lambda: vehicle.twists)
        _, twist, covariance, _ = twist_of(vehicle.twists[-1])
    np.testing.assert_array_equal(twist, TWIST)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), deviations)
