"""Batches of the same time come together, and a silent camera holds nobody up."""

from __future__ import annotations

import numpy as np
import pytest

from linescan_odometry.batching import BatchCollector
from linescan_odometry.measurements import LineBatch
from omni_platform.sensors import LineSensor

SENSORS = {
    "left": LineSensor(x=0.0, y=0.5, heading_deg=0.0),
    "right": LineSensor(x=0.0, y=-0.5, heading_deg=0.0),
    "front": LineSensor(x=0.6, y=0.0, heading_deg=90.0),
}


def batch(stamp_ns: int) -> LineBatch:
    return LineBatch(stamp_ns, np.zeros((2, 1024), dtype=np.uint8))


def test_a_group_is_ready_with_its_last_camera_in_declared_order() -> None:
    collector = BatchCollector(SENSORS)
    first = {name: batch(10) for name in SENSORS}
    assert collector.add("front", first["front"]) == []
    assert collector.add("left", first["left"]) == []
    (group,) = collector.add("right", first["right"])
    assert group == first
    assert list(group) == list(SENSORS)


def test_a_silent_camera_is_left_out_when_another_speaks_twice() -> None:
    collector = BatchCollector(SENSORS)
    early = batch(10)
    assert collector.add("left", early) == []
    assert collector.add("right", early) == []
    (group,) = collector.add("left", batch(20))
    assert group == {"left": early, "right": early}
    assert collector.add("right", batch(20)) == []
    (complete,) = collector.add("front", batch(20))
    assert set(complete) == set(SENSORS)


def test_an_unknown_camera_is_refused() -> None:
    with pytest.raises(KeyError):
        BatchCollector(SENSORS).add("rear", batch(0))
