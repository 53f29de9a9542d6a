"""The odometry over topics: the reason for an invalid image is published with the twist."""

from __future__ import annotations

import dataclasses
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from bystander import Bystander
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from omni_process import WORKSPACE
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from omni_ros.environment import node_environment
from omni_ros.messages import to_nanoseconds, to_time
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup

LINES = 26
RATE = 2500.0


class Cameras(Bystander):
    """Three line cameras at rest over a ground of random texture."""

    def __init__(
        self, domain: int, sensors: tuple[str, ...], pixels: int, qos: QoSProfile = RELIABLE
    ) -> None:
        super().__init__("cameras", domain)
        self.publishers = {
            name: self.node.create_publisher(Image, f"line_scan/{name}/lines", qos)
            for name in sensors
        }
        self.twists: list[TwistWithCovarianceStamped] = []
        self.reasons: dict[str, str] = {}
        self.node.create_subscription(
            TwistWithCovarianceStamped, "odometry/twist", self.twists.append, RELIABLE
        )
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_report, RELIABLE)
        self._generator = np.random.default_rng(1)
        self._ground = self._generator.integers(40, 200, pixels)
        self._stamp_ns = 0
        self.odometry = 0  # number of its process

    def _on_report(self, message: DiagnosticArray) -> None:
        self.reasons |= {value.key: value.value for value in message.status[0].values}

    def description(self) -> str:
        return f"reasons so far: {self.reasons}"

    def image(self) -> Image:
        """Return lines with the noise of a camera."""
        noise = self._generator.normal(0.0, 1.0, (LINES, len(self._ground)))
        lines = np.rint(self._ground + noise).astype(np.uint8)
        return Image(
            header=Header(stamp=to_time(self._stamp_ns)),
            height=LINES,
            width=lines.shape[1],
            encoding="mono8",
            step=lines.shape[1],
            data=lines.tobytes(),
        )

    def step(self, **spoilt: Callable[[Image], None]) -> TwistWithCovarianceStamped:
        """Publish one batch of every camera and return the resulting twist."""
        self.show(**spoilt)
        return self.newest()

    def newest(self) -> TwistWithCovarianceStamped:
        """Return the twist of the last batches, when it has arrived."""
        self.wait(
            lambda: self.twists and to_nanoseconds(self.twists[-1].header.stamp) == self._stamp_ns
        )
        return self.twists[-1]

    def show(self, **spoilt: Callable[[Image], None]) -> None:
        """Publish one batch of every camera."""
        self._stamp_ns += round(1e9 * LINES / RATE)
        for name, publisher in self.publishers.items():
            image = self.image()
            spoilt.get(name, lambda _: None)(image)
            publisher.publish(image)


@pytest.fixture
def cameras(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Cameras]:
    """Cameras and an odometry process, in a separate ROS domain; `param` is a parameter to set."""
    parameter = getattr(request, "param", "lockstep:=true")
    best_effort = parameter == "best_effort_cameras:=true"
    configuration = ExperimentLibrary(WORKSPACE / "config").load("straight_line", "assisted")
    process = graph.Nodes(configuration, tmp_path, lockstep=True).odometry(listeners=1)
    process = dataclasses.replace(process, arguments=[*process.arguments, "-p", parameter])
    sensors = configuration.odometry.sensors
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        running = group.start(process)
        pixels = next(iter(sensors.values())).pixels
        qos = qos_profile_sensor_data if best_effort else RELIABLE
        with closing(Cameras(domain, tuple(sensors), pixels, qos)) as cameras:
            cameras.odometry = running.pid
            publishers = cameras.publishers.values()
            cameras.wait(lambda: all(p.get_subscription_count() == 1 for p in publishers))
            cameras.wait(lambda: cameras.node.count_publishers("odometry/twist") == 1)
            yield cameras


def measured(twist: TwistWithCovarianceStamped) -> bool:
    return bool(twist.twist.covariance[0] < 1.0)


def floats(image: Image) -> None:
    """Replace the lines of an image by NaN as 32-bit floats, a type that the odometry rejects."""
    image.encoding, image.step = "32FC1", 4 * image.width
    image.data = np.full((image.height, image.width), np.nan, np.float32).tobytes()


def half(image: Image) -> None:
    image.data = image.data[: len(image.data) // 2]


@pytest.mark.parametrize("cameras", ["best_effort_cameras:=true"], indirect=True)
def test_cameras_of_the_sensor_data_profile_are_received(cameras: Cameras) -> None:
    def arrived() -> bool:
        cameras.show()
        return any(measured(twist) for twist in cameras.twists)

    cameras.wait(arrived)  # best effort: the first ones may be lost


def test_an_image_without_lines_is_reported_in_the_same_step(cameras: Cameras) -> None:
    cameras.step()
    assert measured(cameras.step())
    assert not measured(cameras.step(left=floats))
    cameras.wait(lambda: "32FC1" in cameras.reasons.get("left", ""))
    cameras.step()  # the chain of lines begins anew
    assert measured(cameras.step())
    assert not measured(cameras.step(left=half))
    cameras.wait(lambda: "needs at least" in cameras.reasons.get("left", ""))


def test_what_is_no_image_is_left_out(cameras: Cameras) -> None:
    cameras.step()
    whole = serialize_message(cameras.image())
    for wire in (b"\0\1\0\0", whole[:40], b"\0\0" + whole[2:], b"\0\3" + whole[2:100]):
        cameras.publishers["left"].publish(wire)
    assert measured(cameras.step())


@pytest.mark.parametrize("cameras", ["lockstep:=false", "lockstep:=true"], indirect=True)
def test_only_in_lockstep_an_odometry_that_is_late_processes_old_lines(
    cameras: Cameras, request: pytest.FixtureRequest
) -> None:
    cameras.step()
    before, batches = len(cameras.twists), 40
    os.kill(cameras.odometry, signal.SIGSTOP)
    try:
        for _ in range(batches):
            cameras.show()
    finally:
        os.kill(cameras.odometry, signal.SIGCONT)
    cameras.newest()
    processed = len(cameras.twists) - before
    lockstep = request.node.callspec.params["cameras"] == "lockstep:=true"
    # A camera whose batches arrive first gives further twists.
    assert processed >= batches if lockstep else processed < batches
    cameras.wait(lambda: measured(cameras.step()))
