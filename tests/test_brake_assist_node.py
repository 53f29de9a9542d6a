"""The brake assistant over topics: it applies all brakes for every invalid input."""

from __future__ import annotations

import dataclasses
import re
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
import rclpy
from bystander import Bystander
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TwistWithCovarianceStamped
from omni_process import WORKSPACE
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import Imu, JointState

from omni_brake_assist.brake_assist_node import BrakeAssistNode
from omni_core.kinematics import PlatformKinematics
from omni_ros.environment import node_environment
from omni_ros.messages import joint_state, planar_twist_with_covariance, to_nanoseconds
from omni_ros.process import Spinner, StopFlag
from omni_ros.qos import RELIABLE
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import ProcessGroup

STEP_NS = 10_000_000
GOOD = np.diag([1e-6, 1e-6, 1e-6])
BLIND = 1e6 * np.eye(3)
# Fast and turning left: the brakes that increase the rotation are released.
SWERVING = np.array([8.0, 0.0, 0.6])


class Vehicle(Bystander):
    """The other nodes of a vehicle: driver, odometry and brakes."""

    def __init__(self, domain: int, wheels: tuple[str, ...]) -> None:
        super().__init__("vehicle", domain)
        self.wheels = wheels
        self.pedal = self.node.create_publisher(JointState, "brake/pedal", RELIABLE)
        self.twist = self.node.create_publisher(
            TwistWithCovarianceStamped, "odometry/twist", RELIABLE
        )
        self.wheel_states = self.node.create_publisher(JointState, "wheel_states", RELIABLE)
        self.enables: list[JointState] = []
        self.states: list[str] = []
        self.texts: list[str] = []
        self.levels: list[bytes] = []
        self.node.create_subscription(JointState, "brake/enable", self.enables.append, RELIABLE)
        self.errors: list[JointState] = []
        self.node.create_subscription(
            JointState, "brake_assist/error", self.errors.append, RELIABLE
        )
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_state, RELIABLE)
        self.stamp_ns = 0
        self.frame = "base_link"

    def _on_state(self, message: DiagnosticArray) -> None:
        self.states += [v.value for v in message.status[0].values if v.key == "state"]
        self.texts.append(message.status[0].message)
        self.levels.append(message.status[0].level)

    def description(self) -> str:
        return f"states so far: {self.states}"

    def wait_for_state(self, state: str) -> None:
        """Wait until a state has been reported since `swerve_until_assisted` was last called."""
        self.wait(lambda: state in self.states)

    def send_twist(self, values: np.ndarray, covariance: np.ndarray = GOOD) -> None:
        message = planar_twist_with_covariance(self.stamp_ns, values, covariance)
        message.header.frame_id = self.frame
        self.twist.publish(message)

    def send_pedal(self, value: float) -> None:
        self.pedal.publish(joint_state(self.stamp_ns, ("brake_pedal",), position=np.array([value])))

    def step(self, values: np.ndarray, covariance: np.ndarray = GOOD) -> dict[str, float]:
        """Brake for one step with this feedback; return its enables [1], keyed by wheel."""
        self.stamp_ns += STEP_NS
        self.send_pedal(1.0)
        self.send_twist(values, covariance)
        self.wait(lambda: self.last_stamp() == self.stamp_ns)
        return dict(zip(self.enables[-1].name, self.enables[-1].effort, strict=True))

    def step_until_reported(self, state: str, values: np.ndarray, covariance: np.ndarray) -> None:
        """Brake with this feedback until a state is reported, with all brakes on in each step."""

        def reported() -> bool:
            assert all_on(self.step(values, covariance)), state
            return state in self.states

        self.wait(reported)

    def set_parameter(self, name: str, value: object) -> SetParametersResult:
        """Set a parameter as ``ros2 param set`` does."""
        given = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[given])
        (result,) = self.call(SetParameters, "/brake_assist/set_parameters", request).results
        return result

    def last_stamp(self) -> int:
        return to_nanoseconds(self.enables[-1].header.stamp) if self.enables else -1

    def swerve_until_assisted(self) -> dict[str, float]:
        """Brake until brakes are released; on a busy machine, assistance may stop and resume."""
        deadline = time.monotonic() + self.round_timeout
        enable: dict[str, float] = {}
        # The state comes on a topic of its own, before or after the enables.
        while 0.0 not in enable.values() or self.states[-1:] != ["assisting"]:
            assert time.monotonic() < deadline, f"never assisted; {self.description()}"
            # Never twice the same, because a frozen reading is rejected.
            enable = self.step(SWERVING * np.random.default_rng().uniform(0.98, 1.0))
        assert 1.0 in enable.values()
        self.states.clear()
        return enable


def straight_line(*changes: str) -> ExperimentConfiguration:
    return ExperimentLibrary(WORKSPACE / "config").load("straight_line", "assisted", changes)


# There are no wheel speeds for fault detection.
WITHOUT_WHEELS = straight_line("brake_assist.fault_detection=false")


@pytest.fixture(params=[True, False], ids=["lockstep", "real_time"])
def vehicle(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Vehicle]:
    """A vehicle with a brake assistant process, in a separate ROS domain."""
    with running(WITHOUT_WHEELS, tmp_path, lockstep=request.param) as vehicle:
        yield vehicle


@contextmanager
def running(
    configuration: ExperimentConfiguration, folder: Path, *arguments: str, lockstep: bool
) -> Iterator[Vehicle]:
    process = graph.Nodes(configuration, folder, lockstep=lockstep).brake_assist(listeners=1)
    process = dataclasses.replace(process, arguments=(*process.arguments, *arguments))
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        group.start(process)
        with closing(Vehicle(domain, tuple(configuration.vehicle.wheels))) as vehicle:
            vehicle.wait(lambda: vehicle.pedal.get_subscription_count() == 1)
            vehicle.wait(lambda: vehicle.twist.get_subscription_count() == 1)
            vehicle.wait(lambda: vehicle.node.count_publishers("brake/enable") == 1)
            yield vehicle


def test_in_a_run_the_first_enables_await_recorder_and_vehicle(tmp_path: Path) -> None:
    graph.Nodes(straight_line(), tmp_path).brake_assist()
    assert "subscribers: 2\n" in (tmp_path / "brake_assist.yaml").read_text()


def all_on(enable: dict[str, float]) -> bool:
    return set(enable.values()) == {1.0}


def test_it_assists_and_every_invalid_input_puts_all_brakes_on(vehicle: Vehicle) -> None:
    enable = vehicle.swerve_until_assisted()
    # Turning left about a forward motion: braking on the left side would turn it further.
    assert enable["front_left"] == 0.0
    assert enable["front_right"] == 1.0
    for values, covariance, state in (
        (SWERVING * np.nan, GOOD, "non_finite_feedback"),
        (SWERVING, BLIND, "low_confidence"),
        (SWERVING * 100.0, GOOD, "implausible_feedback"),
    ):
        vehicle.step_until_reported(state, values, covariance)
        vehicle.swerve_until_assisted()  # it recovers with good data


@pytest.mark.safety(
    "the wrong brakes act",
    "the vehicle has other wheels than configured",
    "the assistant compares the names and puts all brakes on",
    within="the next decision",
)
def test_unknown_wheel_names_put_all_brakes_on(vehicle: Vehicle) -> None:
    vehicle.swerve_until_assisted()
    vehicle.wheel_states.publish(joint_state(vehicle.stamp_ns, ("port", "starboard")))
    vehicle.wait(
        lambda: all_on(vehicle.step(SWERVING * np.random.default_rng().uniform(0.98, 1.0)))
    )
    vehicle.wait_for_state("unknown_wheel")
    vehicle.wheel_states.publish(joint_state(vehicle.stamp_ns, vehicle.wheels))
    vehicle.swerve_until_assisted()


@pytest.mark.safety(
    "the wrong brakes act",
    "the twist is given in the frame of a sensor or of another vehicle",
    "the assistant compares the frames, puts all brakes on and reports an error",
    within="the next decision",
)
def test_a_twist_in_another_frame_puts_all_brakes_on(vehicle: Vehicle) -> None:
    for frame in ("otos", "robot2/base_link"):
        vehicle.swerve_until_assisted()
        vehicle.frame, vehicle.texts = frame, []
        vehicle.step_until_reported("wrong_frame", SWERVING, GOOD)
        words = f"the twist is given in '{frame}', not in 'base_link': .* base_frame"
        assert any(re.search(words, text) for text in vehicle.texts)
        vehicle.frame = "base_link"
    vehicle.swerve_until_assisted()
    vehicle.frame = ""  # names no other frame
    vehicle.swerve_until_assisted()


@pytest.mark.parametrize("lockstep", [True, False])
def test_the_frame_has_the_prefix_of_the_vehicle(lockstep: bool, tmp_path: Path) -> None:
    prefix = "-p", "frame_prefix:=robot1/"
    with running(WITHOUT_WHEELS, tmp_path, *prefix, lockstep=lockstep) as vehicle:
        vehicle.frame = "robot1/base_link"
        vehicle.swerve_until_assisted()
        vehicle.frame = "base_link"
        vehicle.step_until_reported("wrong_frame", SWERVING, GOOD)


@pytest.mark.safety(
    "a command of a second publisher acts",
    "a second publisher of pedal, twist, wheel states or enables",
    "the assistant detects the publisher, puts all brakes on, and reports an error",
    within="the discovery of the publisher",
)
@pytest.mark.parametrize("vehicle", [False], indirect=True, ids=["real_time"])
def test_two_publishers_of_a_topic_put_all_brakes_on(vehicle: Vehicle) -> None:
    # Simulated time is in use, and no node publishes it.
    vehicle.wait(lambda: vehicle.states[-2:] == ["no_demand"] * 2)
    vehicle.swerve_until_assisted()
    for kind, topic in (
        (JointState, "brake/pedal"),
        (TwistWithCovarianceStamped, "odometry/twist"),
        (JointState, "wheel_states"),
        (JointState, "brake/enable"),
    ):
        rival = vehicle.node.create_publisher(kind, topic, RELIABLE)
        vehicle.wait(
            lambda: (
                all_on(vehicle.step(SWERVING * np.random.default_rng().uniform(0.98, 1.0)))
                and "second_publisher" in vehicle.states
            )
        )
        vehicle.node.destroy_publisher(rival)
        vehicle.swerve_until_assisted()


@pytest.mark.safety(
    "brakes act late",
    "pedal, twist or both stop sending",
    "watchdogs on a steady clock put all brakes on",
    within="`demand_timeout`, `feedback_timeout`",
)
@pytest.mark.parametrize("vehicle", [False], indirect=True, ids=["real_time"])
@pytest.mark.parametrize(
    ("silent", "state"),
    [("both", "no_demand"), ("pedal", "no_demand"), ("twist", "stale_feedback")],
)
def test_missing_messages_put_all_brakes_on(vehicle: Vehicle, silent: str, state: str) -> None:
    vehicle.swerve_until_assisted()

    due = time.monotonic()

    def go_on_in_part() -> bool:
        nonlocal due
        if time.monotonic() < due:  # faster demands would fill the queue with answers
            return state in vehicle.states
        due = time.monotonic() + 1e-9 * STEP_NS
        vehicle.stamp_ns += STEP_NS
        if silent == "twist":
            vehicle.send_pedal(1.0)
        elif silent == "pedal":
            vehicle.send_twist(SWERVING * np.random.default_rng().uniform(0.98, 1.0))
        return state in vehicle.states

    vehicle.wait(go_on_in_part)
    vehicle.enables.clear()
    # The first ones may have been on their way before.
    vehicle.wait(lambda: go_on_in_part() and len(vehicle.enables) >= 6)
    assert all(set(enable.effort) == {1.0} for enable in vehicle.enables[-3:])
    vehicle.swerve_until_assisted()


@pytest.mark.parametrize("vehicle", [True], indirect=True, ids=["lockstep"])
def test_a_pedal_without_a_value_counts_as_full_braking(vehicle: Vehicle) -> None:
    vehicle.swerve_until_assisted()
    vehicle.stamp_ns += STEP_NS
    empty = joint_state(vehicle.stamp_ns, ("brake_pedal",))
    vehicle.pedal.publish(empty)
    vehicle.send_twist(SWERVING)
    vehicle.wait(lambda: vehicle.last_stamp() == vehicle.stamp_ns)
    assert set(vehicle.enables[-1].effort) == {1.0}
    vehicle.wait_for_state("invalid_demand")


@pytest.mark.parametrize("vehicle", [True], indirect=True, ids=["lockstep"])
def test_the_running_assistant_can_be_switched_and_tuned_while_the_pedal_is_up(
    vehicle: Vehicle,
) -> None:
    vehicle.swerve_until_assisted()
    assert vehicle.set_parameter("enabled", False).successful
    assert all_on(vehicle.step(SWERVING * 0.97))
    vehicle.wait_for_state("disabled")
    for name, value in (("enabled", 1), ("k", 9), ("law", "none"), ("no_such_parameter", True)):
        result = vehicle.set_parameter(name, value)
        assert not result.successful
        assert result.reason
    assert vehicle.set_parameter("enabled", True).successful
    vehicle.stamp_ns += STEP_NS
    vehicle.send_pedal(0.0)
    vehicle.send_twist(SWERVING)
    vehicle.wait(lambda: vehicle.last_stamp() == vehicle.stamp_ns)
    assert vehicle.set_parameter("k", 9).successful
    for name, unfit in (("k", 8), ("weighting", "none"), ("speed_threshold", -1.0)):
        assert not vehicle.set_parameter(name, unfit).successful
    vehicle.swerve_until_assisted()


def test_a_warning_about_the_source_of_the_twist_is_reported_from_the_start(tmp_path: Path) -> None:
    given = "-p", "feedback_warning:=more harm than good"
    with running(WITHOUT_WHEELS, tmp_path, *given, lockstep=False) as vehicle:
        vehicle.wait(lambda: vehicle.texts)
        assert vehicle.texts[-1] == "no pedal yet: all brakes on; more harm than good"
        vehicle.swerve_until_assisted()
        assert vehicle.texts[-1].endswith("; more harm than good")
        assert vehicle.levels[-1] == DiagnosticStatus.WARN


@pytest.mark.parametrize("mounting", [(), (180.0, 0.0, 90.0)], ids=["level", "upside_down"])
def test_encoders_and_an_imu_assist_without_any_twist(
    mounting: tuple[float, ...], tmp_path: Path
) -> None:
    # Upside down and turned: the sensor's x axis points to the left, its y axis ahead.
    axes = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]) if mounting else np.eye(3)
    given = ("-p", f"imu_rotation_deg:={list(mounting)}") if mounting else ()
    configuration = straight_line()
    kinematics = PlatformKinematics.of(configuration.vehicle.wheels)
    speeds = kinematics.wheel_speeds(SWERVING)
    with running(configuration, tmp_path, *given, lockstep=False) as vehicle:
        imu = vehicle.node.create_publisher(Imu, "imu", RELIABLE)
        vehicle.wait(lambda: imu.get_subscription_count() == 1)

        def drive(pedal: float) -> str:
            vehicle.stamp_ns += STEP_NS
            stamp_ns = vehicle.stamp_ns
            vehicle.send_pedal(pedal)
            # A turn at constant velocity in the body axes needs a centripetal acceleration.
            reading = Imu(header=joint_state(stamp_ns, ()).header)
            force = np.array([0.0, SWERVING[0] * SWERVING[2], 1.0])  # gravity in g
            for vector, values in (
                (reading.angular_velocity, np.array([0.0, 0.0, SWERVING[2]])),
                (reading.linear_acceleration, force),
            ):
                vector.x, vector.y, vector.z = (axes.T @ values).tolist()
            names = ("arm_joint", *reversed(vehicle.wheels), "gripper_joint")
            velocity = np.array([np.nan, *reversed(speeds), 0.3])
            vehicle.wheel_states.publish(joint_state(stamp_ns, names, velocity=velocity))
            imu.publish(reading)
            due = time.monotonic() + 1e-9 * STEP_NS
            vehicle.wait(lambda: time.monotonic() > due)
            return vehicle.states[-1] if vehicle.states else ""

        vehicle.wait(lambda: drive(0.0) == "inactive" and vehicle.stamp_ns > 100 * STEP_NS)
        vehicle.enables.clear()
        vehicle.wait(lambda: drive(1.0) == "dead_reckoning")
        assert any(0.0 in enable.effort for enable in vehicle.enables)
        assert "lost: twist (no_feedback)" in vehicle.texts[-1]
        assert "upwards 1.00, must be 9.81 m/s^2 (REP 145): check unit" in vehicle.texts[-1]

        def answers_with_a_slow_odometry() -> int:
            vehicle.enables.clear()
            for step in range(8):
                if step % 2 == 0:
                    vehicle.send_twist(SWERVING)
                drive(1.0)
            return len(vehicle.enables)

        vehicle.wait(lambda: answers_with_a_slow_odometry() > 6)


def test_time_in_which_the_process_does_not_run_is_no_silence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    configuration, timeout = WITHOUT_WHEELS, 1.0
    process = graph.Nodes(configuration, tmp_path, lockstep=False).brake_assist(listeners=1)
    names = ("demand_timeout", "feedback_timeout", "maximum_time_step")
    timeouts = (f"{name}:={timeout}" for name in names)
    arguments = [*process.arguments, *(word for given in timeouts for word in ("-p", given))]
    with reserved_domain() as domain:
        rclpy.init(args=arguments, domain_id=domain)
        assistant = BrakeAssistNode()
        spinner = Spinner(assistant, StopFlag())
        with closing(Vehicle(domain, tuple(configuration.vehicle.wheels))) as vehicle:
            wait = vehicle.wait

            def wait_while_spinning(condition: Callable[[], object]) -> None:
                def spun_condition() -> object:
                    spinner.spin_once(0.0)
                    return condition()

                wait(spun_condition)

            monkeypatch.setattr(vehicle, "wait", wait_while_spinning)
            vehicle.wait(lambda: vehicle.pedal.get_subscription_count() == 1)
            vehicle.wait(lambda: vehicle.twist.get_subscription_count() == 1)
            vehicle.wait(lambda: vehicle.node.count_publishers("brake/enable") == 1)
            vehicle.swerve_until_assisted()
            time.sleep(2.0 * timeout)  # no callback runs
            spinner.spin_once(0.0)  # the tick of the watchdog comes before the waiting messages
            for _ in range(5):
                vehicle.step(SWERVING * np.random.default_rng().uniform(0.98, 1.0))
            assert 0.0 in vehicle.enables[-1].effort
            vehicle.wait(lambda: vehicle.states)  # reported at each change, and periodically
            assert set(vehicle.states) == {"assisting"}
        assistant.destroy_node()
        rclpy.shutdown()
