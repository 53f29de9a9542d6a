"""Displacements that the platform cannot have made since the last measurement are rejected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.plausibility import Plausibility
from linescan_odometry.sensor import SensorOdometry
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch

SENSOR = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=1000, length=0.05, line_rate=2500.0)
PERIOD_NS = 400_000


def judge(filter_: Plausibility, stamp_ns: int, *displacements: float) -> list[bool]:
    return [bool(x) for x in filter_.check(stamp_ns, np.array(displacements))]


def test_without_a_measurement_everything_is_plausible() -> None:
    assert judge(Plausibility(SENSOR, 10.0, 1.5), 0, -400.0, 0.0, 400.0) == [True] * 3


def test_the_range_widens_with_the_acceleration() -> None:
    filter_ = Plausibility(SENSOR, 12.5, 1.0)
    filter_.accept(0, 1, 40.0)  # 40 px per line are 5 m/s
    # 80 ms at 12.5 m/s^2 are 1 m/s, 8 px per line.
    assert judge(filter_, 80_000_000, 48.9) == judge(filter_, 80_000_000, 31.1) == [True]
    assert judge(filter_, 80_000_000, 49.1) == judge(filter_, 80_000_000, 30.9) == [False]
    assert judge(filter_, 4_000_000_000, 430.0) == [True]  # no displacement is rejected forever


def test_each_pair_has_the_time_of_its_line() -> None:
    filter_ = Plausibility(SENSOR, 1250.0, 1.0)  # 4 px per line for each line
    filter_.accept(0, 1, 0.0)
    plausible = judge(filter_, 3 * PERIOD_NS, 4.9, 8.9, 12.9)
    assert plausible == [True, True, True]
    assert judge(filter_, 3 * PERIOD_NS, 5.1, 9.1, 13.1) == [False, False, False]


def test_a_mean_belongs_to_the_middle_of_its_lines() -> None:
    filter_ = Plausibility(SENSOR, 1250.0, 1.0)
    filter_.accept(4 * PERIOD_NS, 5, 0.0)  # pairs end at 0..4 periods, the middle is 2
    assert judge(filter_, 5 * PERIOD_NS, 12.9) == [True]
    assert judge(filter_, 5 * PERIOD_NS, 13.1) == [False]


@pytest.mark.parametrize("back_ns", [1, 10**9])
def test_time_that_goes_back_starts_anew(back_ns: int) -> None:
    filter_ = Plausibility(SENSOR, 1.0, 1.0)
    filter_.accept(2 * 10**9, 1, 0.0)
    assert judge(filter_, 2 * 10**9 - back_ns, 300.0) == [True]


@pytest.mark.parametrize(("maximum_acceleration", "accepted"), [(0.0, True), (20.0, False)])
def test_a_sensor_rejects_a_jump(
    maximum_acceleration: float, accepted: bool, expose: Callable[..., Any]
) -> None:
    sensors = {
        name: LineSensor(x=x, y=y, heading_deg=turn, pixels=256, length=0.0128)
        for name, x, y, turn in (
            ("a", 0.5, 0.0, 90.0),
            ("b", 0.0, 0.5, 180.0),
            ("c", -0.5, 0.0, 0.0),
        )
    }
    sensor = SensorOdometry(
        sensors["a"],
        OdometryConfiguration(sensors=sensors, maximum_acceleration=maximum_acceleration),
    )
    # The second batch shows a reflection that moves the other way; the third is correct.
    for i, (step, measured) in enumerate(((7.0, True), (-9.0, accepted), (7.2, True))):
        lines = expose(step * np.arange(26), 256, seed=1 + i, noise_seed=i)
        reading = sensor.update(LineBatch(i * 10_000_000, lines))
        assert reading.measured == measured
        if measured:
            assert reading.velocity == pytest.approx(step * 0.125, abs=2e-3)
        else:
            assert "plausible" in reading.reason
