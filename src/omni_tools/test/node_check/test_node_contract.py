"""Messages of any content lead to named violations, and never to an error of the check."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from omni_core import topics
from omni_recording.folder import open_vehicle
from omni_ros.messages import (
    joint_state,
    message_class,
    planar_twist_with_covariance,
    to_time,
)
from omni_runs.replay.plan import recorded_configuration
from omni_tools.node_check import contract
from omni_tools.node_check.enables_node import Enables
from omni_tools.node_check.exchange_node import Answer, Exchange, Received

PERIOD_NS = 10_000_000
SLOW = contract.WheelMotion(np.array([0]), np.array([[2.0, 0.0]]), np.array([False]))
TURN = np.array([1.0, 1.0, 0.3])


def exchange(answers: list[Answer], sent: list[int]) -> Exchange:
    made = Exchange(topics.ENABLE, [True])
    for phase in ("unusable", "gap", "recorded"):
        made.begin(phase, (0, 0))
    made.sent["recorded"].extend(sent)
    made.answers = answers
    return made


def test_a_repeated_answer_without_new_inputs_is_not_late() -> None:
    def age(of_each: float) -> float:
        sent = [k * PERIOD_NS for k in range(100)]
        answers = [Answer("recorded", stamp, of_each, 0.0, None) for stamp in sent]
        again = [Answer("recorded", sent[-1], 0.05 * k, 0.05 * k, None) for k in range(1, 9)]
        return contract.metrics(exchange(answers + again, sent))["age_p99.recorded"][0]

    assert age(0.002) == pytest.approx(2.0)
    assert age(0.2) == pytest.approx(200.0)


def test_a_release_of_all_brakes_at_once_is_named() -> None:
    def breaches(effort: list[float]) -> list[str]:
        message = joint_state(0, ("left", "right"), effort=np.array(effort))
        answers = [Answer("recorded", 0, 0.0, 0.0, message)]
        return list(contract.enable_breaches(exchange(answers, [0]), ["left", "right"]))

    assert not any("all brakes are released" in words for words in breaches([0.0, 1.0]))
    assert any("all brakes are released" in words for words in breaches([0.0, 0.0]))


@pytest.mark.parametrize("row", range(3))
def test_a_negative_variance_is_named_as_such(row: int) -> None:
    covariance = np.eye(3)
    covariance[row, row] = -1.0
    message = planar_twist_with_covariance(0, np.zeros(3), covariance)
    breaches = contract.twist_breaches(
        exchange([Answer("recorded", 0, 0.0, 0.0, message)], [0]), SLOW
    )
    assert "not positive definite" in next(breaches)


@pytest.mark.parametrize(
    ("names", "torque", "words"),
    [
        (("right", "left"), 100.0, "a wheel with enable 0 is still braked"),
        (("other", "names"), 100.0, "effort must contain the torque of each brake"),
        (("right", "left"), math.nan, "a wheel with enable 1 is not braked"),
    ],
)
@pytest.mark.parametrize("first", [0, 10])
def test_brake_torques_of_any_simulator_are_judged(
    names: tuple[str, str], torque: float, words: str, first: int
) -> None:
    published: list[Any] = []
    node: Any = SimpleNamespace(
        create_publisher=lambda *_: SimpleNamespace(publish=published.append),
        create_subscription=lambda _kind, _path, call, _qos: setattr(node, "pedal", call),
    )
    enables = Enables(node, ("left", "right"))
    steps = [first, *range(100)]  # the clock of a simulator may be set back
    for step in steps:
        pedal = joint_state(step * PERIOD_NS, ("pedal",), position=np.array([1.0]))
        node.pedal(pedal)
    assert len(published) == len(steps)
    effort = np.array([0.0, torque])
    states = [(0, joint_state(step * PERIOD_NS, names, effort=effort)) for step in steps]
    assert words in next(enables.breaches({"wheel_states": Received(states, [True])}))


def test_a_repeated_stamp_of_an_odometry_is_named() -> None:
    def found(node: str, stamps: list[int]) -> list[str]:
        answers = [Answer("recorded", stamp, 0.0, 0.0, None) for stamp in stamps]
        breaches = contract.common_breaches(exchange(answers, [1, 2, 3]), node, "topic")
        return [one for one in breaches if "increase" in one]

    assert found("odometry", [1, 2, 3]) == found("brake_assist", [1, 2, 2, 3]) == []
    assert found("odometry", [1, 2, 2, 3])
    assert found("brake_assist", [1, 3, 2])


@pytest.mark.parametrize(("speed", "named"), [(2.4, False), (99.0, True)])
def test_a_speed_that_the_wheels_never_reach_is_named(speed: float, named: bool) -> None:
    message = planar_twist_with_covariance(0, np.array([0.0, speed, 0.0]), 1e-4 * np.eye(3))
    answers = [Answer("recorded", 0, 0.0, 0.0, message), Answer("unusable", 1, 0.0, 0.0, message)]
    found = next(contract.twist_breaches(exchange(answers, [0]), SLOW), "")
    assert ("speed 99.00 m/s" in found and "reach 2.00 m/s" in found) == named


@pytest.mark.parametrize(
    ("measured", "named"),
    [(lambda true: true, False), (lambda true: 0.9 * true, False), (lambda _: 1.0, True)],
)
def test_a_twist_of_another_motion_than_that_of_the_wheels_is_named(
    measured: Callable[[float], float], named: bool
) -> None:
    recording = Path(__file__).parents[4] / "bags" / "small_stop" / "assisted"
    configuration = recorded_configuration(open_vehicle(recording))
    motion = contract.WheelMotion.of(recording, configuration.vehicle.wheels)
    assert motion.fastest == pytest.approx(configuration.maneuver.speed, rel=0.05)
    assert 0 < np.count_nonzero(motion.rolling) < len(motion.rolling)
    answers = []
    for stamp, velocity in zip(motion.stamp_ns, motion.velocity, strict=True):
        twist = np.array([measured(velocity[0]), velocity[1], 0.0])
        message = planar_twist_with_covariance(int(stamp), twist, 1e-4 * np.eye(3))
        answers.append(Answer("recorded", int(stamp), 0.0, 0.0, message))
    made = exchange(answers, list(motion.stamp_ns))
    found = [one for one in contract.twist_breaches(made, motion) if "roll at" in one]
    assert bool(found) == named


@pytest.mark.parametrize(
    ("unanswered", "words"),
    [
        (range(0), ""),
        (range(100, 104), "gap of 50 ms between two answers (inputs in between"),
        (range(100, 103), ""),  # 40 ms
    ],
)
def test_gaps_in_the_enables_are_named(unanswered: range, words: str) -> None:
    sent = [k * PERIOD_NS for k in range(200)]
    answered = [stamp for k, stamp in enumerate(sent) if k not in unanswered]
    answers = [Answer("recorded", stamp, 0.0, 0.0, None) for stamp in answered]
    breaches = contract.common_breaches(exchange(answers, sent), "brake_assist", "topic")
    found = " | ".join(one for one in breaches if "gap" in one)
    assert words in found
    assert bool(words) == bool(found)


def imu(now_ns: int, upwards: float = 9.81, yaw_rate: float = 0.0) -> Any:
    message = message_class(topics.IMU.type)()
    message.header.stamp = to_time(now_ns)
    message.angular_velocity.z = yaw_rate
    message.linear_acceleration.z = upwards
    return message


MESSAGES: dict[str, Callable[[int], Any]] = {
    "clock": lambda now_ns: message_class(topics.CLOCK.type)(clock=to_time(now_ns)),
    "wheel_states": lambda now_ns: joint_state(now_ns, ("left",), velocity=np.ones(1)),
    "pedal": lambda now_ns: joint_state(now_ns, ("brake_pedal",), position=np.zeros(1)),
    "twist": lambda now_ns: planar_twist_with_covariance(now_ns, TURN, 0.1 * np.eye(3)),
    "imu": imu,
}


def simulated(key: str, step: int = 1, lag_ns: int = 0) -> list[tuple[int, Any]]:
    """Return messages of 100 periods on a topic, each with its time of publication [ns].

    Args:
        key: name of the topic.
        step: number of periods from one message to the next.
        lag_ns: time of publication minus stamp [ns].
    """
    stamps = range(0, 100 * PERIOD_NS, step * PERIOD_NS)
    return [(stamp_ns, MESSAGES[key](stamp_ns - lag_ns)) for stamp_ns in stamps]


def turning(yaw_rate: float, upwards: float = 9.81) -> list[tuple[int, Any]]:
    return [(now_ns, imu(now_ns, upwards, yaw_rate)) for now_ns, _ in simulated("imu")]


@pytest.mark.parametrize(
    ("key", "received", "words"),
    [
        ("pedal", Received(simulated("pedal"), [True, True]), "has 2 publishers"),
        ("pedal", Received(simulated("pedal"), [False]), "best effort"),
        ("pedal", Received(simulated("pedal"), [True], silent=True), "in the last 1 s"),
        ("pedal", Received([], [True]), "fewer than two messages"),
        ("wheel_states", Received(simulated("wheel_states", step=2), [True]), "must be 100 or"),
        ("wheel_states", Received(2 * simulated("wheel_states"), [True]), "do not increase"),
        ("twist", Received(simulated("twist", step=4), [True]), "must be 50 or more"),
        ("twist", Received(simulated("twist", lag_ns=200_000_000), [True]), "/clock by -0.20 s"),
        ("clock", Received([], []), "clock: nothing"),
        ("imu", Received([(0, imu(0, math.nan))], [True]), "finite"),
        ("imu", Received(turning(0.3), [True]), ""),
        ("imu", Received(turning(0.05), [True]), ""),  # too slow for a comparison
        ("imu", Received(turning(0.3, upwards=1.0), [True]), "upwards 1.00, must be 9.81"),
        ("imu", Received(turning(math.degrees(0.3)), [True]), "0.017 times those of the IMU"),
        ("imu", Received(turning(-0.3), [True]), "-1 times those of the IMU"),
        ("imu", Received([], []), ""),
    ],
)
def test_each_breach_of_a_simulator_is_named(key: str, received: Received, words: str) -> None:
    seen = {name: Received(simulated(name), [True]) for name in MESSAGES}
    found = " | ".join(contract.simulator_breaches({**seen, key: received}, ("left",)))
    assert words in found
    assert bool(words) == bool(found)
