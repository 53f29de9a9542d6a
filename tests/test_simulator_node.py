"""The simulator as a node: with invalid or ambiguous enables it applies all brakes."""

from __future__ import annotations

import dataclasses
import os
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bystander import Bystander
from geometry_msgs.msg import TwistWithCovarianceStamped
from omni_process import WORKSPACE
from rcl_interfaces.srv import SetParameters
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import Imu, JointState

from omni_ros.environment import node_environment
from omni_ros.messages import joint_state, to_nanoseconds
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup, RunningProcess


class Assistant(Bystander):
    """An assistant that releases every brake."""

    def __init__(self, domain: int, wheels: tuple[str, ...], process: RunningProcess) -> None:
        super().__init__("brake_assist", domain)
        self.process = process
        self.wheels = wheels
        self.torque = np.zeros(len(wheels))
        self.stamp = 0
        self.released = 0  # newest stamp at which not every brake acted [ns]
        self.answers = True
        self.names = wheels[::-1]  # in any order: the names count
        self.efforts = np.zeros(len(wheels))
        self._enable = self.node.create_publisher(JointState, "brake/enable", RELIABLE)
        self.node.create_subscription(JointState, "wheel_states", self._on_wheels, RELIABLE)

    def description(self) -> str:
        return f"torque {self.torque} at {self.stamp}; {self.process.error_output()}"

    def _on_wheels(self, message: JointState) -> None:
        self.torque = np.array(message.effort)
        self.stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if not self.torque.all():
            self.released = self.stamp
        if self.answers:
            self._enable.publish(joint_state(self.stamp, self.names, effort=self.efforts))


@pytest.fixture
def assistant(tmp_path: Path) -> Iterator[Assistant]:
    """A simulator in real time, in a separate domain, just before braking.

    The vehicle is so fast that it does not stop while a busy machine delays the answers.
    """
    configuration = ExperimentLibrary(WORKSPACE / "config").load(
        "straight_line",
        "assisted",
        [
            "feedback=velocity_sensor",
            "simulation.render_lines=false",
            "simulation.duration_limit=60",
            "maneuver.speed=40",
        ],
    )
    process = graph.Nodes(configuration, tmp_path).simulator(listeners=0)
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        running = group.start(process)
        with closing(Assistant(domain, tuple(configuration.vehicle.wheels), running)) as assistant:
            assistant.wait(lambda: assistant.stamp > 0)
            yield assistant


def test_a_subscriber_with_a_deadline_is_notified_of_a_simulator_that_hangs(tmp_path: Path) -> None:
    overrides = ["feedback=velocity_sensor", "simulation.render_lines=false"]
    configuration = ExperimentLibrary(WORKSPACE / "config").load(
        "straight_line", "assisted", overrides
    )
    process = graph.Nodes(configuration, tmp_path).simulator(driven=True, listeners=0)
    offered = ["-p", "qos_overrides./brake/pedal.publisher.deadline:=300000000"]
    process = dataclasses.replace(process, arguments=[*process.arguments, *offered])
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        running = group.start(process)
        with closing(Valve(domain)) as valve:
            valve.wait(lambda: valve.pedals > 50)
            os.kill(running.pid, signal.SIGSTOP)
            try:
                missed = valve.missed
                valve.wait(lambda: valve.missed > missed)
            finally:
                os.kill(running.pid, signal.SIGCONT)


class Valve(Bystander):
    """Requests a pedal message at least every half second, and counts missed deadlines."""

    def __init__(self, domain: int) -> None:
        super().__init__("valve", domain)
        self.pedals = self.missed = 0
        self.node.create_subscription(
            JointState,
            "brake/pedal",
            self._on_pedal,
            QoSProfile(depth=10, deadline=Duration(nanoseconds=500_000_000)),
            event_callbacks=SubscriptionEventCallbacks(deadline=self._on_deadline),
        )

    def description(self) -> str:
        return f"{self.pedals} pedals, {self.missed} missed"

    def _on_pedal(self, _message: JointState) -> None:
        self.pedals += 1

    def _on_deadline(self, _event: object) -> None:
        self.missed += 1


def test_a_run_begins_when_the_assistant_receives_every_input(tmp_path: Path) -> None:
    overrides = ["feedback=velocity_sensor", "simulation.render_lines=false"]
    configuration = ExperimentLibrary(WORKSPACE / "config").load(
        "straight_line", "assisted", overrides
    )
    process = graph.Nodes(configuration, tmp_path).simulator(listeners=1, lines_recorded=False)
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        group.start(process)
        with closing(Inputs(domain)) as inputs:
            inputs.subscribe(JointState, "wheel_states", "brake/pedal")
            inputs.subscribe(TwistWithCovarianceStamped, "velocity_sensor/twist")
            inputs.wait(lambda: all(one.get_publisher_count() for one in inputs.subscribed))
            inputs.catch_up(lambda: len(inputs.first))
            inputs.subscribe(Imu, "imu")
            inputs.wait(lambda: len(inputs.first) == 4)
    assert set(inputs.first.values()) == {0}


class Inputs(Bystander):
    """Notes the first stamp [ns] of each topic."""

    def __init__(self, domain: int) -> None:
        super().__init__("brake_assist", domain)
        self.first: dict[str, int] = {}
        self.subscribed: list[Subscription] = []

    def description(self) -> str:
        return f"first stamps {self.first}"

    def subscribe(self, kind: type, *names: str) -> None:
        for name in names:
            note = partial(self._note, name)
            self.subscribed.append(self.node.create_subscription(kind, name, note, RELIABLE))

    def _note(self, name: str, message: Any) -> None:
        self.first.setdefault(name, to_nanoseconds(message.header.stamp))


@pytest.mark.safety(
    "brakes act late",
    "the assistant sends no more enables while all brakes are released",
    "the valves apply all brakes after a timeout",
    within="`enable_timeout`",
)
def test_missing_enables_apply_all_brakes(assistant: Assistant) -> None:
    assistant.wait(lambda: assistant.stamp > 1.5e9 and not assistant.torque.any())
    assistant.answers, last = False, assistant.stamp
    assistant.wait(lambda: bool(assistant.torque.all()))
    assert assistant.released - last < 80_000_000  # 50 ms, rounded up to whole steps


def test_a_simulator_that_was_halted_continues_at_the_speed_of_the_clock(
    assistant: Assistant,
) -> None:
    start = time.monotonic()
    os.kill(assistant.process.pid, signal.SIGSTOP)
    try:
        assistant.catch_up(lambda: assistant.stamp)
        first = assistant.stamp
        time.sleep(1.0)
    finally:
        os.kill(assistant.process.pid, signal.SIGCONT)
    assistant.wait(lambda: assistant.stamp > first + 1.5e9)
    # Only a lower bound of the duration is tested: the halt and most of the simulated time.
    assert time.monotonic() - start > 1.0 + 1.0


def test_invalid_enables_release_no_brake(assistant: Assistant) -> None:
    wheels, released = assistant.wheels, np.zeros(len(assistant.wheels))
    for names, efforts in (
        (wheels, released - 1.0),
        (wheels, released + np.nan),
        (wheels, released[1:]),
        ((*wheels, wheels[0]), np.zeros(len(wheels) + 1)),
    ):
        assistant.names, assistant.efforts = wheels, released
        assistant.wait(lambda: not assistant.torque.any())
        assistant.names, assistant.efforts = names, efforts
        assistant.wait(lambda: bool(assistant.torque.all()))


@pytest.mark.safety(
    "a command of a second publisher acts",
    "a second publisher of enables",
    "the valves apply all brakes while two publishers are matched",
    within="the discovery of the publisher",
)
def test_two_publishers_of_enables_put_all_brakes_on(assistant: Assistant) -> None:
    assistant.wait(lambda: not assistant.torque.any())
    given = Parameter("use_sim_time", value=True).to_parameter_msg()
    request = SetParameters.Request(parameters=[given])
    (result,) = assistant.call(SetParameters, "/simulator/set_parameters", request).results
    assert result.successful
    asked = assistant.stamp
    assistant.wait(lambda: assistant.stamp > asked + 10**8)
    rival = assistant.node.create_publisher(JointState, "brake/enable", RELIABLE)
    assistant.wait(lambda: bool(assistant.torque.all()))
    assistant.node.destroy_publisher(rival)
    assistant.wait(lambda: not assistant.torque.any())
    assert assistant.process.returncode is None


class Joints(Bystander):
    """Receives the angles for `robot_state_publisher`."""

    def __init__(self, domain: int) -> None:
        super().__init__("joints", domain)
        self.angles: dict[str, float] = {}
        self.steering: dict[str, float] = {}
        self.node.create_subscription(JointState, "joint_states", self._on_joints, RELIABLE)
        self.node.create_subscription(JointState, "steering_states", self._on_steering, RELIABLE)

    def _on_joints(self, message: JointState) -> None:
        self.angles = dict(zip(message.name, message.position, strict=True))

    def _on_steering(self, message: JointState) -> None:
        self.steering = dict(zip(message.name, message.position, strict=True))


def test_joint_states_contain_the_steering_joints(tmp_path: Path) -> None:
    overrides = [
        "feedback=velocity_sensor",
        "simulation.render_lines=false",
        "simulation.duration_limit=60",
        "maneuver.demands.time=[0, 0.5, 60]",
        "maneuver.demands.forward=[0, 0.5, 0.5]",
        "maneuver.demands.left=[0, 0, 0]",
        "maneuver.demands.turn=[0, 0.5, 0.5]",
        "maneuver.demands.pedal=[0, 0, 0]",
    ]
    library = ExperimentLibrary(WORKSPACE / "config")
    configuration = library.load("steered_forklift", "unassisted", overrides)
    process = graph.Nodes(configuration, tmp_path).simulator(driven=True, listeners=0)
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        group.start(process)
        with closing(Joints(domain)) as joints:
            joints.wait(lambda: bool(joints.angles) and bool(joints.steering))
            wheels = set(configuration.vehicle.wheels)
            steered = {"rear_left_steering", "rear_right_steering"}
            assert set(joints.angles) == wheels | steered
            assert set(joints.steering) == wheels
