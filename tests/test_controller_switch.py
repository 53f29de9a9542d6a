"""The brake adapter switches controllers when braking begins and ends."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from bystander import Bystander, vehicle_node
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState

from omni_ros.environment import node_environment
from omni_ros.messages import joint_state, stamped
from omni_ros.qos import RELIABLE
from omni_runs.graph.domain import reserved_domain

WHEELS = ("left", "right")
DRIVE, BRAKE = "mecanum_drive_controller", "brake_controller"
PARAMETERS = (
    *("-p", "wheels:=[left, right]", "-p", "kind:=torque", "-p", "pedal:=twist_stamped"),
    *("-p", f"drive_controller:={DRIVE}", "-p", f"brake_controller:={BRAKE}"),
    *("-r", f"cmd_vel:={DRIVE}/reference"),
)


class Robot(Bystander):
    """A controller manager with the rules of `ros2_control`, and the other nodes of a vehicle."""

    def __init__(self, domain: int, service: Any) -> None:
        super().__init__("robot", domain)
        self.active, self.refuses = {DRIVE}, False
        self.switches: list[tuple[list[str], list[str]]] = []
        self.status = ""
        create = self.node.create_publisher
        self._enable = create(JointState, "brake/enable", RELIABLE)
        self._joints = create(JointState, "joint_states", RELIABLE)
        self._reference = create(TwistStamped, f"{DRIVE}/reference", RELIABLE)
        self.speed = 0.5
        self.node.create_service(service, "controller_manager/switch_controller", self._switch)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._read, RELIABLE)
        self.node.create_timer(0.01, self._step)

    def description(self) -> str:
        return f"active {self.active}, {self.status}"

    def _read(self, message: DiagnosticArray) -> None:
        self.status = message.status[0].message

    def _switch(self, request: Any, response: Any) -> Any:
        on, off = set(request.activate_controllers), set(request.deactivate_controllers)
        possible = not on & self.active and off <= self.active
        response.ok = not self.refuses and (possible or request.strictness == request.BEST_EFFORT)
        if response.ok:
            self.active = (self.active - off) | on
            self.switches.append((sorted(on), sorted(off)))
        return response

    def _step(self) -> None:
        now_ns = self.node.get_clock().now().nanoseconds
        self._joints.publish(joint_state(now_ns, WHEELS, velocity=np.array([5.0, 5.0])))
        self._enable.publish(joint_state(now_ns, WHEELS, effort=np.ones(2)))
        reference = stamped(TwistStamped, now_ns, "base_link")
        reference.twist.linear.x = self.speed
        self._reference.publish(reference)


def test_the_drive_controller_has_the_wheels_only_while_no_braking_is_demanded() -> None:
    reason = "controller_manager_msgs is not in the packages of ROS from PyPI"
    service = pytest.importorskip("controller_manager_msgs.srv", reason=reason).SwitchController
    with (
        reserved_domain() as domain,
        vehicle_node(domain, "brake_adapter", *PARAMETERS),
        closing(Robot(domain, service)) as robot,
    ):
        robot.wait(lambda: robot.status == "follows the enables" and robot.active == {DRIVE})
        robot.switches.clear()
        robot.speed = 0.0
        robot.wait(lambda: robot.active == {BRAKE})
        robot.speed = 0.5
        robot.wait(lambda: robot.active == {DRIVE})
        assert robot.switches == [([BRAKE], [DRIVE]), ([DRIVE], [BRAKE])]
        robot.refuses, robot.speed = True, 0.0
        robot.wait(lambda: "does not switch to the brake controller" in robot.status)
        robot.refuses = False
        robot.wait(lambda: robot.active == {BRAKE} and robot.status == "follows the enables")


def test_missing_messages_of_the_controller_manager_are_named() -> None:
    if importlib.util.find_spec("controller_manager_msgs"):
        pytest.skip("controller_manager_msgs is installed")
    node = [sys.executable, "-m", "omni_vehicle.brake_adapter_node", "--ros-args", *PARAMETERS]
    with reserved_domain() as domain:
        finished = subprocess.run(
            node, env=node_environment(domain), capture_output=True, text=True, check=False
        )
    assert finished.returncode == 2
    assert "drive_controller: needs the messages of the controller manager" in finished.stderr
