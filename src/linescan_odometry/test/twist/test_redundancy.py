"""With more sensors than unknowns, a faulty one is isolated or the covariance grows."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import TwistEstimate
from linescan_odometry.odometry import LineScanOdometry
from linescan_odometry.twist.least_squares import TwistSolver
from omni_core.sensors import LineSensor, sensor_matrix
from omni_core.signals import LineBatch

Expose = Callable[..., Any]

TWIST = np.array([1.5, -0.5, 0.4])
PITCH, RATE = 5e-5, 2500.0


def ring(count: int) -> dict[str, LineSensor]:
    """Sensors on a circle whose axes deviate alternately from the tangent."""
    angles = [2.0 * math.pi * i / count for i in range(count)]
    return {
        f"s{i}": LineSensor(
            x=0.6 * math.cos(angle),
            y=0.6 * math.sin(angle),
            heading_deg=math.degrees(angle) + (60.0 if i % 2 else -100.0),
            pixels=256,
            length=256 * PITCH,
            line_rate=RATE,
        )
        for i, angle in enumerate(angles)
    }


def drive(
    expose: Expose, count: int, wrong: dict[str, float], **changes: Any
) -> tuple[TwistEstimate, np.ndarray[Any, Any]]:
    """Drive at constant twist; some sensors measure a velocity [m/s] other than the ground's."""
    sensors = ring(count)
    odometry = LineScanOdometry(OdometryConfiguration(sensors=sensors, **changes))
    batches = {}
    for i, (name, speed) in enumerate(zip(sensors, sensor_matrix(sensors) @ TWIST, strict=True)):
        positions = np.arange(26) * (speed + wrong.get(name, 0.0)) / RATE / PITCH
        lines = expose(positions, 256, seed=1 + i % 3, noise_seed=i)
        batches[name] = LineBatch(10_000_000, lines)
    estimate = odometry.update(batches)
    return estimate, estimate.twist - TWIST


@pytest.mark.parametrize(("count", "wrong"), [(5, "s0"), (5, "s3"), (6, "s5")])
def test_a_sensor_that_contradicts_the_others_is_left_out(
    count: int, wrong: str, expose: Expose
) -> None:
    estimate, error = drive(expose, count, {wrong: 0.7})
    assert estimate.measured
    assert abs(error).max() < 2e-3
    measured = {name: reading.measured for name, reading in estimate.readings.items()}
    assert measured == {name: name != wrong for name in measured}
    assert "contradicts" in estimate.readings[wrong].reason
    assert drive(expose, count, {wrong: 0.7}, contradiction_limit=0.0)[0].reason == ""


def test_two_wrong_sensors_of_seven_are_left_out(expose: Expose) -> None:
    estimate, error = drive(expose, 7, {"s1": 0.9, "s4": -0.5})
    assert abs(error).max() < 2e-3
    assert [n for n, r in estimate.readings.items() if not r.measured] == ["s1", "s4"]


def test_four_sensors_detect_a_faulty_one_and_enlarge_the_covariance(expose: Expose) -> None:
    right, _ = drive(expose, 4, {})
    estimate, error = drive(expose, 4, {"s2": 0.7})
    assert estimate.reason == ""
    assert np.trace(estimate.covariance) > 100.0 * np.trace(right.covariance)
    assert error @ np.linalg.solve(estimate.covariance, error) < 16.3  # 99.9 % of chi^2, 3 dof


@pytest.mark.parametrize("count", [3, 4, 5, 7])
def test_sensors_that_agree_are_all_used(count: int, expose: Expose) -> None:
    estimate, _ = drive(expose, count, {})
    without, _ = drive(expose, count, {}, contradiction_limit=0.0)
    assert estimate.reason == ""
    assert estimate.twist.tobytes() == without.twist.tobytes()
    assert estimate.covariance.tobytes() == without.covariance.tobytes()


def test_contradictions_have_unit_variance() -> None:
    sensors = ring(6)
    solver = TwistSolver(sensors, 0.02)
    variance = np.array([1.0, 4.0, 1.0, 9.0, 2.0, 1.0]) * 1e-4
    generator = np.random.default_rng(2)
    squares = np.zeros(6)
    for _ in range(2000):
        velocity = sensor_matrix(sensors) @ TWIST + np.sqrt(variance) * generator.normal(size=6)
        twist, covariance = solver.solve(velocity, variance, (True,) * 6)
        squares += solver.contradictions(velocity, variance, (True,) * 6, twist, covariance) ** 2
    assert squares / 2000 == pytest.approx(np.ones(6), abs=0.15)


def test_three_sensors_do_not_contradict_each_other() -> None:
    sensors = ring(5)
    solver = TwistSolver(sensors, 0.02)
    velocity = np.array([1.0, 5.0, 9.0, -3.0, -2.0])
    measured = (True, True, False, True, False)
    twist, covariance = solver.solve(velocity, np.ones(5), measured)
    assert not solver.contradictions(velocity, np.ones(5), measured, twist, covariance).any()
