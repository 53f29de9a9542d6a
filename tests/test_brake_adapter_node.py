"""The brake adapter between an assistant and a `forward_command_controller`'s messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
import pytest
from bystander import Bystander, vehicle_node
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, Float64MultiArray

from omni_ros.messages import joint_state
from omni_ros.qos import RELIABLE
from omni_runs.graph.domain import reserved_domain

WHEELS = ("left", "right")
JOINTS = ("left_joint", "right_joint")


class Controllers(Bystander):
    """The other nodes of a vehicle: assistant, joint states, drive, and a controller."""

    def __init__(self, domain: int, array: bool) -> None:
        super().__init__("controllers", domain)
        self.domain = domain
        create = self.node.create_publisher
        self.enable = create(JointState, "brake/enable", RELIABLE)
        self.joints = create(JointState, "joint_states", RELIABLE)
        self.drive = create(Float64MultiArray, "drive_commands", RELIABLE)
        self.twist = create(Twist, "cmd_vel", RELIABLE)
        self.estop = create(Bool, "estop", RELIABLE)
        kind = Float64MultiArray if array else JointState
        self.commands: list[list[float]] = []
        self.states: list[JointState] = []
        self.pedals: list[float] = []
        listen = self.node.create_subscription
        listen(kind, "commands", self._obey, RELIABLE)
        listen(JointState, "wheel_states", self.states.append, RELIABLE)
        listen(JointState, "brake/pedal", lambda m: self.pedals.append(m.position[0]), RELIABLE)
        self.problems: list[str] = []
        self.enables: tuple[float, ...] | None = (1.0, 1.0)
        self.names: tuple[str, ...] = WHEELS
        self.driven = [3.0, -3.0]
        self.joint_names = (*JOINTS, "arm_joint")
        self.speed, self.commanded, self.pressed = (5.0, -5.0), 0.5, False
        self.node.create_timer(0.01, self._step)

    def _obey(self, message: Float64MultiArray | JointState) -> None:
        values = message.data if isinstance(message, Float64MultiArray) else message.effort
        self.commands.append(list(values))

    def diagnose(self, message: DiagnosticArray) -> None:
        self.problems += [status.message for status in message.status]

    def _step(self) -> None:
        now_ns = self.node.get_clock().now().nanoseconds
        order = [1, 0, 2]  # as a broadcaster may have it
        speed = np.array([*self.speed, 9.0])[order]
        names = [self.joint_names[row] for row in order]
        self.joints.publish(joint_state(now_ns, names, position=np.zeros(3), velocity=speed))
        self.drive.publish(Float64MultiArray(data=self.driven))
        message = Twist()
        message.linear.x = self.commanded
        self.twist.publish(message)
        self.estop.publish(Bool(data=self.pressed))
        if self.enables is not None:
            self.enable.publish(joint_state(now_ns, self.names, effort=np.array(self.enables)))

    def description(self) -> str:
        return f"commands {self.commands[-3:]}, pedals {self.pedals[-3:]}"

    def until(self, *command: float) -> None:
        self.commands.clear()
        self.wait(lambda: self.commands and np.allclose(self.commands[-1], command, atol=1e-9))


@contextmanager
def vehicle(array: bool, **parameters: object) -> Iterator[Controllers]:
    given = {"wheels": list(WHEELS), "joints": list(JOINTS), "pedal": "twist", "estop": True}
    given |= {"output": "array" if array else "joint_state", **parameters}
    words = [word for key, value in given.items() for word in ("-p", f"{key}:={_yaml(value)}")]
    with (
        reserved_domain() as domain,
        vehicle_node(domain, "brake_adapter", *words),
        closing(Controllers(domain, array)) as controllers,
    ):
        yield controllers


def _yaml(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value).replace("'", '"')


def test_torque_drives_brake_by_sign_and_drive_again() -> None:
    with vehicle(True, kind="torque", max_torque=8.0) as rest:
        rest.until(3.0, -3.0)  # the drive's own command passes
        rest.wait(lambda: rest.states)
        assert list(rest.states[-1].name) == list(WHEELS)
        assert list(rest.states[-1].velocity) == [5.0, -5.0]
        rest.commanded = 0.0
        rest.enables = (1.0, 0.0)
        rest.until(-8.0, 0.0)
        rest.wait(lambda: rest.pedals[-1:] == [1.0])
        rest.names, rest.enables = ("left", "right", "right"), (0.0, 1.0, 0.0)
        rest.until(0.0, 8.0)  # a repeated name is ambiguous
        rest.names = WHEELS
        rest.commanded, rest.enables = float("nan"), (1.0, 1.0)
        rest.until(-8.0, 8.0)  # a command that is not a number brakes
        rest.commanded = 0.5
        rest.until(3.0, -3.0)
        rest.enables = None  # the assistant has died
        rest.until(-8.0, 8.0)
        rest.pedals.clear()
        rest.wait(lambda: rest.pedals[-1:] == [1.0])  # the demand that the brakes follow


def test_spring_brakes_are_released_by_those_who_agree_alone() -> None:
    with vehicle(False, kind="spring") as rest:
        rest.until(1.0, 1.0)
        rest.pressed = True  # the driver goes on, the emergency stop brakes
        rest.until(0.0, 0.0)
        rest.enables = (0.0, 1.0)
        rest.until(1.0, 0.0)
        rest.enables = (float("nan"), 1.0)
        rest.until(0.0, 0.0)


@pytest.mark.parametrize("silent", ["twist", "estop", "enable"])
def test_an_input_that_stops_sending_applies_all_brakes(silent: str) -> None:
    with vehicle(False, kind="spring") as rest:
        rest.until(1.0, 1.0)
        publisher = getattr(rest, silent)
        rest.node.destroy_publisher(publisher)
        other = rest.node.create_publisher(publisher.msg_type, "another_topic", RELIABLE)
        setattr(rest, silent, other)
        rest.until(0.0, 0.0)


def test_velocity_drives_stop_along_their_ramp_when_the_emergency_stop_is_pressed() -> None:
    with vehicle(True, kind="velocity", ramp=50.0) as rest:
        rest.until(3.0, -3.0)  # the drive's own command passes
        rest.pressed = True
        rest.until(0.0, 0.0)
        ramp = [left for left, right in rest.commands if left != 3.0 and left == -right]
        assert ramp[0] <= rest.speed[0]  # from the measured speed on
        assert ramp == sorted(ramp, reverse=True)
        rest.pressed, rest.enables = False, (0.0, 1.0)
        rest.commanded = 0.0
        rest.until(5.0, 0.0)  # a released wheel is commanded its own speed
        rest.node.create_subscription(DiagnosticArray, "/diagnostics", rest.diagnose, RELIABLE)
        rest.commanded, rest.speed = 0.5, (float("nan"), float("nan"))
        rest.until(3.0, -3.0)
        rest.wait(lambda: any("no speed of left, right:" in one for one in rest.problems))
        rest.pressed = True
        rest.until(0.0, 0.0)
        assert any(1.0 < left < 3.0 for left, _ in rest.commands)  # from the last command on


def test_a_wheel_without_a_speed_is_named() -> None:
    with vehicle(False, kind="torque") as rest:
        rest.node.create_subscription(DiagnosticArray, "/diagnostics", rest.diagnose, RELIABLE)
        rest.speed = (1.0, float("nan"))
        rest.wait(lambda: any("no speed of right:" in one for one in rest.problems))


def test_proportional_brakes_follow_the_demand_of_the_pedal_and_the_shares() -> None:
    with vehicle(True, kind="proportional", pedal="float", estop=False) as rest:
        pedal = rest.node.create_publisher(Float64, "pedal_input", RELIABLE)
        demand = Float64(data=0.8)
        rest.node.create_timer(0.01, lambda: pedal.publish(demand))
        rest.until(0.8, 0.8)
        rest.enables = (0.5, 0.0)
        rest.until(0.4, 0.0)
        rest.wait(lambda: rest.pedals[-1:] == [0.8])
        demand.data = 1.5  # no demand is beyond the full one
        rest.until(0.5, 0.0)
        rest.enables = None
        rest.until(1.0, 1.0)


def test_a_second_adapter_for_the_coils_follows_the_first() -> None:
    with vehicle(True, kind="velocity") as rest:
        rest.until(3.0, -3.0)
        coils: list[list[float]] = []
        listen = rest.node.create_subscription
        listen(Float64MultiArray, "coils", lambda m: coils.append(list(m.data)), RELIABLE)
        words = "-r __node:=coils -r commands:=coils -r wheel_states:=unused -p kind:=spring"
        named = "-p wheels:=[left,right] -p joints:=[left_joint,right_joint]"
        with vehicle_node(rest.domain, "brake_adapter", *words.split(), *named.split()):
            rest.wait(lambda: coils[-1:] == [[1.0, 1.0]])
            rest.enables, rest.pressed = (0.0, 1.0), True
            rest.wait(lambda: coils[-1:] == [[1.0, 0.0]])
            rest.until(5.0, 0.0)  # no second publisher of wheel_states or of the pedal
            rest.wait(lambda: rest.states)


def test_a_bool_demands_full_braking() -> None:
    with vehicle(True, kind="proportional", pedal="bool", estop=False) as rest:
        pedal = rest.node.create_publisher(Bool, "pedal_input", RELIABLE)
        demand = Bool(data=True)
        rest.node.create_timer(0.01, lambda: pedal.publish(demand))
        rest.enables = (0.5, 1.0)
        rest.until(0.5, 1.0)
        demand.data = False
        rest.until(0.0, 0.0)


def test_a_stamped_command_of_zero_brakes() -> None:
    with vehicle(True, kind="torque", max_torque=8.0, pedal="twist_stamped") as rest:
        rest.node.destroy_publisher(rest.twist)  # a topic has one type
        rest.twist = rest.node.create_publisher(Twist, "unheard", RELIABLE)
        stamped = rest.node.create_publisher(TwistStamped, "cmd_vel", RELIABLE)
        command = TwistStamped()
        command.twist.angular.z = 0.2
        rest.node.create_timer(0.01, lambda: stamped.publish(command))
        rest.until(3.0, -3.0)
        command.twist.angular.z = 0.0
        rest.until(-8.0, 8.0)


def test_a_joint_that_is_never_named_applies_all_brakes_and_is_reported() -> None:
    wrong = ["left_joint", "rihgt_joint"]
    with vehicle(False, kind="spring", joints=wrong) as rest:
        rest.node.create_subscription(DiagnosticArray, "/diagnostics", rest.diagnose, RELIABLE)
        words = "never named rihgt_joint exactly once, only right_joint, left_joint, arm_joint"
        rest.wait(lambda: any(words in problem for problem in rest.problems))
        rest.wait(lambda: rest.enables is not None and rest.pedals[-5:] == [1.0] * 5)
        rest.until(0.0, 0.0)
        assert [1.0, 1.0] not in rest.commands


def test_a_drive_command_of_another_length_is_reported() -> None:
    with vehicle(True, kind="torque") as rest:
        rest.node.create_subscription(DiagnosticArray, "/diagnostics", rest.diagnose, RELIABLE)
        rest.until(3.0, -3.0)
        rest.driven = [3.0, -3.0, 3.0, -3.0]
        rest.until(0.0, 0.0)
        rest.wait(lambda: any("must contain 2 values" in problem for problem in rest.problems))


def test_a_joint_that_is_named_twice_applies_all_brakes_and_is_reported() -> None:
    with vehicle(False, kind="spring") as rest:
        rest.joint_names = (*JOINTS, JOINTS[0])
        rest.node.create_subscription(DiagnosticArray, "/diagnostics", rest.diagnose, RELIABLE)
        words = f"never named {JOINTS[0]} exactly once, only {JOINTS[1]}"
        rest.wait(lambda: any(words in problem for problem in rest.problems))
        rest.until(0.0, 0.0)
        assert [1.0, 1.0] not in rest.commands
        assert not rest.states


@pytest.mark.parametrize(
    ("kind", "topic"),
    [(JointState, "brake/enable"), (Bool, "estop"), (Float64MultiArray, "commands")],
)
def test_a_second_publisher_applies_all_brakes_and_is_reported(kind: type[Any], topic: str) -> None:
    with vehicle(True, kind="spring") as rest:
        rest.node.create_subscription(DiagnosticArray, "/diagnostics", rest.diagnose, RELIABLE)
        rest.until(1.0, 1.0)
        second = rest.node.create_publisher(kind, topic, RELIABLE)
        rest.until(0.0, 0.0)
        rest.wait(lambda: any(f"{topic} has more than one" in words for words in rest.problems))
        rest.node.destroy_publisher(second)
        rest.until(1.0, 1.0)
