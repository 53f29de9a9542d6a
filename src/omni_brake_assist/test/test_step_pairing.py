"""Pairing of twists and demands in any order of arrival."""

import numpy as np
import pytest

from omni_brake_assist.brake_assist_node import StepPairing
from omni_core.signals import PedalSample, TwistSample

MS = 1_000_000


def twist(stamp_ms: int) -> TwistSample:
    return TwistSample(stamp_ms * MS, np.zeros(3), np.eye(3))


@pytest.mark.parametrize("order", [("pedal", "twist"), ("twist", "pedal")])
def test_a_sample_belongs_to_all_steps_until_the_next(order: tuple[str, ...]) -> None:
    """A sensor with 40 ms repeats its value and stamp in four steps of 10 ms."""
    pairing = StepPairing(twist_period_ns=40 * MS)
    paired = []
    for step in range(9):
        for word in order:
            pedal = PedalSample(10 * step * MS, 1.0)
            demand = pairing.take(pedal if word == "pedal" else twist(40 * (step // 4)))
            if demand is not None:
                assert demand.feedback is not None
                paired.append((demand.stamp_ns // MS, demand.feedback.stamp_ns // MS))
    assert paired == [(10 * step, 40 * (step // 4)) for step in range(9)]


def test_a_line_that_is_older_than_its_step_belongs_to_it() -> None:
    pairing = StepPairing()
    pairing.take(PedalSample(10 * MS, 1.0))
    line = TwistSample(10 * MS - 400_000, np.zeros(3), np.eye(3))
    assert pairing.take(line) is not None
    assert pairing.take(PedalSample(20 * MS, 1.0)) is None  # its twist has not arrived
