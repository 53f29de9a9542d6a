"""Driving by hand: HTTP, WebSocket and topics, with the processes of ``omni drive``."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from bystander import Bystander
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from omni_process import drive_process, omni_here, processes_of
from rcl_interfaces.srv import DescribeParameters, ListParameters
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from omni_brake_assist.brake_assist_node import TUNABLE
from omni_ros.qos import RELIABLE

PATIENCE = 60.0  # [s] only ends a test that hangs
HEARTBEAT = 0.05  # [s]
REST = (0.0, 0.0, 0.0)
FORWARD = (1.0, 0.0, 0.0)
# Without pictures, so that a busy machine keeps up with the wall clock.


class Drive:
    """A running ``omni drive`` and its address."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        assert process.stdout is not None
        assert process.stderr is not None
        self.url = process.stdout.readline().strip()
        found = (re.search(r"ROS_DOMAIN_ID=(\d+)", line) for line in process.stderr)
        self.domain = int(next(match.group(1) for match in found if match))
        parts = re.fullmatch(r"http://(127\.0\.0\.1:\d+)(/[\w-]{32}/)", self.url)
        assert parts is not None, self.url
        self.address, self.path = parts.groups()
        self.origin = Origin(f"http://{self.address}")

    def get(self, path: str, **headers: str) -> http.client.HTTPResponse:
        connection = http.client.HTTPConnection(self.address, timeout=PATIENCE)
        connection.request("GET", path, headers=headers)
        return connection.getresponse()

    def connect(self, **changes: Any) -> ClientConnection:
        options = {"origin": self.origin} | changes
        # Entered and never left: a page that closes ends its socket by itself.
        return connect(f"ws://{self.address}{self.path}socket", **options).__enter__()


class Page:
    """Behavior of the page: sends a demand 20 times a second and stores the received state."""

    def __init__(self, drive: Drive) -> None:
        self.socket = drive.connect()
        self.greeting = json.loads(self.socket.recv(PATIENCE))
        self.demand: dict[str, Any] | None = {"pedal": 0.0, "stick": REST}
        self.state: dict[str, Any] = {}
        self._said = 0.0

    def step(self) -> None:
        now = time.monotonic()
        if self.demand is not None and now - self._said >= HEARTBEAT:
            self.say(**self.demand)
            self._said = now
        with contextlib.suppress(TimeoutError):
            self.state = json.loads(self.socket.recv(HEARTBEAT))

    def say(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def until(self, condition: Callable[[dict[str, Any]], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not ("pose" in self.state and "error" in self.state and condition(self.state)):
            assert time.monotonic() < deadline, f"timed out at {self.state}"
            self.step()

    def drive_to(self, speed: float) -> None:
        """Accelerate forward up to a speed [m/s]."""
        self.demand = {"pedal": 0.0, "stick": FORWARD}
        self.until(lambda state: state["twist"][0] > speed)

    def brake_until(self, condition: Callable[[dict[str, Any]], bool]) -> None:
        """Accelerate and brake until a state meets the condition, in up to ten attempts.

        A single stop may miss the condition on a busy machine.
        """
        for _ in range(10):
            self.drive_to(2.5)
            self.demand = {"pedal": 1.0, "stick": REST}
            self.until(lambda state: condition(state) or abs(state["twist"][0]) < 0.05)
            if condition(self.state):
                return
        pytest.fail(f"no stop met the condition; the last state is {self.state}")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("drive") / "bag"


@pytest.fixture(scope="module")
def drive(recording: Path) -> Iterator[Drive]:
    with drive_process(recording) as process:
        yield Drive(process)


@pytest.fixture
def page(drive: Drive) -> Iterator[Page]:
    page = Page(drive)
    yield page
    page.socket.close()


class Onlooker(Bystander):
    """A node in the same domain, like a terminal with ``ros2``."""

    round_timeout = PATIENCE
    pause = HEARTBEAT

    def __init__(self, domain: int) -> None:
        super().__init__("onlooker", domain)
        self.pedal, self.speed = -1.0, -1.0
        self.node.create_subscription(JointState, "brake/pedal", self._on_pedal, RELIABLE)
        self.node.create_subscription(Odometry, "ground_truth/odom", self._on_truth, RELIABLE)
        self.command = self.node.create_publisher(TwistStamped, "cmd_vel", RELIABLE)

    def _on_pedal(self, message: JointState) -> None:
        self.pedal = message.position[0]

    def _on_truth(self, message: Odometry) -> None:
        self.speed = message.twist.twist.linear.x

    def description(self) -> str:
        return f"pedal {self.pedal}, speed {self.speed}"

    def wait_saying(self, command: TwistStamped, condition: Callable[[], bool]) -> None:
        """Publish a command repeatedly until the condition holds."""

        def holds() -> bool:
            held = condition()
            if not held:
                self.command.publish(command)
            return held

        self.wait(holds)


@pytest.fixture
def onlooker(drive: Drive) -> Iterator[Onlooker]:
    with contextlib.closing(Onlooker(drive.domain)) as onlooker:
        yield onlooker


def test_the_page_is_for_those_who_know_the_token(drive: Drive) -> None:
    page = drive.get(drive.path)
    assert page.status == 200
    assert "default-src 'none'" in str(page.headers["Content-Security-Policy"])
    assert b"drive.js" in page.read()
    for file in ("drive.js", "drive.css"):
        assert drive.get(drive.path + file).status == 200
    assert drive.get(drive.path + "../drive_server.py").status == 404
    assert drive.get("/").status == 403
    assert drive.get("/" + "A" * 32 + "/").status == 403
    assert drive.get(drive.path[:-2] + "/").status == 403
    # A name that its owner has bound to this machine's address.
    assert drive.get(drive.path, Host="evil.example").status == 421


@pytest.mark.parametrize("origin", ["http://evil.example", "null", None])
def test_a_page_from_elsewhere_is_refused(drive: Drive, origin: str | None) -> None:
    with pytest.raises(InvalidStatus) as refused:
        drive.connect(origin=origin)
    assert refused.value.response.status_code == 403


def test_a_socket_without_the_token_is_refused(drive: Drive) -> None:
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://{drive.address}/socket", origin=drive.origin).__enter__()
    assert refused.value.response.status_code == 403


def test_a_page_that_falls_silent_brakes(page: Page) -> None:
    assert len(page.greeting["vehicle"]["wheels"]) == 4
    page.drive_to(2.0)
    page.demand = None
    page.until(lambda state: state["pedal"] == 1.0)
    assert page.state["source"] == "none"
    page.until(lambda state: abs(state["twist"][0]) < 0.05)
    page.drive_to(0.5)  # and continues with the next demand


def test_the_assistant_is_switched_from_the_page(page: Page) -> None:
    page.brake_until(lambda state: 0.0 in state["enable"] and 1.0 in state["enable"])
    page.until(lambda state: state["assist_state"] != "inactive")
    page.demand = {"pedal": 0.0, "stick": REST}
    page.say(pedal=0.0, stick=REST, assist=False)
    page.until(lambda state: not state["assist"])
    page.brake_until(lambda state: state["assist_state"] == "disabled" and state["pedal"] == 1.0)
    assert page.state["enable"] == [1.0] * 4
    page.until(lambda state: abs(state["twist"][0]) < 0.05)
    page.say(pedal=1.0, stick=REST, assist=True)
    page.until(lambda state: bool(state["assist"]))


def test_closing_the_page_stops_the_vehicle(page: Page, onlooker: Onlooker) -> None:
    page.drive_to(2.0)
    page.socket.close()
    onlooker.wait(lambda: onlooker.pedal == 1.0 and abs(onlooker.speed) < 0.05)


def test_a_second_page_takes_over(drive: Drive, page: Page) -> None:
    page.drive_to(0.5)
    second = Page(drive)
    second.drive_to(1.5)
    with pytest.raises(ConnectionClosed) as closed:
        page.until(lambda _: False)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 4001
    second.drive_to(1.5)  # the end of the first page does not affect the second
    second.socket.close()


def test_a_page_that_makes_no_sense_is_closed_and_brakes(page: Page, onlooker: Onlooker) -> None:
    page.drive_to(1.0)
    page.say(pedal="all the way")
    with pytest.raises(ConnectionClosed):
        page.until(lambda _: False)
    onlooker.wait(lambda: onlooker.pedal == 1.0 and abs(onlooker.speed) < 0.05)


def test_cmd_vel_drives_as_long_as_it_is_repeated(onlooker: Onlooker) -> None:
    forward = TwistStamped()
    forward.twist.linear.x = 1.0
    # The end of the previous pages applies the brakes: a command of zero comes first.
    onlooker.wait(lambda: onlooker.command.get_subscription_count() == 1)
    onlooker.wait_saying(TwistStamped(), lambda: onlooker.pedal == 0.0)
    onlooker.wait_saying(forward, lambda: onlooker.speed > 0.9)
    onlooker.wait(lambda: onlooker.pedal == 1.0 and abs(onlooker.speed) < 0.05)


@pytest.mark.parametrize("name", ["simulator", "linescan_odometry", "brake_assist", "driver"])
def test_every_parameter_is_described(onlooker: Onlooker, name: str) -> None:
    """Descriptions that ``ros2 param list`` and ``ros2 param describe`` print."""
    listed = onlooker.call(ListParameters, f"/{name}/list_parameters", ListParameters.Request())
    own = [
        key
        for key in listed.result.names
        if key not in ("use_sim_time", "start_type_description_service")
    ]
    assert len(own) > 5
    request = DescribeParameters.Request(names=own)
    described = onlooker.call(DescribeParameters, f"/{name}/describe_parameters", request)
    for descriptor in described.descriptors:
        assert descriptor.description or descriptor.name.endswith(".names"), descriptor.name
        changes = name == "brake_assist" and descriptor.name in {"enabled", *TUNABLE}
        assert descriptor.read_only != changes, descriptor.name


def test_a_driver_who_hangs_brakes_and_one_who_dies_ends_the_drive(
    drive: Drive, page: Page, onlooker: Onlooker, recording: Path
) -> None:
    """This test is the last, because it ends the drive; the recording is then complete."""
    page.drive_to(2.0)
    (driver,) = processes_of("omni_tools", drive.process.pid, "driver")
    os.kill(driver, signal.SIGSTOP)
    onlooker.wait(lambda: onlooker.pedal == 1.0 and abs(onlooker.speed) < 0.05)
    os.kill(driver, signal.SIGKILL)
    assert drive.process.wait(PATIENCE) == 1
    with AnyReader([recording]) as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
        stamps: dict[str, list[int]] = {"/clock": [], "/ground_truth/odom": []}
        for connection, stamp, _ in reader.messages():
            stamps.get(connection.topic, []).append(stamp)
    steps, ticks = stamps["/ground_truth/odom"], stamps["/clock"]
    assert len(steps) > 100
    assert ticks == steps[-len(ticks) :]  # it waits for the discovery of other publishers
    for topic in ("/tf", "/brake/pedal", "/driver/command"):
        assert counts[topic] == len(steps)
    assert (recording / "configuration.yaml").exists()


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--port", "80000"], "at most 65535"),
        (["--host", "0.0.0.0"], "all addresses"),
        (["--host", "nowhere"], "not an IP address"),
    ],
)
def test_a_place_that_cannot_be_served_is_refused(words: list[str], problem: str) -> None:
    finished = omni_here(["drive", *words])
    assert finished.returncode == 2
    assert problem in finished.stderr
    assert len(finished.stderr.splitlines()) == 1


def test_what_cannot_be_driven_is_refused() -> None:
    finished = omni_here(["drive", "--vehicle", "mecanum_forklif"])
    assert finished.returncode == 2
    assert "did you mean 'mecanum_forklift'" in finished.stderr
    assert not finished.stdout
