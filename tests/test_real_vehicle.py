"""The commands of the page for a real vehicle work with a stand-in for the vehicle."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import yaml
from bystander import Bystander, node_process
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from made_robots import CONTROLLER, write_packages
from omni_process import WORKSPACE, omni_here
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from omni_core.brakes import TYPICAL, BrakeConfiguration
from omni_core.configuration import ConfigurationError, from_mapping
from omni_ros.messages import joint_state, planar_twist_with_covariance
from omni_ros.qos import RELIABLE
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.hardware import ARGUMENTS, hardware_nodes, starts_again
from omni_runs.graph.process_group import find_executable
from omni_runs.workspace import ExperimentWorkspace
from omni_tools.ros_params import command as ros_params
from omni_tools.vehicles.estimates import Measured, write_vehicle
from omni_vehicle.brake_adapter import BrakeAdapterConfiguration

PAGE = WORKSPACE / "docs/real_vehicle.md"
FILES_PAGE = WORKSPACE / "src/omni_tools/omni_tools/robot_files/README.md"
COVARIANCE = np.diag([1e-4, 1e-4, 1e-4])


def commands(page: Path = PAGE) -> list[list[str]]:
    """Return the words of every command on a page."""
    blocks = re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    return [shlex.split(line) for block in blocks for line in block.splitlines()]


class StandIn(Bystander):
    """A vehicle that slides and turns independently of its brakes."""

    fastest, slowest = 3.0, 1.0  # [m/s]
    slowing, turning = 0.005, 0.5  # change of the speed in a step [m/s], yaw rate [rad/s]

    def __init__(self, domain: int, wheels: tuple[str, ...]) -> None:
        super().__init__("vehicle", domain)
        create = self.node.create_publisher
        self.wheels = wheels
        self.pedal = create(JointState, "brake/pedal", RELIABLE)
        self.states = create(JointState, "wheel_states", RELIABLE)
        self.twist = create(TwistWithCovarianceStamped, "odometry/twist", RELIABLE)
        self.released: list[bool] = []
        self.said = ""
        self.node.create_subscription(JointState, "brake/enable", self._obey, RELIABLE)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._read, RELIABLE)
        self.node.create_timer(0.01, self._step)
        self.speed, self.pressed = self.fastest, 1.0
        self._generator = np.random.default_rng(1)

    def description(self) -> str:
        return f"said {self.said}, released {self.released[-5:]}"

    def _obey(self, message: JointState) -> None:
        self.released.append(min(message.effort) < 1.0)

    def _read(self, message: DiagnosticArray) -> None:
        self.said = next(v.value for v in message.status[0].values if v.key == "state")

    def _step(self) -> None:
        change = -self.slowing if self.pressed else self.slowing
        self.speed = min(max(self.speed + change, self.slowest), self.fastest)
        stamp_ns = self.node.get_clock().now().nanoseconds
        rate = self.turning if self.speed else 0.0
        now = np.array([self.speed, 0.0, rate]) + self._generator.normal(0.0, 0.005, 3)
        self.publish_states(stamp_ns)
        self.pedal.publish(joint_state(stamp_ns, ("pedal",), position=np.array([self.pressed])))
        self.twist.publish(planar_twist_with_covariance(stamp_ns, now, COVARIANCE))

    def publish_states(self, stamp_ns: int) -> None:
        self.states.publish(joint_state(stamp_ns, self.wheels))


class Robot(StandIn):
    """A robot with an arm that stops."""

    fastest, slowest = 1.0, 0.0
    slowing, turning = 0.02, 0.0

    def publish_states(self, stamp_ns: int) -> None:
        names = ("arm_joint", *self.wheels)
        speeds = np.array([0.1] + len(self.wheels) * [self.speed / 0.05])
        self.states.publish(joint_state(stamp_ns, names, velocity=speeds))


@pytest.fixture(scope="module")
def parameters(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder written by the first command of the page."""
    (first,) = [words for words in commands() if "ros-params" in words]
    assert first[:2] == ["./omni", "ros-params"]
    words = [str(WORKSPACE / w) if w.startswith("config/") else w for w in first[1:]]
    folder = tmp_path_factory.mktemp("page") / words[-1]
    finished = omni_here([*words[:-1], str(folder)])
    assert finished.returncode == 0, finished.stderr
    written = ["brake_assist.yaml", "log_only.yaml", "recorder.yaml", "robot.urdf"]
    written += ["robot_state_publisher.yaml", "mecanum_drive_controller.yaml"]
    assert {str(folder / name) for name in written} == set(finished.stdout.splitlines())
    return folder


@pytest.fixture
def vehicle(parameters: Path) -> Iterator[StandIn]:
    """The vehicle with the assistant of the page, in a separate namespace."""
    (start,) = [words for words in commands() if "-m" in words]
    # Without `ros2`, which the wheels of ROS do not have.
    module = "omni_brake_assist.brake_assist_node"
    assert start[:5] == ["./omni", "exec", "python", "-m", module]
    given = [str(parameters.parent / w) if w.startswith("my_vehicle/") else w for w in start[5:]]
    wheels = yaml.safe_load((parameters / "brake_assist.yaml").read_text())["/**"]
    names = tuple(wheels["ros__parameters"]["wheels.names"])
    with (
        reserved_domain() as domain,
        node_process(domain, "-m", module, *given),
        closing(StandIn(domain, names)) as vehicle,
    ):
        yield vehicle


def test_the_page_leads_to_an_assisted_stop(vehicle: StandIn) -> None:
    vehicle.wait(lambda: vehicle.said == "disabled" and len(vehicle.released) > 10)
    assert not any(vehicle.released)  # it only reports
    # On a busy machine, it may be too slow by now for the brakes to have an effect.
    vehicle.pressed = 0.0
    (switch,) = [words for words in commands() if "param" in words]
    assert switch[:3] == ["ros2", "param", "set"]
    node, name, value = switch[3:]
    given = Parameter(name, value=yaml.safe_load(value)).to_parameter_msg()
    request = SetParameters.Request(parameters=[given])
    (result,) = vehicle.call(SetParameters, f"{node}/set_parameters", request).results
    assert result.successful
    vehicle.wait(lambda: vehicle.speed == vehicle.fastest)
    vehicle.pressed = 1.0
    vehicle.wait(lambda: vehicle.said == "assisting" and vehicle.released[-1])
    # The cable of the sensor is unplugged: all brakes are applied automatically.
    vehicle.node.destroy_publisher(vehicle.twist)
    vehicle.twist = vehicle.node.create_publisher(TwistWithCovarianceStamped, "unheard", RELIABLE)
    vehicle.wait(lambda: vehicle.said == "stale_feedback" and not any(vehicle.released[-3:]))


def test_the_files_of_a_robot_lead_to_a_recorded_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(write_packages(tmp_path).parent)
    Path("controllers.yaml").write_text(CONTROLLER)
    *before, assistant, recorder, compare, report = commands(FILES_PAGE)
    for words in before:
        finished = omni_here(words[1:])
        assert finished.returncode == 0, finished.stderr
    kinematics = yaml.safe_load(
        Path("my_robot/parameters/mecanum_drive_controller.yaml").read_text()
    )
    (node,) = kinematics.values()
    described = node["ros__parameters"]["kinematics"]
    # As CONTROLLER: half of wheelbase 0.4 m and track 0.3 m.
    assert described["sum_of_robot_center_projection_on_X_Y_axis"] == 0.35
    assert described["wheels_radius"] == 0.05
    names = ("fl_joint", "fr_joint", "rr_joint", "rl_joint")
    with (
        reserved_domain() as domain,
        node_process(domain, *assistant[3:]),
        closing(Robot(domain, names)) as robot,
    ):
        robot.wait(lambda: robot.said == "disabled" and len(robot.released) > 10)
        robot.pressed = 0.0
        with node_process(domain, *recorder[3:]):
            robot.wait(lambda: robot.states.get_subscription_count() == 2)
            robot.wait(lambda: robot.speed == robot.fastest)
            robot.pressed = 1.0
            robot.wait(lambda: robot.speed == 0.0)
            at_rest = len(robot.released)
            robot.wait(lambda: len(robot.released) > at_rest + 100)
        assert not any(robot.released)
    for words in (compare, report):
        finished = omni_here(words[1:])
        assert finished.returncode == 0, finished.stderr
        if words is compare:  # v^2 / 2a with 0.02 m/s in a step of about 10 ms
            assert "first_stop" in finished.stdout
            assert "stopping distance" in finished.stdout
    assert Path("my_robot/report.html").exists()


def test_the_launch_file_has_the_arguments_of_the_page() -> None:
    (launch,) = [words for words in commands() if "launch" in words]
    assert launch[:3] == ["ros2", "launch", "omni_bringup"]
    assert (WORKSPACE / "src/omni_bringup/launch" / launch[3]).is_file()
    page = re.findall(r"`(\w+:=[^`]*)`", PAGE.read_text(encoding="utf-8"))
    arguments = launch_arguments(*launch[4:], *page)
    assert arguments.keys() == ARGUMENTS.keys()


def launch_arguments(*words: str) -> dict[str, str]:
    defaults = {name: default or "" for name, (default, _) in ARGUMENTS.items()}
    return defaults | {name: value for name, _, value in (word.partition(":=") for word in words)}


def test_a_launch_releases_no_brake_unless_it_is_asked_to(parameters: Path) -> None:
    given = f"parameters:={parameters}"
    (node,) = hardware_nodes(launch_arguments(given))
    assert [path.stem for path in node.files] == ["brake_assist", "log_only"]
    last = yaml.safe_load(node.files[-1].read_text())["/**"]["ros__parameters"]
    assert last == {"enabled": False}
    (node,) = hardware_nodes(launch_arguments(given, "log_only:=false"))
    assert [path.stem for path in node.files] == ["brake_assist"]


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["log_only:=yes"], "must be true or false"),
        (["parameters:=nowhere"], "nowhere has no brake_assist.yaml"),
    ],
)
def test_a_wrong_launch_argument_is_refused(
    words: list[str], problem: str, parameters: Path
) -> None:
    given = launch_arguments(f"parameters:={parameters}", *words)
    with pytest.raises(ConfigurationError, match=problem):
        hardware_nodes(given)


def test_a_node_that_died_starts_again_and_a_refused_one_does_not() -> None:
    given = launch_arguments()
    assert starts_again(1, given)
    assert starts_again(-9, given)
    assert not starts_again(2, given)  # its configuration stays invalid
    assert not starts_again(0, given)
    assert not starts_again(1, launch_arguments("respawn:=false"))


@pytest.mark.parametrize("example", sorted((WORKSPACE / "config/hardware").glob("*.yaml")), ids=str)
def test_nodes_of_any_name_start_with_the_files_of_every_example(
    example: Path, tmp_path: Path
) -> None:
    finished = omni_here(["ros-params", str(example), "--out", str(tmp_path)])
    assert finished.returncode == 0, finished.stderr
    nodes = {
        "brake_assist": ("omni_brake_assist", "brake_assist", ["brake_assist", "log_only"]),
        "linescan_odometry": ("linescan_odometry", "odometry", ["linescan_odometry"]),
    }
    for name, (package, executable, files) in nodes.items():
        if not (tmp_path / f"{name}.yaml").exists():
            continue
        options = [word for f in files for word in ("--params-file", str(tmp_path / f"{f}.yaml"))]
        # No subscriber ever starts: the node ends by itself after reading its parameters.
        ended = subprocess.run(
            [
                str(find_executable(package, executable)),
                *("--ros-args", *options, "-r", "__ns:=/robot1"),
                *("-r", "__node:=x", "-p", "subscribers:=1", "-p", "match_timeout:=0.1"),
            ],
            env={**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )
        assert ended.returncode == 1, ended.stderr
        assert "/robot1/" in ended.stderr


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("wheels: {}", "wheels: is required"),
        ("wheel: {}", "'wheel' is not one of wheels"),
        ("[]", "must contain a mapping"),
        ("wheels: {a: {x: 1, y: 0, roller_angle_deg: 0, radius: 1.0e+308}}", "s: wheels.a.radius"),
        ("{" * 5000, "is not valid YAML"),
    ],
)
def test_what_does_not_describe_a_vehicle_is_refused_by_name(
    text: str, words: str, tmp_path: Path
) -> None:
    file = tmp_path / "vehicle.yaml"
    file.write_text(text)
    finished = omni_here(["ros-params", str(file), "--out", str(tmp_path / "out")])
    assert finished.returncode == 2
    assert words in finished.stderr
    assert len(finished.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_wrong_roller_sign_is_refused_unless_forced(tmp_path: Path) -> None:
    file, out = tmp_path / "vehicle.yaml", tmp_path / "out"
    text = (WORKSPACE / "config/hardware/mecanum_agv.yaml").read_text()
    file.write_text(
        text.replace("y: -0.35, roller_angle_deg: -45", "y: -0.35, roller_angle_deg: 45")
    )
    finished = omni_here(["ros-params", str(file), "--out", str(out)])
    assert finished.returncode == 2
    assert "wheels.rear_right.roller_angle_deg" in finished.stderr
    assert not out.exists()
    assert omni_here(["ros-params", str(file), "--out", str(out), "--force"]).returncode == 0
    assert (out / "brake_assist.yaml").exists()


def test_the_result_of_the_study_is_looked_for_in_the_workspace(tmp_path: Path) -> None:
    file = WORKSPACE / "config/hardware/mecanum_agv.yaml"
    options = ros_params.Options(configuration=str(file), out=tmp_path / "out", source="otos")
    with pytest.raises(ConfigurationError, match=f"{tmp_path}/results/feedback/summary.json"):
        ros_params.run(options, ExperimentWorkspace(tmp_path))


def test_a_source_that_does_harm_is_named_by_ros_params_the_node_and_doctor(tmp_path: Path) -> None:
    values = {"distance_ratio_p95": 1.8, "rotation_p95": 3.0, "rotation_unassisted_p95": 1.0}
    metrics = {
        f"{quantity}.wheel_twist_agv_sliding_mode_{source}": {"value": value, "unit": "1"}
        for source, harm in (("otos", 0.0), ("late_50ms", 1.0))
        for quantity, value in {**values, "harm": harm}.items()
    }
    brake = {
        f"brake.{name}": value for name, value in dataclasses.asdict(BrakeConfiguration()).items()
    }
    conditions = {"wheel_twist_agv": {"imu": True, "minimum_dwell_time": 0.02, **brake}}
    summary, out = tmp_path / "summary.json", tmp_path / "parameters"
    summary.write_text(
        json.dumps({"name": "feedback", "metrics": metrics, "conditions": conditions})
    )
    example = WORKSPACE / "config/hardware/wheel_twist_agv.yaml"

    def run(source: str, *options: str, file: Path = example) -> tuple[int, str]:
        known = ["--out", str(out), "--source", source, "--feedback", str(summary)]
        finished = omni_here(["ros-params", str(file), *known, *options])
        return finished.returncode, finished.stderr

    harm = "wheel_twist_agv: with ideal, 50 ms late and sliding_mode, assistance does more harm"
    assert run("otos") == (0, "")
    code, words = run("late_50ms")
    assert code == 0
    assert harm in words
    node = ["--params-file", str(out / "brake_assist.yaml"), "-p", "subscribers:=1"]
    ended = subprocess.run(
        [
            *(sys.executable, "-m", "omni_brake_assist.brake_assist_node", "--ros-args"),
            *(*node, "-p", "match_timeout:=0.1"),
        ],
        env={**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert harm in ended.stderr
    finished = omni_here(["doctor", "--parameters", str(out), "--json"])
    assert harm in json.loads(finished.stdout)["checks"]["feedback"]["words"]
    # A result about another vehicle, other brakes or another IMU shows nothing.
    own, drives = tmp_path / "my_agv.yaml", tmp_path / "drives" / example.name
    weak = tmp_path / "weak" / example.name
    drives.parent.mkdir()
    own.write_text(example.read_text())
    drives.write_text(example.read_text() + "  brake: {kind: velocity}\n")
    weak.parent.mkdir()
    weak.write_text(example.read_text() + "  brake: {max_torque: 2.0}\n")
    for refused, words in (
        (run("lidar"), "--source: 'lidar' is not one of"),
        (
            run("otos", "--feedback", str(tmp_path / "fb" / "summary.json")),
            "cannot be read (No such file or directory); run ./omni study feedback",
        ),
        (run("ideal"), "has no stops of wheel_twist_agv with ideal and sliding_mode ("),
        (run("otos", file=own), "('my_agv'); run ./omni study feedback --vehicle FOLDER\n"),
        (run("otos", file=drives), "(its stops have {'brake.kind': 'on_off'})"),
        (run("otos", file=weak), "(its stops have {'brake.max_torque': 2000.0})"),
        (
            run("otos", "--without-imu"),
            "{'imu': True}); run ./omni study feedback --vehicle FOLDER --without-imu",
        ),
    ):
        assert refused[0] == 2
        assert words in refused[1]


@pytest.mark.parametrize("brakes", TYPICAL)
def test_the_parameters_of_the_brake_adapter_are_those_of_the_vehicle(
    tmp_path: Path, brakes: str
) -> None:
    measured = Measured(length=0.6, width=0.4, mass=30.0, wheel_radius=0.05, brakes=brakes)
    write_vehicle("mine", measured, tmp_path / "mine")
    for kind in ("velocity" if brakes == "spring" else "spring", brakes):
        options = ros_params.Options(
            configuration=str(tmp_path / "mine"), out=tmp_path / "out", brakes=kind
        )
        if kind != brakes:  # spring-applied brakes and on-off valves differ in the dwell time
            words = "minimum_dwell_time" if brakes == "on_off" else "--brakes"
            with pytest.raises(ConfigurationError, match=words):
                ros_params.run(options, ExperimentWorkspace(WORKSPACE))
        else:
            ros_params.run(options, ExperimentWorkspace(WORKSPACE))
    written = yaml.safe_load((tmp_path / "out/brake_adapter.yaml").read_text())
    values = written["/**"]["ros__parameters"]
    values["wheels"] = tuple(values["wheels"])
    adapter = from_mapping(BrakeAdapterConfiguration, values)
    assert adapter.wheels == ("rear_left", "rear_right", "front_left", "front_right")
    assert adapter.kind == brakes
    assert adapter.minimum_dwell_time == (0.1 if brakes == "spring" else 0.0)
    assert adapter.ramp == pytest.approx(3.0 / 0.05)
