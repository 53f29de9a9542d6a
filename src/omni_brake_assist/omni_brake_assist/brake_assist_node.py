"""The brake assistant as a ROS node: pedal and body twist in, per-wheel brake enables out.

The contract (topics, types, QoS, parameters, timeouts) is in the README of this package.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

from omni_brake_assist.brake_assist import (
    AssistState,
    BrakeAssist,
    BrakeAssistConfiguration,
    BrakeDemand,
    Decision,
    Feedback,
)
from omni_brake_assist.step_pairing import StepPairing
from omni_platform.configuration import Configuration, parameter
from omni_ros.messages import diagnostics, joint_state, planar_twist_of, to_nanoseconds
from omni_ros.parameters import declare_configuration
from omni_ros.process import Spinner, await_subscribers, run_process, spin_until_stopped
from omni_ros.qos import RELIABLE
from omni_ros.startup import StartupConfiguration


@dataclasses.dataclass(frozen=True, kw_only=True)
class TimingConfiguration(Configuration):
    """How the node pairs the driver's demand with the feedback."""

    lockstep: bool = parameter(
        False,
        description="Answer every pedal message with the feedback of the same step, however long "
        "it takes, instead of answering in real time",
    )


class BrakeAssistNode(Node):
    """Answers the driver's brake demand with the wheels that may brake."""

    def __init__(self) -> None:
        super().__init__("brake_assist")
        self.startup = declare_configuration(self, StartupConfiguration)
        self._lockstep = declare_configuration(self, TimingConfiguration).lockstep
        configuration = declare_configuration(self, BrakeAssistConfiguration)
        self._assist = BrakeAssist(configuration)
        self._wheels = tuple(configuration.wheels)
        self._demand: tuple[int, float] | None = None  # stamp [ns], pedal
        self._feedback: Feedback | None = None
        self._pairing = StepPairing()
        self._last_answer = time.monotonic()
        self._last_report: tuple[AssistState, AssistState | None] | None = None
        self._enable = self.create_publisher(JointState, "brake/enable", RELIABLE)
        self._error = self.create_publisher(JointState, "brake_assist/error", RELIABLE)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", RELIABLE)
        self.outputs = (self._enable, self._error)
        self.create_subscription(JointState, "brake/pedal", self._on_pedal, RELIABLE)
        self.create_subscription(
            TwistWithCovarianceStamped, "odometry/twist", self._on_twist, RELIABLE
        )
        self.create_subscription(JointState, "wheel_states", self._on_wheel_states, RELIABLE)
        self._timeout = configuration.feedback_timeout
        if not self._lockstep:
            self.create_timer(self._timeout / 2.0, self._watch)

    def _on_pedal(self, message: JointState) -> None:
        # A message without a value is no reason to brake less.
        pedal = float(message.position[0]) if message.position else math.nan
        self._demand = (to_nanoseconds(message.header.stamp), pedal)
        if self._lockstep:
            self._pairing.take_pedal(*self._demand)
            self._answer_step()

    def _on_twist(self, message: TwistWithCovarianceStamped) -> None:
        twist, covariance = planar_twist_of(message)
        self._feedback = Feedback(to_nanoseconds(message.header.stamp), twist, covariance)
        if self._lockstep:
            self._pairing.take_feedback(self._feedback)
            self._answer_step()
        elif self._demand is not None:
            self._answer(max(self._demand[0], self._feedback.stamp_ns))

    def _on_wheel_states(self, message: JointState) -> None:
        self._assist.check_wheel_names(message.name)

    def _answer_step(self) -> None:
        """Answer a demand once the feedback of its step is there."""
        demand = self._pairing.next_demand()
        if demand is not None:
            self._publish(self._assist.update(demand))
            self._last_answer = time.monotonic()

    def _watch(self) -> None:
        """Answer in place of feedback that has fallen silent."""
        silence = time.monotonic() - self._last_answer
        if self._demand is None or silence < self._timeout:
            return
        self._publish(
            self._assist.timeout(self._demand[0], f"no twist to answer for {silence:.2f} s")
        )

    def _answer(self, stamp_ns: int) -> None:
        if self._demand is None:
            return
        self._publish(self._assist.update(BrakeDemand(stamp_ns, self._demand[1], self._feedback)))
        self._last_answer = time.monotonic()

    def _publish(self, decision: Decision) -> None:
        stamp_ns = decision.stamp_ns
        self._enable.publish(joint_state(stamp_ns, self._wheels, effort=decision.enable))
        self._error.publish(joint_state(stamp_ns, self._wheels, velocity=decision.error))
        self._report(decision)

    def _report(self, decision: Decision) -> None:
        fault = decision.fault.state if decision.fault is not None else None
        report = (decision.state, fault)
        if report == self._last_report:
            return
        self._last_report = report
        self._diagnostics.publish(
            diagnostics(
                decision.stamp_ns,
                self.get_name(),
                decision.state.level,
                decision.reason,
                {"state": decision.state.value, "fault": fault.value if fault else ""},
            )
        )


def main() -> None:
    """Run the node until SIGINT or SIGTERM."""

    def run(node: BrakeAssistNode, spinner: Spinner) -> None:
        await_subscribers(
            node.outputs, node.startup.subscribers, spinner, node.startup.match_timeout
        )
        spin_until_stopped(node, spinner)

    sys.exit(run_process(BrakeAssistNode, run))


if __name__ == "__main__":
    main()
