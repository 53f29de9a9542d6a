"""Lines are exposed at j / rate, each in exactly one control period."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from omni_sim.camera.batches import LineClock

PERIOD_NS = 10_000_000


@pytest.mark.parametrize("rate", [2500.0, 2985.0, 15600.0, 2985.3, 300.0])
def test_ten_seconds_hold_every_line_once_in_its_own_period(rate: float) -> None:
    clock = LineClock(rate)
    expected = 0
    for k in range(1001):
        after, until = (k - 1) * PERIOD_NS if k else -1, k * PERIOD_NS
        first, end = clock.lines_in(after, until)
        assert first == expected
        expected = end
        for line in {first, end - 1} if end > first else set():
            assert after < Fraction(line) / Fraction(rate) * 10**9 <= until
    assert expected == int(Fraction(rate) * 10) + 1


def test_a_line_at_a_control_stamp_belongs_to_the_period_that_ends_there() -> None:
    clock = LineClock(2500.0)
    assert clock.lines_in(-1, 0) == (0, 1)
    assert clock.lines_in(0, PERIOD_NS) == (1, 26)
    assert clock.stamp_ns(25) == PERIOD_NS


def test_stamps_are_times_rounded_to_nanoseconds() -> None:
    clock = LineClock(2985.0)
    times = clock.times_ns(0, 5000)
    np.testing.assert_allclose(times, np.arange(5000) * 1e9 / 2985.0, rtol=1e-14)
    assert all(abs(clock.stamp_ns(j) - times[j]) <= 0.5 + 1e-6 for j in range(5000))


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_rates_are_refused(rate: float) -> None:
    with pytest.raises(ValueError, match="line rate"):
        LineClock(rate)
