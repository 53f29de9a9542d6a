"""The sampled, noisy velocity sensor (60), (61)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from omni_sim.sensor_configuration import VelocitySensorConfiguration
from omni_sim.velocity_sensor import VelocitySensor

MILLISECOND = 1_000_000
TWIST = np.array([2.0, -1.0, 0.5])


def sensor(seed: int = 1, **values: Any) -> VelocitySensor:
    return VelocitySensor(VelocitySensorConfiguration(**values), np.random.default_rng(seed))


def test_without_noise_it_measures_the_true_twist() -> None:
    np.testing.assert_array_equal(sensor().measure(0, TWIST).value, TWIST)


def test_reading_is_held_until_the_next_sample() -> None:
    device = sensor(sample_time=0.02)
    first = device.measure(0, TWIST).value
    np.testing.assert_array_equal(device.measure(19 * MILLISECOND, 3.0 * TWIST).value, first)
    np.testing.assert_array_equal(device.measure(20 * MILLISECOND, 3.0 * TWIST).value, 3.0 * TWIST)


def test_reading_twice_at_one_stamp_draws_once() -> None:
    device, other = sensor(linear_noise=0.1), sensor(linear_noise=0.1)
    for stamp in range(0, 50 * MILLISECOND, 10 * MILLISECOND):
        once = other.measure(stamp, TWIST).value
        np.testing.assert_array_equal(device.measure(stamp, TWIST).value, once)
        np.testing.assert_array_equal(device.measure(stamp, TWIST).value, once)


def test_noise_is_uniform_independent_and_a_share_of_the_value() -> None:
    device = sensor(
        linear_noise=0.15, yaw_rate_noise=0.3, offset_x=0.01, offset_y=0.02, yaw_rate_offset=0.05
    )
    readings = np.array([device.measure(i * 10 * MILLISECOND, TWIST).value for i in range(20000)])
    errors = (readings - np.array([0.01, 0.02, 0.05])) / TWIST - 1.0
    share = np.array([0.15, 0.15, 0.3])
    assert np.all(np.abs(errors) <= share + 1e-12)
    assert np.all(np.max(np.abs(errors), axis=0) > 0.99 * share)
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=0.02 * 0.3)
    np.testing.assert_allclose(errors.std(axis=0), share / np.sqrt(3.0), rtol=0.02)
    assert np.max(np.abs(np.corrcoef(errors.T) - np.eye(3))) < 0.03


def test_same_seed_gives_the_same_noise() -> None:
    a, b, c = sensor(7, linear_noise=0.1), sensor(7, linear_noise=0.1), sensor(8, linear_noise=0.1)
    np.testing.assert_array_equal(a.measure(0, TWIST).value, b.measure(0, TWIST).value)
    assert not np.array_equal(a.measure(10 * MILLISECOND, TWIST).value, c.measure(0, TWIST).value)


@pytest.mark.parametrize(
    ("failure", "reading"),
    [("frozen", TWIST), ("zero", np.zeros(3)), ("invalid", np.full(3, np.nan))],
)
def test_it_fails_for_a_while(failure: str, reading: np.ndarray) -> None:
    device = sensor(failure=failure, failure_time=0.02, failure_duration=0.03)
    for stamp in range(0, 80 * MILLISECOND, 10 * MILLISECOND):
        fails = 20 * MILLISECOND <= stamp < 50 * MILLISECOND
        twist = TWIST if stamp <= 10 * MILLISECOND else 2.0 * TWIST
        np.testing.assert_array_equal(
            device.measure(stamp, twist).value, reading if fails else twist
        )


@pytest.mark.parametrize("failure", ["none", "frozen", "zero", "invalid"])
def test_a_reading_is_stamped_with_the_time_of_its_sample(failure: str) -> None:
    """A faulty sensor also stamps its readings, so the stamps do not show the fault."""
    device = sensor(sample_time=0.02, failure=failure, failure_time=0.02, failure_duration=0.03)
    stamps = [device.measure(step * 10 * MILLISECOND, TWIST).stamp_ns for step in range(8)]
    assert stamps == [ms * MILLISECOND for ms in (0, 0, 20, 20, 40, 40, 60, 60)]
