"""`check-vehicle live`: a drive over topics is evaluated as soon as the vehicle is at rest."""

from __future__ import annotations

import json
import subprocess
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from bystander import Bystander
from omni_process import WORKSPACE, omni_command, omni_environment
from rclpy.duration import Duration
from sensor_msgs.msg import JointState

from omni_bringup.cli import main
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray
from omni_ros.messages import joint_state
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph.domain import reserved_domain
from omni_tools.commissioning.drive_node import receive_drive
from omni_tools.node_check.exchange_node import Partner

EXPERIMENT = ExperimentLibrary(WORKSPACE / "config").load("commissioning", "assisted")
WHEELS = tuple(EXPERIMENT.vehicle.wheels)
PERIOD_NS = 10_000_000
STEPS = 2050


class Vehicle(Bystander):
    """A vehicle whose wheels roll as demanded and slow down when the pedal is down."""

    def __init__(self, domain: int) -> None:
        super().__init__("vehicle", domain)
        self.states = self.node.create_publisher(JointState, "robot1/wheel_states", RELIABLE)
        self.pedal = self.node.create_publisher(JointState, "robot1/brake/pedal", RELIABLE)

    def description(self) -> str:
        return "no node subscribed"

    def drive(self, signs: FloatArray, every: int = 1) -> FloatArray:
        """Publish the drive; return the published wheel speeds [rad/s].

        Args:
            signs: sign with which each wheel speed is published, shape (4,).
            every: number of steps from one publication to the next.
        """
        demands = EXPERIMENT.maneuver.demands
        assert demands is not None
        kinematics = PlatformKinematics.of(EXPERIMENT.vehicle.wheels)
        braked, speeds = np.zeros(3), []
        for step in range(STEPS):
            now = 0.01 * step
            columns = (demands.forward, demands.left, demands.turn, demands.pedal)
            *twist, pedal = (np.interp(now, demands.time, column) for column in columns)
            braked = 0.95 * braked if pedal > 0.0 else np.array(twist)
            if step % every:
                continue
            speed = signs * kinematics.wheel_speeds(braked)
            speeds.append(speed)
            stamp_ns = step * PERIOD_NS
            self.states.publish(joint_state(stamp_ns, WHEELS, velocity=speed))
            self.pedal.publish(joint_state(stamp_ns, ("pedal",), position=np.array([pedal])))
            if step % 100 == 0:  # before the queue of a publisher is full
                self.states.wait_for_all_acked(Duration(seconds=30))
                self.pedal.wait_for_all_acked(Duration(seconds=30))
            time.sleep(0.003)  # paced, so that a subscriber keeps up
        return np.array(speeds)


@pytest.mark.parametrize(
    ("signs", "found"),
    [((1, 1, 1, 1), []), ((1, -1, 1, 1), [f"direction of wheel {WHEELS[1]} is wrong"])],
)
def test_a_live_drive_is_judged(signs: tuple[int, ...], found: list[str], tmp_path: Path) -> None:
    words = ["check-vehicle", "live", "--vehicle", "mecanum_forklift", "--namespace", "robot1"]
    words += ["--out", str(tmp_path / "corrected.yaml")]
    with reserved_domain() as domain, closing(Vehicle(domain)) as vehicle:
        process = subprocess.Popen(
            omni_command([*words, "--json"]),
            env=omni_environment() | {"ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            count = vehicle.node.count_subscribers
            vehicle.wait(lambda: count("robot1/wheel_states") and count("robot1/brake/pedal"))
            vehicle.drive(np.array(signs, np.float64), every=2)
            document = json.loads(process.communicate(timeout=60.0)[0])
        finally:
            process.kill()
    assert [mistake["name"] for mistake in document["mistakes"]] == found
    assert set(document["unchecked"]) == {"odometry/twist", "imu", "brake/enable"}
    assert process.returncode == bool(found)
    assert bool(list(tmp_path.iterdir())) == bool(found)


class BusyPartner(Partner):
    """A receiver that processes no message while the vehicle drives."""

    def __init__(self, domain: int, vehicle: Vehicle) -> None:
        super().__init__(domain, "robot1")
        self.vehicle = vehicle
        self.published: FloatArray | None = None

    def spin(self, until: float) -> None:
        count = self.vehicle.node.count_subscribers
        subscribed = count("robot1/wheel_states") and count("robot1/brake/pedal")
        if self.published is None and subscribed:
            self.published = self.vehicle.drive(np.ones(4))
        super().spin(until)


def test_no_message_of_a_drive_is_lost_while_the_receiver_is_busy() -> None:
    with reserved_domain() as domain, closing(Vehicle(domain)) as vehicle:
        with closing(BusyPartner(domain, vehicle)) as partner:
            signals = receive_drive(partner, WHEELS, timeout=60.0)
        assert partner.published is not None
        np.testing.assert_allclose(signals.wheel_speed, partner.published[:-1], atol=1e-9)


@pytest.mark.parametrize("namespace", ["é", "robot 1", "1st", "robot1//rear", "robot1/"])
def test_a_namespace_that_ros_rejects_is_refused(
    namespace: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["check-vehicle", "live", "--vehicle", "mecanum_forklift", "--namespace", namespace])
    assert ended.value.code == 2
    assert f"--namespace: {namespace!r} must not" in capsys.readouterr().err
