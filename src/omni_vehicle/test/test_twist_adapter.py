"""Components without a variance are completed, and never become measurements of zero."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.sensors import FlowSensor, Mount, sensor_matrix
from omni_core.signals import UNMEASURED_VARIANCE
from omni_vehicle.twist_adapter import (
    CompletedTwist,
    CovarianceCompletion,
    CovarianceConfiguration,
    Mounting,
    YawRates,
)

VALUE = np.array([1.2, -0.3, 0.5])
DEVIATION = (0.1, 0.2, 0.3)
NOTHING = np.zeros((3, 3))
GOOD = np.array([[0.007, 4e-5, 0.0], [4e-5, 0.005, 0.0], [0.0, 0.0, 0.01]])


def completion(**given: object) -> CovarianceCompletion:
    return CovarianceCompletion(CovarianceConfiguration(**given))  # type: ignore[arg-type]


def complete(covariance: np.ndarray, value: np.ndarray = VALUE, **given: object) -> CompletedTwist:
    return completion(**given).complete(value, covariance)


def test_a_complete_covariance_passes_unchanged() -> None:
    cases: tuple[dict[str, Any], ...] = ({}, {"deviation": DEVIATION})
    for given in cases:
        twist = complete(GOOD, **given)
        assert twist.problem == ""
        np.testing.assert_array_equal(twist.value, VALUE)
        np.testing.assert_array_equal(twist.covariance, GOOD)


@pytest.mark.parametrize("unknown", [0.0, -1.0, math.nan])
def test_the_deviation_fills_only_what_the_source_lacks(unknown: float) -> None:
    covariance = GOOD.copy()
    covariance[2, 2] = unknown
    twist = complete(covariance, deviation=DEVIATION)
    assert twist.problem == ""
    np.testing.assert_array_equal(twist.covariance[:2, :2], GOOD[:2, :2])
    np.testing.assert_allclose(twist.covariance[2], [0.0, 0.0, 0.09])
    replaced = complete(covariance, deviation=DEVIATION, replace_covariance=True)
    np.testing.assert_allclose(replaced.covariance, np.diag(np.square(DEVIATION)))


@pytest.mark.parametrize(
    ("row", "column", "element", "words"),
    [
        (0, 0, 0.0, "variance of linear.x is 0, .* parameter deviation; .* parameter unmeasured"),
        (1, 1, -1.0, "variance of linear.y is -1, "),
        (2, 2, math.nan, "variance of angular.z is nan, "),
        (2, 2, math.inf, "variance of angular.z is inf, "),
        (0, 2, 0.5, "covariance of linear.x and angular.z is 0.5, must be below 0.00836"),
        (2, 1, math.nan, "covariance of linear.y and angular.z is nan, "),
    ],
)
def test_an_element_that_cannot_be_used_is_named(
    row: int, column: int, element: float, words: str
) -> None:
    covariance = GOOD.copy()
    covariance[row, column] = element
    twist = complete(covariance)
    assert re.search(words, twist.problem)


def test_a_value_that_is_not_finite_is_named_unless_it_is_declared_unmeasured() -> None:
    value = np.array([1.2, -0.3, math.nan])
    assert complete(GOOD, value).problem.startswith("angular.z is nan, must be finite")
    twist = complete(GOOD, value, unmeasured=("angular.z",))
    assert twist.problem == ""
    np.testing.assert_array_equal(twist.value, [1.2, -0.3, 0.0])
    np.testing.assert_array_equal(twist.covariance[:2, :2], GOOD[:2, :2])
    np.testing.assert_array_equal(twist.covariance[2], [0.0, 0.0, UNMEASURED_VARIANCE])


def test_a_component_that_is_never_set_is_no_measurement_of_zero() -> None:
    source = completion(deviation=DEVIATION)
    straight = np.array([0.5, -0.1, 0.0])
    for _ in range(3):
        twist = source.complete(straight, NOTHING)
        assert (twist.problem, twist.unset) == ("", ("angular.z",))
        np.testing.assert_allclose(np.diag(twist.covariance), [0.01, 0.04, UNMEASURED_VARIANCE])
    # A source that has measured a yaw rate once may measure exactly 0.
    source.complete(VALUE, NOTHING)
    twist = source.complete(straight, NOTHING)
    assert twist.unset == ()
    np.testing.assert_allclose(np.diag(twist.covariance), np.square(DEVIATION))


def test_zero_is_a_measurement_at_rest_and_if_the_source_states_its_variance() -> None:
    at_rest = complete(NOTHING, np.zeros(3), deviation=DEVIATION)
    assert at_rest.unset == ()
    np.testing.assert_allclose(np.diag(at_rest.covariance), np.square(DEVIATION))
    straight = complete(GOOD, np.array([0.5, 0.0, 0.0]), deviation=DEVIATION)
    assert straight.unset == ()
    np.testing.assert_array_equal(straight.covariance, GOOD)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"deviation": (0.1, 0.1)}, "deviation: must be three numbers above 0"),
        ({"unmeasured": ("angular_z",)}, "'angular_z' is not one of linear.x, linear.y, angular.z"),
        ({"replace_covariance": True}, "needs the parameter deviation"),
    ],
)
def test_invalid_parameters_are_refused(given: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        completion(**given)


@pytest.mark.parametrize("heading", [0.0, -90.0, 37.0])
def test_a_mounted_sensor_measures_the_twist_of_base_link(heading: float) -> None:
    mount = FlowSensor(x=0.1016, y=-0.0508, heading_deg=heading)
    rows = np.vstack((sensor_matrix({"otos": mount}), (0.0, 0.0, 1.0)))  # and its gyro
    twist, covariance = Mounting(mount).base_twist(rows @ VALUE, GOOD)
    np.testing.assert_allclose(twist, VALUE, atol=1e-12)
    # The inverse of the information matrix of least squares
    np.testing.assert_allclose(
        covariance, np.linalg.inv(rows.T @ np.linalg.inv(GOOD) @ rows), atol=1e-12
    )


@pytest.mark.parametrize(
    ("error", "changed"),
    [
        ("scale_error", {}),
        ("heading_error_deg", {"heading_deg": 30.0 + 0.5}),
        ("lever_error", {"x": 0.3 + 0.01}),
    ],
)
def test_the_covariance_includes_the_errors_of_the_calibration(
    error: str, changed: dict[str, float]
) -> None:
    given: dict[str, Any] = {"x": 0.3, "y": -0.2, "heading_deg": 30.0}
    size = {"scale_error": 0.02, "heading_error_deg": 0.5, "lever_error": 0.01}[error]
    mounting = Mounting(Mount(**(given | {error: size})))
    true = FlowSensor(**(given | changed))
    velocity = sensor_matrix({"flow": true}) @ VALUE * (1.0 if changed else 1.0 + size)
    twist, covariance = mounting.base_twist(np.append(velocity, VALUE[2]), np.zeros((3, 3)))
    wrong = (twist - VALUE)[:2]
    assert wrong @ np.linalg.pinv(covariance[:2, :2], 1e-6) @ wrong == pytest.approx(1.0, rel=0.05)


def test_a_component_that_is_not_measured_stays_so_in_any_axes() -> None:
    for heading in range(0, 360, 7):
        mounting = Mounting(Mount(x=0.0, y=0.0, heading_deg=float(heading)))
        _, covariance = mounting.base_twist(np.zeros(3), UNMEASURED_VARIANCE * np.eye(3))
        assert np.all(np.diag(covariance) >= UNMEASURED_VARIANCE)


def test_a_yaw_rate_is_that_of_the_time_of_the_twist() -> None:
    rates = YawRates(timeout=0.05)
    assert math.isnan(rates.at(0))
    for k in range(300):
        rates.add(10_000_000 * k, 0.01 * k)
    assert rates.at(2_985_000_000) == pytest.approx(2.985)
    assert rates.at(3_030_000_000) == pytest.approx(2.99)  # of the newest reading
    assert math.isnan(rates.at(3_050_000_000))
    rates.add(5_000_000, 7.0)  # the clock went back
    assert rates.at(5_000_000) == 7.0
    assert math.isnan(rates.at(2_985_000_000))
