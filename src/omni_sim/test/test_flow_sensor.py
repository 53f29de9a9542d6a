"""The counts of simulated flow sensors give the path of their positions."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.sensors import FlowSensor, sensor_matrix
from omni_sim.flow_sensor import FlowConfiguration, FlowSensorArray, check_flow_sensors

SENSORS = {
    "front": FlowSensor(x=0.5, y=0.1, heading_deg=20.0),
    "slow": FlowSensor(x=-0.4, y=0.3, heading_deg=-70.0, rate=50.0),
}
TWIST = np.array((1.5, -0.6, 0.9))
STEPS, STEP = 20, 0.0005
PERIOD_NS = 10_000_000
PERFECT = FlowConfiguration(resolution=0.0, noise=1e-15, scale=0.0)


def array(twist: np.ndarray = TWIST, **errors: Any) -> FlowSensorArray:
    configuration = dataclasses.replace(PERFECT, **errors)
    return FlowSensorArray(SENSORS, configuration, np.random.default_rng(5), twist)


def circle(start: float, twist: np.ndarray = TWIST) -> np.ndarray:
    """Return x, y, yaw of a vehicle with a constant body twist over a control period."""
    yaw = twist[2] * (start + STEP * np.arange(STEPS + 1))
    v_x, v_y, rate = twist
    x = (v_x * np.sin(yaw) + v_y * (np.cos(yaw) - 1.0)) / rate
    y = (v_y * np.sin(yaw) + v_x * (1.0 - np.cos(yaw))) / rate
    return np.column_stack((x, y, yaw))


def test_a_steady_turn_is_measured_exactly_by_each_at_its_rate() -> None:
    subject, expected = array(), (sensor_matrix(SENSORS) @ TWIST).reshape(2, 2)
    measured = subject.measure(0)
    for i in range(1, 9):
        np.testing.assert_allclose(measured["front"].velocity, expected[0], rtol=1e-6)
        measured = subject.measure(i * PERIOD_NS, circle(0.01 * (i - 1)))
        assert list(measured) == (["front", "slow"] if i % 2 == 0 else ["front"])
        if "slow" in measured:
            np.testing.assert_allclose(measured["slow"].velocity, expected[1], rtol=1e-6)


def test_no_count_is_lost_and_the_covariance_is_that_of_the_errors() -> None:
    """The counts add up to the path; the errors agree with noise and rounding."""
    subject, truth = array(resolution=0.002, noise=0.001), (sensor_matrix(SENSORS) @ TWIST)[:2]
    velocities, stated = [], 0.0
    for i in range(1, 801):
        flow = subject.measure(i * PERIOD_NS, circle(0.01 * (i - 1)))["front"]
        velocities.append(flow.velocity)
        stated = float(flow.covariance[0, 0])
    errors = np.array(velocities) - truth
    counts = np.array(velocities) * 0.01 / 0.002
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    np.testing.assert_allclose(np.mean(errors, axis=0), 0.0, atol=4.0 * 0.1 / math.sqrt(800))
    assert np.mean(errors**2) == pytest.approx(stated, rel=0.12)


def test_faster_than_it_can_follow_it_reads_no_number() -> None:
    quick = {"only": FlowSensor(x=0.0, y=0.0, heading_deg=0.0, maximum_speed=1.5)}
    for speed, follows in ((1.49, True), (1.51, False)):
        subject = FlowSensorArray(
            quick,
            PERFECT,
            np.random.default_rng(1),
            np.array((speed, 0.0, 0.0)),
        )
        assert bool(np.isfinite(subject.measure(0)["only"].velocity).all()) == follows


@pytest.mark.parametrize(
    ("failure", "share"), [("zero", 0.0), ("double", 2.0), ("invalid", math.nan), ("frozen", 1.0)]
)
def test_one_fails_from_its_time_on(failure: str, share: float) -> None:
    subject = array(failing="front", failure=failure, failure_start=0.01)
    before = subject.measure(0)["front"].velocity
    path = circle(0.0, 2.0 * TWIST) if failure == "frozen" else circle(0.0)
    after = subject.measure(PERIOD_NS, path)["front"].velocity
    np.testing.assert_allclose(after, share * before, rtol=1e-6)


def test_rates_that_do_not_fit_and_a_failure_of_an_unknown_sensor_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"flow_sensors.a.rate: 60 1/s is a period of"):
        check_flow_sensors(
            {"a": FlowSensor(x=0.0, y=0.0, heading_deg=0.0, rate=60.0)}, FlowConfiguration(), 0.01
        )
    with pytest.raises(ConfigurationError, match="'b' is none of front, slow"):
        check_flow_sensors(SENSORS, FlowConfiguration(failing="b"), 0.01)
