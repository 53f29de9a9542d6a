"""`estimate-load live`: a load is estimated and published while the vehicle drives."""

from __future__ import annotations

import json
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
from bystander import Bystander
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TwistWithCovarianceStamped
from omni_process import WORKSPACE, omni_command, omni_environment
from sensor_msgs.msg import JointState

from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import GRAVITY
from omni_ros.messages import joint_state, to_time
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph.domain import reserved_domain

FORKLIFT = ExperimentLibrary(WORKSPACE / "config").vehicle("mecanum_forklift")
WHEELS = tuple(FORKLIFT.wheels)
PERIOD_NS = 10_000_000


class Rolling(Bystander):
    """A vehicle that rolls straight ahead at 1 m/s on wheels that are compressed by its load."""

    def __init__(self, domain: int) -> None:
        super().__init__("vehicle", domain)
        create = self.node.create_publisher
        self.states = create(JointState, "robot1/wheel_states", RELIABLE)
        self.pedal = create(JointState, "robot1/brake/pedal", RELIABLE)
        self.twist = create(TwistWithCovarianceStamped, "robot1/odometry/twist", RELIABLE)
        self.warnings: list[DiagnosticStatus] = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._keep, RELIABLE)
        masses = FORKLIFT.masses
        position = np.array([(one.x, one.y) for one in FORKLIFT.wheels.values()])
        # Four equal springs at the corners of a rectangle share the moments of the weight.
        share = 0.25 * (1.0 + (position / position[1] ** 2) @ masses.center)
        radius = 0.2 - share * masses.mass * GRAVITY / FORKLIFT.tire.vertical_stiffness
        kinematics = PlatformKinematics.of(FORKLIFT.wheels)
        self.speeds = kinematics.wheel_speeds(np.array([1.0, 0.0, 0.0]), radius)

    def description(self) -> str:
        return "no warning was published"

    def _keep(self, message: DiagnosticArray) -> None:
        self.warnings += [one for one in message.status if one.name == "estimate_load"]

    def publish(self, step: int) -> None:
        stamp = step * PERIOD_NS
        self.states.publish(joint_state(stamp, WHEELS, velocity=self.speeds))
        self.pedal.publish(joint_state(stamp, ("pedal",), position=np.zeros(1)))
        moved = TwistWithCovarianceStamped()
        moved.header.stamp = to_time(stamp)
        moved.twist.twist.linear.x = 1.0
        self.twist.publish(moved)
        self._executor.spin_once(timeout_sec=0.01)


def test_a_live_drive_warns_before_the_load_swerves(tmp_path: Path) -> None:
    words = ["estimate-load", "live", "--vehicle", "mecanum_forklift", "--namespace", "robot1"]
    words += ["--duration", "10", "--speed", "10", "--out", str(tmp_path / "v.yaml"), "--json"]
    with reserved_domain() as domain, closing(Rolling(domain)) as vehicle:
        process = subprocess.Popen(
            omni_command(words),
            env=omni_environment() | {"ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            subscribers = vehicle.node.count_subscribers
            vehicle.wait(lambda: subscribers("robot1/odometry/twist"))
            step = 0
            while process.poll() is None:
                vehicle.publish(step)
                step += 1
            output, _ = process.communicate(timeout=30.0)
        finally:
            process.kill()
    assert process.returncode == 0
    metrics = json.loads(output)["metrics"]
    assert abs(metrics["mass.load"]["value"] - 250.0) < 25.0
    assert vehicle.warnings
    assert vehicle.warnings[-1].level == DiagnosticStatus.WARN
    assert "turns the vehicle" in vehicle.warnings[-1].message
