"""A kinematic constraint in place of a sensor: its benefit, hidden errors, and contradictions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import TwistEstimate
from linescan_odometry.odometry import LineScanOdometry
from linescan_odometry.twist.least_squares import (
    KinematicsConfiguration,
    TwistSolver,
    check_placement,
)
from omni_core.configuration import ConfigurationError
from omni_core.sensors import LineSensor, sensor_matrix
from omni_core.signals import LineBatch

Expose = Callable[..., Any]

PITCH, RATE = 5e-5, 2500.0
DEVIATION = 0.02


def sensor(x: float, y: float, heading_deg: float = 0.0) -> LineSensor:
    return LineSensor(
        x=x, y=y, heading_deg=heading_deg, pixels=256, length=256 * PITCH, line_rate=RATE
    )


SIDES = {"left": sensor(0.1, 0.4), "right": sensor(0.1, -0.4)}
AHEAD = {"ahead": sensor(0.6, 0.1, 90.0)}
AXLE_X = -0.5


def configuration(sensors: Mapping[str, LineSensor], **changes: Any) -> OdometryConfiguration:
    kinematics = KinematicsConfiguration(
        constraint="unsteered_axle", axle_x=AXLE_X, deviation=DEVIATION, deviation_share=0.0
    )
    return OdometryConfiguration(sensors=sensors, kinematics=kinematics, **changes)


def drive(
    expose: Expose,
    sensors: Mapping[str, LineSensor],
    twist: tuple[float, float, float],
    blind: str = "",
    settings: OdometryConfiguration | None = None,
) -> TwistEstimate:
    batches = {}
    for i, (name, speed) in enumerate(
        zip(sensors, sensor_matrix(sensors) @ np.array(twist), strict=True)
    ):
        lines = expose(np.arange(26) * speed / RATE / PITCH, 256, seed=1 + i % 3, noise_seed=i)
        batches[name] = LineBatch(10_000_000, lines)
    batches.pop(blind, None)
    return LineScanOdometry(settings or configuration(sensors)).update(batches)


@pytest.mark.parametrize("yaw_rate", [0.0, 1.5, -0.6])
def test_two_sensors_and_an_axle_that_grips_give_the_twist(yaw_rate: float, expose: Expose) -> None:
    twist = (2.0, -AXLE_X * yaw_rate, yaw_rate)
    estimate = drive(expose, SIDES, twist)
    assert estimate.measured
    assert estimate.assumed
    assert estimate.reason == ""
    assert estimate.twist == pytest.approx(twist, abs=2e-3)


def test_two_sensors_are_wrong_by_the_skid_and_their_covariance_by_the_deviation(
    expose: Expose,
) -> None:
    skid = 0.3
    estimate = drive(expose, SIDES, (2.0, skid - AXLE_X * 0.8, 0.8))
    assert estimate.assumed
    assert estimate.skid == ""
    assert estimate.twist == pytest.approx((2.0, -AXLE_X * 0.8, 0.8), abs=2e-3)
    # The variance of v_y at the axle is the assumed one, not that of the true error.
    row = np.array([0.0, 1.0, AXLE_X])
    assert math.sqrt(row @ estimate.covariance @ row) == pytest.approx(DEVIATION, rel=1e-6)


def test_three_sensors_are_accepted_and_detect_the_skid(expose: Expose) -> None:
    three = SIDES | AHEAD
    twist = (2.0, 0.3 - AXLE_X * 0.8, 0.8)
    skidding = drive(expose, three, twist)
    assert skidding.twist == pytest.approx(twist, abs=2e-3)
    assert not skidding.assumed
    assert "axle at x = -0.5 m moves sideways at 0.3" in skidding.skid
    assert skidding.skid in skidding.reason
    gripping = drive(expose, three, (2.0, -AXLE_X * 0.8, 0.8))
    assert (gripping.reason, gripping.assumed) == ("", False)
    # The constraint does not affect the twist of three sensors, correct or faulty.
    plain = drive(expose, three, twist, settings=OdometryConfiguration(sensors=three))
    assert plain.twist == pytest.approx(skidding.twist, abs=1e-12)
    assert plain.covariance == pytest.approx(skidding.covariance, rel=1e-9)
    silent = drive(expose, three, twist, settings=configuration(three, contradiction_limit=0.0))
    assert silent.skid == ""


def test_the_axle_stands_in_for_a_sensor_that_fails(expose: Expose) -> None:
    three = SIDES | AHEAD
    twist = (2.0, -AXLE_X * 0.8, 0.8)
    estimate = drive(expose, three, twist, blind="ahead")
    assert (estimate.measured, estimate.assumed) == (True, True)
    assert estimate.twist == pytest.approx(twist, abs=2e-3)
    without = OdometryConfiguration(sensors=three)
    assert not drive(expose, three, twist, blind="ahead", settings=without).measured
    # One camera along y and one along x are also sufficient.
    estimate = drive(expose, three, twist, blind="left")
    assert estimate.twist == pytest.approx(twist, abs=2e-3)


def test_sensors_side_by_side_check_each_other_but_not_the_axle(expose: Expose) -> None:
    sensors = SIDES | {"middle": sensor(0.0, 0.0), "far": sensor(0.0, 0.9)}
    settings = configuration(sensors)
    batches = {}
    for i, (name, speed) in enumerate(
        zip(sensors, sensor_matrix(sensors) @ np.array((2.0, 0.9, 0.8)), strict=True)
    ):
        seen = speed + (0.5 if name == "far" else 0.0)
        lines = expose(np.arange(26) * seen / RATE / PITCH, 256, seed=1 + i % 3, noise_seed=i)
        batches[name] = LineBatch(10_000_000, lines)
    estimate = LineScanOdometry(settings).update(batches)
    assert "contradicts" in estimate.readings["far"].reason
    assert estimate.assumed
    assert estimate.twist == pytest.approx((2.0, -AXLE_X * 0.8, 0.8), abs=2e-3)


def test_the_deviation_of_the_axle_grows_with_the_speed() -> None:
    kinematics = KinematicsConfiguration(
        constraint="unsteered_axle", deviation=0.03, deviation_share=0.01
    )
    assert kinematics.variance(0.0) == pytest.approx(0.03**2)
    assert kinematics.variance(4.0) == pytest.approx(0.05**2)


def test_covariance_is_the_scatter_where_the_axle_scatters_as_stated() -> None:
    kinematics = KinematicsConfiguration(constraint="unsteered_axle", axle_x=AXLE_X)
    solver = TwistSolver(SIDES, 0.02, kinematics)
    variance = np.array([1e-6, 4e-6, DEVIATION**2])
    generator = np.random.default_rng(4)
    errors = np.empty((3000, 3))
    for row in errors:
        slip = DEVIATION * generator.standard_normal()
        twist_now = np.array([2.0, slip - AXLE_X * 0.8, 0.8])
        exact = np.append(sensor_matrix(SIDES) @ twist_now, 0.0)
        exact[:2] += np.sqrt(variance[:2]) * generator.standard_normal(2)
        twist, covariance = solver.solve(exact, variance, (True, True, True))
        row[:] = twist - twist_now
    white = errors @ np.linalg.inv(np.linalg.cholesky(covariance)).T
    assert white.T @ white / 3000 == pytest.approx(np.eye(3), abs=0.1)


@pytest.mark.parametrize(
    ("sensors", "words"),
    [
        ({"left": sensor(0.1, 0.4)}, "two sensors are needed in addition.*there are 1: left"),
        (
            {"front": sensor(0.6, 0.0, 90.0), "back": sensor(-0.6, 0.0, -90.0)},
            "axes of front, back and of the axle at x = -0.5 m are parallel",
        ),
        (
            {"first": sensor(0.6, 0.3), "second": sensor(-0.6, 0.3)},
            r"first, second and of the axle at x = -0.5 m pass through one point, \(-0.50, 0.30\)",
        ),
    ],
)
def test_what_stays_unseen_is_named(sensors: dict[str, LineSensor], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        check_placement(sensors, 0.02, AXLE_X)


def test_an_axle_far_away_is_no_hindrance_to_sensors_that_suffice() -> None:
    check_placement(SIDES | AHEAD, 0.02, -30.0)
    with pytest.raises(ConfigurationError, match="pass through one point"):
        check_placement(SIDES, 0.02, -30.0)


def test_with_two_sensors_the_constraint_is_reported() -> None:
    with pytest.raises(ConfigurationError, match=r"there are 2: left, right; .*constraint"):
        OdometryConfiguration(sensors=SIDES)
    # A crossed pair needs an axle elsewhere: it cannot measure a rotation about itself.
    crossed = {"along": sensor(0.3, 0.0), "across": sensor(0.3, 0.0, 90.0)}
    check_placement(crossed, 0.02, -0.5)
    with pytest.raises(ConfigurationError, match="pass through one point"):
        check_placement(crossed, 0.02, 0.3)
