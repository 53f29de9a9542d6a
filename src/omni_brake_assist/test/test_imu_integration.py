"""IMU readings at any rate, integrated over control steps."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from omni_brake_assist.brake_assist_node import StepTimer
from omni_brake_assist.imu_integration import ImuIntegrator
from omni_core.signals import ImuSample

MS = 1_000_000
STEP_NS = 10 * MS


def stamps(rate: float, jitter: float, seconds: float = 2.0) -> list[int]:
    """Return stamps [ns] at a mean rate [Hz]; the jitter is relative to the period."""
    random, count = np.random.default_rng(1), int(rate * seconds)
    times = (np.arange(count) + jitter * random.uniform(-0.5, 0.5, count) + 1.0) / rate
    return [round(1e9 * time) for time in times]


def steps(
    taken: list[int], rate_at: Callable[[float], float], speed_at: Callable[[float], float]
) -> tuple[list[int], list[ImuSample]]:
    """Return the ends of the steps [ns] and their samples.

    A reading contains the yaw rate at its stamp and the mean acceleration since the last reading.
    """
    imu, ends, found, waiting, last_ns = ImuIntegrator(0.05), [], [], list(taken), 0
    for now_ns in range(STEP_NS, taken[-1], STEP_NS):
        while waiting and waiting[0] <= now_ns:
            stamp_ns = waiting.pop(0)
            change = speed_at(stamp_ns * 1e-9) - speed_at(last_ns * 1e-9)
            force = np.array([change / ((stamp_ns - last_ns) * 1e-9), 0.0])
            imu.add(ImuSample(stamp_ns, rate_at(stamp_ns * 1e-9), force))
            last_ns = stamp_ns
        sample = imu.end_step(now_ns)
        if sample is not None:
            ends.append(now_ns)
            found.append(sample)
    return ends, found


def ended(imu: ImuIntegrator, now_ns: int) -> ImuSample:
    """End a step for which there is a reading, and return its sample."""
    sample = imu.end_step(now_ns)
    assert sample is not None
    return sample


@pytest.mark.parametrize("jitter", [0.0, 0.4])
@pytest.mark.parametrize("rate", [30.0, 50.0, 100.0, 130.0, 400.0, 1000.0])
def test_no_reading_is_lost_or_counted_twice(rate: float, jitter: float) -> None:
    def speed_at(time: float) -> float:
        return 2.0 * math.sin(3.0 * time)  # accelerations of up to 6 m/s^2

    ends, samples = steps(stamps(rate, jitter), lambda _: 0.0, speed_at)
    speed = speed_at(ends[0] * 1e-9) + np.cumsum(
        [sample.acceleration[0] * STEP_NS * 1e-9 for sample in samples[1:]]
    )
    true = [speed_at(end * 1e-9) for end in ends[1:]]
    # Only the part since the newest reading is extrapolated, with an error of its length squared.
    assert speed - true == pytest.approx(0.0, abs=0.02 + 20.0 / rate**2)
    assert np.mean((speed - true)[-20:]) == pytest.approx(np.mean((speed - true)[:20]), abs=0.01)


@pytest.mark.parametrize("rate", [100.0, 400.0, 1000.0])
def test_the_yaw_rate_is_that_of_the_newest_reading(rate: float) -> None:
    ends, samples = steps(stamps(rate, 0.0), lambda time: 30.0 * time, lambda _: 0.0)
    found = [sample.yaw_rate for sample in samples]
    assert found == pytest.approx([30.0 * 1e-9 * sample.stamp_ns for sample in samples])
    assert [sample.stamp_ns for sample in samples] == ends


def test_more_readings_have_less_noise() -> None:
    random = np.random.default_rng(2)
    _, samples = steps(stamps(1000.0, 0.0, 20.0), lambda _: random.normal(), lambda _: 0.0)
    deviation = np.std([sample.yaw_rate for sample in samples])
    assert deviation == pytest.approx(math.sqrt(38.0 / 110.0), rel=0.05)  # 2 (2n - 1) / (n (n + 1))


def test_a_slow_reading_is_held_and_then_corrected() -> None:
    imu = ImuIntegrator(0.05)
    imu.add(ImuSample(10 * MS, 0.1, np.array([1.0, 0.0])))
    assert ended(imu, 10 * MS).acceleration[0] == 1.0
    assert ended(imu, 20 * MS).acceleration[0] == pytest.approx(1.0)
    imu.add(ImuSample(30 * MS, 0.2, np.array([4.0, 0.0])))  # mean from 10 to 30 ms
    assert ended(imu, 30 * MS).acceleration[0] == pytest.approx(7.0)
    assert ended(imu, 40 * MS).acceleration[0] == pytest.approx(4.0)


@pytest.mark.parametrize("gap_ms", [70, 5000])
def test_nothing_is_integrated_over_a_long_gap(gap_ms: int) -> None:
    imu, force = ImuIntegrator(0.05), np.array([9.0, 0.0])
    imu.add(ImuSample(10 * MS, 0.1, np.zeros(2)))
    imu.end_step(10 * MS)
    imu.end_step((gap_ms - 10) * MS)
    imu.add(ImuSample(gap_ms * MS, 0.2, force))
    assert ended(imu, gap_ms * MS).acceleration == pytest.approx(force)
    imu.add(ImuSample(10 * MS, 0.3, force))  # the clock of the IMU has been reset
    assert ended(imu, 10 * MS).yaw_rate == pytest.approx(0.3)


def test_an_unknown_reading_is_unknown_only_while_it_is_the_newest() -> None:
    imu, unknown = ImuIntegrator(0.05), np.full(2, math.nan)
    for step, force in enumerate((np.ones(2), unknown, np.ones(2), np.ones(2))):
        stamp_ns = step * STEP_NS
        imu.add(ImuSample(stamp_ns, force[0], force))
        sample = ended(imu, stamp_ns)
        np.testing.assert_allclose(sample.acceleration, force)
        np.testing.assert_allclose(sample.yaw_rate, force[0])


@pytest.mark.parametrize("jitter", [0.0, 0.4])
@pytest.mark.parametrize("rate", [99.0, 100.0, 101.0, 130.0, 400.0, 1000.0])
def test_steps_follow_the_control_period_at_any_rate_of_the_messages(
    rate: float, jitter: float
) -> None:
    timer = StepTimer(0.01)
    due = [stamp_ns for stamp_ns in stamps(rate, jitter, 20.0) if timer.is_due(stamp_ns)]
    assert len(due) == pytest.approx(20.0 * min(rate, 100.0), rel=0.03)


def test_a_step_is_due_after_a_pause_and_after_a_reset_of_the_clock() -> None:
    timer = StepTimer(0.01)
    assert [timer.is_due(ms * MS) for ms in (5000, 5004, 5010, 9000, 9004, 100, 104, 110)] == [
        *(True, False, True),
        *(True, False),
        *(True, False, True),
    ]
