"""The clock of the watchdogs counts only the time during which the process ran."""

import pytest

from omni_ros.clocks import RunningClock

PERIOD = 0.025  # [s]


def test_an_interval_counts_at_most_one_period() -> None:
    readings = iter([100.0, 100.01, 100.03, 100.11, 100.12])  # suspended from 100.03 to 100.11
    clock = RunningClock(PERIOD, lambda: next(readings))
    assert [clock.now() for _ in range(4)] == pytest.approx([0.01, 0.03, 0.055, 0.065])


def test_the_time_of_a_running_process_counts_in_full() -> None:
    readings = (step * PERIOD for step in range(100))
    clock = RunningClock(PERIOD, lambda: next(readings))
    assert [clock.now() for _ in range(99)][-1] == pytest.approx(99 * PERIOD)
