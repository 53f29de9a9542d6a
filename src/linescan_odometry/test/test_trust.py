"""The variance of a match that follows batches without a match."""

from __future__ import annotations

import dataclasses

import pytest

from linescan_odometry.measurements import SensorReading
from linescan_odometry.view.trust import Trust

TOGETHER = SensorReading(1.0, 0.01**2, 0.9, 1.0, measured=True, batch_time=0.007)
PAIRS = dataclasses.replace(TOGETHER, batch_time=0.0)
NOTHING = SensorReading.unmeasured("no match")


def after(*readings: SensorReading) -> Trust:
    trust = Trust(["eye"])
    for reading in readings:
        trust.remember({"eye": reading})
    return trust


def deviation(trust: Trust, reading: SensorReading = TOGETHER) -> float:
    variance = trust.weighed({"eye": reading})["eye"].variance
    return float((variance / reading.variance) ** 0.5)


def test_a_ground_that_always_matches_keeps_its_variances() -> None:
    assert deviation(after(*[TOGETHER] * 9)) == 1.0
    assert after(NOTHING.refuted("grain")).weighed({"eye": PAIRS}) == {}  # only what is pulled at


def test_a_match_by_chance_has_a_larger_variance_until_others_match() -> None:
    unlike = NOTHING.refuted("grain")
    doubts = [deviation(after(*[unlike] * count)) for count in range(9)]
    assert doubts == sorted(doubts)
    assert doubts[1] == pytest.approx((4.0 / 3.0) ** 2)
    assert doubts[-1] == 16.0
    assert deviation(after(*[unlike] * 9, *[TOGETHER] * 9)) < 1.2


def test_lines_without_contrast_do_not_change_the_share_of_matches() -> None:
    assert deviation(after(*[NOTHING] * 9)) == 1.0


def test_matches_of_consecutive_lines_alone_get_a_larger_variance_at_once() -> None:
    trust = after(TOGETHER)
    alone = dataclasses.replace(PAIRS, unlike=True)
    assert trust.growth("eye", alone) > trust.growth("eye", PAIRS) == 1.0
    assert deviation(after(alone)) > 1.0
