"""Messages of any content lead to named violations, and never to an error of the check."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from omni_bringup.node_check import contract
from omni_bringup.node_check.enables_node import Enables
from omni_bringup.node_check.exchange_node import Answer, Exchange
from omni_platform import topics
from omni_ros.messages import joint_state, planar_twist_with_covariance

PERIOD_NS = 10_000_000


def exchange(answers: list[Answer], sent: list[int]) -> Exchange:
    made = Exchange(topics.ENABLE, [True])
    made.begin("recorded", (0, 0)).extend(sent)
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


@pytest.mark.parametrize("row", range(3))
def test_a_negative_variance_is_named_as_such(row: int) -> None:
    covariance = np.eye(3)
    covariance[row, row] = -1.0
    message = planar_twist_with_covariance(0, np.zeros(3), covariance)
    breaches = contract.twist_breaches(exchange([Answer("recorded", 0, 0.0, 0.0, message)], [0]))
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
    states = [(0.0, joint_state(step * PERIOD_NS, names, effort=effort)) for step in steps]
    assert words in next(enables.breaches({"wheel_states": states}))
