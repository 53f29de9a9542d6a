"""One flow sensor and a gyro measure the twist, with the parameters of the vehicle's file."""

from __future__ import annotations

from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest
from bystander import Bystander, vehicle_node
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from omni_process import omni_here
from sensor_msgs.msg import Imu

from omni_core.sensors import FlowSensor, sensor_matrix
from omni_core.signals import UNMEASURED_VARIANCE
from omni_ros.messages import planar_twist_with_covariance, stamped, twist_of
from omni_ros.qos import RELIABLE
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.hardware import ARGUMENTS, HardwareNode, hardware_nodes

WHEELS = """
wheels:
  front_left:  {x:  0.17, y:  0.15, roller_angle_deg: -45, radius: 0.048}
  front_right: {x:  0.17, y: -0.15, roller_angle_deg:  45, radius: 0.048}
  rear_left:   {x: -0.17, y:  0.15, roller_angle_deg:  45, radius: 0.048}
  rear_right:  {x: -0.17, y: -0.15, roller_angle_deg: -45, radius: 0.048}
"""
OTOS = (
    WHEELS
    + """
flow_sensors:
  otos: {x: 0.1016, y: -0.0508, heading_deg: -90, maximum_speed: 2.5}
"""
)
PMW3901 = (
    WHEELS
    + """
flow_sensors:
  chip: {x: 0.36, y: 0.0, heading_deg: 0}
twist_adapter: {gyro: imu, odom: true}
brake_assist: {imu_rotation_deg: [0, 180, 0]}
"""
)
TWIST = np.array([0.4, -0.3, 0.9])
DEVIATION = 0.01


class Robot(Bystander):
    """A vehicle that turns, with a flow sensor, and with an IMU that is mounted upside down."""

    def __init__(self, domain: int, name: str, sensor: FlowSensor, *, has_gyro: bool) -> None:
        super().__init__("robot", domain)
        create = self.node.create_publisher
        self._flow = create(TwistWithCovarianceStamped, f"board/{name}", RELIABLE)
        self._imu = create(Imu, "imu/data", RELIABLE)
        self.measured = np.append(sensor_matrix({name: sensor}) @ TWIST, TWIST[2])
        self.variance = np.full(3, DEVIATION**2)
        if not has_gyro:
            self.measured[2], self.variance[2] = 0.0, UNMEASURED_VARIANCE
        self.has_imu = True
        self.twists: list[TwistWithCovarianceStamped] = []
        self.poses: list[Odometry] = []
        self.status = ""
        listen = self.node.create_subscription
        listen(TwistWithCovarianceStamped, "odometry/twist", self.twists.append, RELIABLE)
        listen(Odometry, "odom", self.poses.append, RELIABLE)
        listen(DiagnosticArray, "/diagnostics", self._read, RELIABLE)
        self.node.create_timer(0.01, self._step)

    def description(self) -> str:
        return f"{len(self.twists)} twists, {self.status}"

    def _read(self, message: DiagnosticArray) -> None:
        self.status = message.status[0].message

    def _step(self) -> None:
        now_ns = self.node.get_clock().now().nanoseconds
        if self.has_imu:
            reading = stamped(Imu, now_ns, "imu_link")
            reading.angular_velocity.z = -TWIST[2]
            self._imu.publish(reading)
        flow = planar_twist_with_covariance(now_ns, self.measured, np.diag(self.variance))
        flow.header.frame_id = "sensor"
        self._flow.publish(flow)


def nodes(file: str, folder: Path, *words: str) -> list[HardwareNode]:
    """Return the nodes of a launch with the parameters of a vehicle's file."""
    (folder / "robot.yaml").write_text(file, encoding="utf-8")
    finished = omni_here(["ros-params", str(folder / "robot.yaml"), "--out", str(folder / "out")])
    assert finished.returncode == 0, finished.stderr
    defaults = {name: default or "" for name, (default, _) in ARGUMENTS.items()}
    given = dict(word.split(":=") for word in words) | {"parameters": str(folder / "out")}
    return hardware_nodes(defaults | given)


def arguments(node: HardwareNode) -> list[str]:
    """Return the arguments with which a launch starts a node."""
    files = [word for file in node.files for word in ("--params-file", str(file))]
    return [*files, *(w for old, new in node.remappings for w in ("-r", f"{old}:={new}"))]


@pytest.mark.parametrize("file", [OTOS, PMW3901], ids=["otos", "pmw3901_and_imu"])
def test_a_sensor_off_the_center_and_a_gyro_measure_the_whole_twist(
    file: str, tmp_path: Path
) -> None:
    renamed = "flow:=board/<sensor>", "imu:=imu/data"
    adapter, assistant = nodes(file, tmp_path, *renamed)
    assert (adapter.package, adapter.executable) == ("omni_vehicle", "twist_adapter")
    assert ("imu", "imu/data") in assistant.remappings
    own = file == OTOS
    assert ("shared_gyro: true" in assistant.files[0].read_text()) is not own
    name = "otos" if own else "chip"
    sensor = FlowSensor(x=0.1016, y=-0.0508, heading_deg=-90.0)
    sensor = sensor if own else FlowSensor(x=0.36, y=0.0, heading_deg=0.0)
    with ExitStack() as stack:
        domain = stack.enter_context(reserved_domain())
        stack.enter_context(vehicle_node(domain, "twist_adapter", *arguments(adapter)))
        robot = stack.enter_context(closing(Robot(domain, name, sensor, has_gyro=own)))
        robot.wait(lambda: robot.twists)
        assert robot.twists[-1].header.frame_id == "base_link"
        _, twist, covariance, _ = twist_of(robot.twists[-1])
        np.testing.assert_allclose(twist, TWIST, atol=1e-9)
        assert np.all(np.diag(covariance) >= DEVIATION**2 - 1e-12)
        if own:
            robot.measured = 10.0 * robot.measured
            robot.wait(lambda: "exceeds maximum_speed" in robot.status)
            return
        robot.wait(lambda: len(robot.poses) > 10)
        first, last = (robot.poses[k].pose.pose.orientation.z for k in (0, -1))
        assert last > first  # counter-clockwise
        robot.has_imu = False
        robot.wait(lambda: "no yaw rate on the topic imu" in robot.status)


def test_a_sensor_without_a_gyro_is_refused_off_the_center(tmp_path: Path) -> None:
    adapter, _ = nodes(OTOS, tmp_path, "flow:=board/<sensor>")
    sensor = FlowSensor(x=0.1016, y=-0.0508, heading_deg=-90.0)
    with (
        reserved_domain() as domain,
        vehicle_node(domain, "twist_adapter", *arguments(adapter)),
        closing(Robot(domain, "otos", sensor, has_gyro=False)) as robot,
    ):
        robot.wait(lambda: "set the parameter gyro to imu" in robot.status)
        assert not robot.twists


@pytest.mark.parametrize(
    ("added", "problem"),
    [
        ("odometry: {maximum_speed: 3}", "odometry: is not used with one flow sensor"),
        ("twist_adapter: {gyro: compass}", "twist_adapter.gyro: 'compass' is not one of"),
        ("twist_adapter: {giro: imu}", "did you mean 'gyro'"),
        (
            "sensors: {left: {x: 0, y: 0.1, heading_deg: 0}}\ntwist_adapter: {gyro: imu}",
            "twist_adapter: is for exactly one of flow_sensors",
        ),
        ("vehicle: mecanum_forklift\ntwist_adapter: {gyro: imu}", "not an experiment"),
    ],
)
def test_an_unsuitable_key_is_refused(added: str, problem: str, tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(f"{OTOS}{added}\n", encoding="utf-8")
    finished = omni_here(["ros-params", str(tmp_path / "robot.yaml"), "--out", str(tmp_path / "p")])
    assert finished.returncode == 2
    assert problem in finished.stderr
