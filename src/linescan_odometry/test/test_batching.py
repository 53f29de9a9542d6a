"""Batches of equal time form a group; a missing camera delays the others only briefly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linescan_odometry.port import BatchCollector
from omni_core.signals import LineBatch

SENSORS = ("left", "right", "front")
PERIOD_NS = 10_000_000


def collector() -> BatchCollector:
    return BatchCollector(SENSORS, maximum_skew=0.005)


def batch(index: int, offset_ns: int = 0) -> LineBatch:
    return LineBatch(index * PERIOD_NS + offset_ns, np.zeros((2, 1024), dtype=np.uint8))


def test_a_group_is_ready_with_its_last_camera_in_declared_order() -> None:
    subject = collector()
    first = {name: batch(1) for name in SENSORS}
    assert subject.add("front", first["front"]) == []
    assert subject.add("left", first["left"]) == []
    (group,) = subject.add("right", first["right"])
    assert group == first
    assert list(group) == list(SENSORS)


@st.composite
def arrivals(draw: st.DrawFn) -> list[tuple[str, int]]:
    """Ten batches of each camera, no camera more than two batches ahead of another."""
    sent = dict.fromkeys(SENSORS, 0)
    order = []
    while min(sent.values()) < 10:
        ahead = min(sent.values()) + 2
        name = draw(st.sampled_from([n for n in SENSORS if sent[n] < min(10, ahead)]))
        order.append((name, sent[name]))
        sent[name] += 1
    return order


@given(arrivals(), st.integers(-4_000_000, 0))
def test_whatever_the_order_the_groups_are_whole(order: list[tuple[str, int]], skew: int) -> None:
    """With other line rates, batches end at other times but belong to the same group."""
    subject = collector()
    groups = []
    for name, index in order:
        groups += subject.add(name, batch(index, skew if name == "right" else 0))
    stamps = [{name: lines.stamp_ns for name, lines in group.items()} for group in groups]
    expected = [i * PERIOD_NS for i in range(10)]
    assert stamps == [{"left": t, "right": t + skew, "front": t} for t in expected]


def test_a_silent_camera_is_waited_for_once() -> None:
    subject = collector()
    for index in range(2):
        for name in ("left", "right"):
            assert subject.add(name, batch(index)) == []
    assert [set(group) for group in subject.add("left", batch(2))] == [{"left", "right"}] * 2
    assert [set(group) for group in subject.add("right", batch(2))] == [{"left", "right"}]
    subject.add("left", batch(3))
    (prompt,) = subject.add("right", batch(3))
    assert set(prompt) == {"left", "right"}


def test_a_camera_that_comes_back_is_waited_for_again() -> None:
    subject = collector()
    for index in range(4):
        for name in ("left", "right"):
            subject.add(name, batch(index))
    assert subject.add("front", batch(1)) == []  # its group has already been returned
    assert subject.add("left", batch(4)) == []
    assert subject.add("right", batch(4)) == []
    (whole,) = subject.add("front", batch(4))
    assert {lines.stamp_ns for lines in whole.values()} == {4 * PERIOD_NS}
    assert set(whole) == set(SENSORS)


def test_time_that_goes_back_starts_anew() -> None:
    subject = collector()
    for name in SENSORS:
        subject.add(name, batch(100))
    groups = [group for name in SENSORS for group in subject.add(name, batch(0))]
    assert groups == [{name: groups[0][name] for name in SENSORS}]


def test_an_unknown_camera_is_refused() -> None:
    with pytest.raises(KeyError):
        collector().add("rear", batch(0))
