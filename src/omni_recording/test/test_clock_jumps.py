"""A clock that is set during a recording is found; late and interleaved messages are no jumps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from omni_recording.clock import ClockWatch

START_NS, SECOND_NS = 1_700_000_000 * 10**9, 10**9
Times = list[tuple[int, int]]


def steady(rate: float = 100.0, duration: float = 20.0) -> Times:
    """Return times and log times of messages that arrive at once [ns]."""
    return [(START_NS + round(k / rate * 1e9),) * 2 for k in range(round(rate * duration))]


def changes(times: Times) -> list[float]:
    """Return the jumps that are found [s]."""
    watch = ClockWatch()
    for time_ns, log_ns in times:
        watch.add(time_ns, log_ns)
    return [jump.change_ns / SECOND_NS for jump in (*watch.jumps, *watch.log_jumps)]


@pytest.mark.parametrize("size", [-3600.0, -5.0, -0.3])
@pytest.mark.parametrize("both", [False, True])
def test_a_clock_that_is_set_back_is_found(size: float, both: bool) -> None:
    change = round(size * 1e9)
    times = steady()
    for k in range(1000, len(times)):
        time_ns, log_ns = times[k]
        times[k] = time_ns + change, log_ns + change * both
    assert changes(times) == pytest.approx([size], abs=0.011)
    assert changes(times[:1003]) == pytest.approx([size], abs=0.011)


@pytest.mark.parametrize("size", [0.3, 5.0, 3600.0])
def test_a_publisher_whose_clock_is_set_ahead_is_found(size: float) -> None:
    times = steady()
    times[1000:] = [(time_ns + round(size * 1e9), log_ns) for time_ns, log_ns in times[1000:]]
    assert changes(times) == pytest.approx([size], abs=1e-6)


@pytest.mark.parametrize("messages", [1, 1000])
def test_a_recorder_whose_clock_leaps_is_found(messages: int) -> None:
    years_ns = 56 * 365 * 24 * 3600 * SECOND_NS
    watch = ClockWatch()
    for k, (time_ns, log_ns) in enumerate(steady()):
        watch.add(time_ns, log_ns + years_ns * (1000 <= k < 1000 + messages))
    assert not watch.jumps
    assert [(jump.number, jump.change_ns) for jump in watch.log_jumps] == [(1000, years_ns)]


def late_messages() -> Times:
    return [(t - SECOND_NS * (k % 50 == 0), log) for k, (t, log) in enumerate(steady())]


def late_burst() -> Times:
    return [(t - 2 * SECOND_NS * (700 <= k < 720), log) for k, (t, log) in enumerate(steady())]


def random_delays() -> Times:
    delays = np.random.default_rng(3).uniform(0, 0.15, 2000)
    arrived = [(t, t + round(d * 1e9)) for (t, _), d in zip(steady(), delays, strict=True)]
    return sorted(arrived, key=lambda entry: entry[1])


def two_publishers() -> Times:
    delayed = [(t, t + SECOND_NS // 2) for t, _ in steady(10.0)]
    return sorted(delayed + steady(1.0), key=lambda entry: entry[1])


def stalled() -> Times:
    """Return messages that are stored for 5 s and then arrive together."""
    times = steady()
    return [
        (t, max(log, START_NS + 10 * SECOND_NS) if k > 500 else log)
        for k, (t, log) in enumerate(times)
    ]


def stored_at_start() -> Times:
    return [(START_NS - 100 * SECOND_NS, START_NS), *steady()[1:]]


def paused() -> Times:
    return [times for k, times in enumerate(steady()) if not 500 < k < 1500]


def simulated(rate: float) -> Callable[[], Times]:
    def times() -> Times:
        return [(t - START_NS, START_NS + round((t - START_NS) / rate)) for t, _ in steady(1.0)]

    return times


def published_again() -> Times:
    """Return messages with the stamp of the first one, of which the last one is days later."""
    return [(START_NS, START_NS + k * 72 * 3600 * SECOND_NS) for k in range(3)]


def without_stamp() -> Times:
    return [(t * (k > 200), log) for k, (t, log) in enumerate(steady())]


@pytest.mark.parametrize(
    "times",
    [
        *(steady, late_messages, late_burst, random_delays, two_publishers, stalled),
        *(stored_at_start, paused, simulated(0.1), simulated(50.0), without_stamp, published_again),
    ],
)
def test_other_times_are_no_jumps(times: Callable[[], Times]) -> None:
    assert not changes(times())


@pytest.mark.parametrize(("first", "unset"), [(0, 0), (5, 3)])
def test_messages_without_a_time_that_follow_others_are_counted(first: int, unset: int) -> None:
    times = [(t * (not first <= k < first + 3), log) for k, (t, log) in enumerate(steady())]
    watch = ClockWatch()
    for time_ns, log_ns in times:
        watch.add(time_ns, log_ns)
    assert watch.unset == unset
    assert not watch.jumps
