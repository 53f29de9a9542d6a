"""Sideslip of a wheel: angle, standard deviation, and cases without a measurement."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from linescan_odometry.configuration import OdometryConfiguration, SideslipWheel
from linescan_odometry.measurements import SensorReading, TwistEstimate
from linescan_odometry.odometry import LineScanOdometry
from linescan_odometry.port import OdometryPort
from linescan_odometry.sideslip import (
    SideslipConfiguration,
    SideslipMeter,
    WheelSideslip,
    angles,
    sideslip_angle,
)
from linescan_odometry.twist.least_squares import TwistSolver
from omni_core.configuration import ConfigurationError
from omni_core.sensors import LineSensor, sensor_matrix
from omni_core.signals import LineBatch

Expose = Callable[..., Any]

PITCH, RATE = 5e-5, 2500.0
WHEEL = SideslipWheel(sensor="side", x=0.6, y=0.5, steering_deg=10.0)
TWIST = np.array([4.0, -0.7, 0.9])


def sensor(x: float, y: float, heading_deg: float) -> LineSensor:
    return LineSensor(
        x=x, y=y, heading_deg=heading_deg, pixels=256, length=256 * PITCH, line_rate=RATE
    )


SENSORS = {
    "left": sensor(0.0, 0.5, 0.0),
    "right": sensor(0.0, -0.5, 0.0),
    "side": sensor(0.75, 0.55, 95.0),  # neither at the wheel nor along its axis, 100 deg
}


def wheel_velocity(twist: Any = TWIST, wheel: SideslipWheel = WHEEL) -> tuple[float, float]:
    """Forward and sideways velocity of the wheel's contact, from rigid-body motion."""
    v_x = twist[0] - twist[2] * wheel.y
    v_y = twist[1] + twist[2] * wheel.x
    angle = math.radians(wheel.steering_deg)
    return (
        v_x * math.cos(angle) + v_y * math.sin(angle),
        -v_x * math.sin(angle) + v_y * math.cos(angle),
    )


def seen(twist: Any = TWIST) -> SensorReading:
    speed = float((sensor_matrix(SENSORS) @ twist)[2])
    return SensorReading(speed, 1e-4, 1.0, 1.0, True)


@pytest.mark.parametrize("forward", [3.0, -3.0])
def test_the_angle_opposes_the_slide(forward: float) -> None:
    assert sideslip_angle(0.0, forward) == 0.0
    assert sideslip_angle(-3.0, forward) == pytest.approx(math.pi / 4.0)  # to the right
    assert sideslip_angle(3.0, forward) == pytest.approx(-math.pi / 4.0)


@pytest.mark.parametrize("twist", [TWIST, -TWIST, np.array([1.0, 1.5, -0.4])])
def test_lever_and_skew_of_the_camera_are_taken_out(twist: Any) -> None:
    forward, sideways = wheel_velocity(twist)
    geometry = WheelSideslip(WHEEL, SENSORS["side"])
    estimate = geometry.measure(seen(twist), forward, float(twist[2]), np.zeros((3, 3)))
    assert estimate.measured
    assert estimate.sideways == pytest.approx(sideways)
    assert estimate.angle == pytest.approx(-math.atan2(sideways, abs(forward)))


@pytest.mark.parametrize("twist", [TWIST, np.array([3.0, 2.5, 0.9])])
def test_deviation_is_the_scatter_of_the_angle(twist: Any) -> None:
    forward, _ = wheel_velocity(twist)
    geometry = WheelSideslip(WHEEL, SENSORS["side"])
    spread = np.array([0.03, 0.06, 0.05])
    covariance = np.diag(spread**2)
    covariance[0, 1] = covariance[1, 0] = 0.5 * spread[0] * spread[1]
    truth = np.array([seen(twist).velocity, forward, twist[2]])
    claimed = geometry.measure(seen(twist), forward, float(twist[2]), covariance).deviation
    generator = np.random.default_rng(5)
    found = [
        geometry.measure(dataclasses.replace(seen(), velocity=u), v_f, rate, covariance).angle
        for u, v_f, rate in generator.multivariate_normal(truth, covariance, 4000)
    ]
    assert np.std(found) == pytest.approx(claimed, rel=0.04)


def test_with_a_twist_the_errors_of_the_camera_count_once() -> None:
    """With three sensors, the camera's error also affects the yaw rate and v_y."""
    sensors = SENSORS | {"side": sensor(0.75, 0.55, 140.0)}
    wheel = dataclasses.replace(WHEEL, steering_deg=25.0)  # relative to the camera
    solver = TwistSolver(sensors, 0.02)
    geometry = WheelSideslip(wheel, sensors["side"])
    variance = np.array([1e-4, 1e-4, 9e-4])
    generator = np.random.default_rng(6)
    found, claimed = [], 0.0
    for _ in range(3000):
        velocity = sensor_matrix(sensors) @ TWIST + np.sqrt(variance) * generator.normal(size=3)
        twist, covariance = solver.solve(velocity, variance, (True,) * 3)
        readings = {
            name: SensorReading(float(v), float(s), 1.0, 1.0, True)
            for name, v, s in zip(sensors, velocity, variance, strict=True)
        }
        estimate = geometry.measure_with(TwistEstimate(0, twist, covariance, True, readings))
        found.append(estimate.angle)
        claimed = estimate.deviation
    forward, sideways = wheel_velocity(TWIST, wheel)
    assert np.mean(found) == pytest.approx(-math.atan2(sideways, forward), abs=1e-3)
    assert np.std(found) == pytest.approx(claimed, rel=0.05)


@pytest.mark.parametrize("wrong", ["side", "rear", "left", "right"])
def test_a_contradiction_is_in_the_deviation(wrong: str, expose: Expose) -> None:
    """Four sensors detect that one is faulty, but not which one it is."""
    sensors = {
        "side": sensor(0.7, 0.5, 90.0),
        "rear": sensor(-0.5, 0.5, 90.0),
        "left": sensor(0.0, 0.4, 0.0),
        "right": sensor(0.0, -0.4, 0.0),
    }
    wheel = SideslipWheel(sensor="side", x=0.7, y=0.5)
    twist = np.array([2.0, -1.6, 0.4])
    forward, sideways = wheel_velocity(twist, wheel)

    def drive(fault: float, **changes: Any) -> tuple[TwistEstimate, float, float]:
        batches = {}
        for i, (name, speed) in enumerate(
            zip(sensors, sensor_matrix(sensors) @ twist, strict=True)
        ):
            seen_speed = speed + (fault if name == wrong else 0.0)
            lines = expose(np.arange(26) * seen_speed / RATE / PITCH, 256, seed=i)
            batches[name] = LineBatch(10_000_000, lines)
        wheels = {"front": wheel}
        configuration = OdometryConfiguration(sensors=sensors, sideslip=wheels, **changes)
        estimate = LineScanOdometry(configuration).update(batches)
        found = WheelSideslip(wheel, sensors[wheel.sensor]).measure_with(estimate)
        assert found.measured
        return estimate, found.angle + math.atan2(sideways, forward), found.deviation

    agreeing, _, _ = drive(0.0)
    assert agreeing.inflation == 1.0
    estimate, error, deviation = drive(0.1)
    _, _, unaware = drive(0.1, contradiction_limit=0.0)
    assert estimate.inflation > 64.0
    # All velocities that determine the angle grow by the same factor.
    assert deviation == pytest.approx(math.sqrt(estimate.inflation) * unaware)
    assert abs(error) < 5.0 * deviation  # not 1: a large weight hides part of a fault


@pytest.mark.parametrize(
    ("reading", "forward", "words"),
    [
        (seen(), 0.0, "rolls at 0 m/s; below 0.5 m/s"),
        (seen(), -0.49, "below 0.5 m/s"),
        (dataclasses.replace(seen(), slope=0.3), 0.0, "rolls at 0 m/s"),  # a view at rest
        (dataclasses.replace(seen(), slope=0.3), 4.0, "the texture may be oblique"),
        (seen(), math.nan, "must be finite"),
        (SensorReading.unmeasured("no contrast"), 4.0, "no contrast"),
    ],
)
def test_without_an_angle_there_is_a_reason(
    reading: SensorReading, forward: float, words: str
) -> None:
    geometry = WheelSideslip(WHEEL, SENSORS["side"])
    estimate = geometry.measure(reading, forward, 0.0, np.zeros((3, 3)))
    assert (estimate.measured, estimate.angle, estimate.deviation) == (False, 0.0, math.inf)
    assert words in estimate.reason


# Not 0: these lines show no motion across the axis, and a constant view is no measurement then.
@pytest.mark.parametrize("angle_deg", [-15.0, 1.0, 4.0])
def test_one_camera_and_the_wheel_speed_are_enough(angle_deg: float, expose: Expose) -> None:
    forward = 5.0
    sideways = -forward * math.tan(math.radians(angle_deg))
    configuration = SideslipConfiguration(
        sensors={"side": sensor(0.6, 0.5, -90.0)},  # looks to the right
        sideslip={"front": SideslipWheel(sensor="side", x=0.6, y=0.5)},
    )
    meter = SideslipMeter(configuration, "front")
    lines = expose(-sideways / RATE / PITCH * np.arange(26), 256)
    estimate = meter.update(LineBatch(10_000_000, lines), forward, forward_deviation=0.01)
    assert estimate.measured
    assert math.degrees(estimate.angle) == pytest.approx(angle_deg, abs=0.05)
    wheel_speed = 0.01 / forward * abs(math.sin(2.0 * estimate.angle)) / 2.0
    assert wheel_speed <= estimate.deviation < wheel_speed + 1e-3


def test_an_estimate_names_every_wheel(expose: Expose) -> None:
    wheels = {"front": WHEEL, "slow": dataclasses.replace(WHEEL, minimum_speed=50.0)}
    # Lines that do not change across the motion are endless stripes without a unique displacement.
    configuration = OdometryConfiguration(sensors=SENSORS, sideslip=wheels, cover_detection=False)
    batches = {
        name: LineBatch(10_000_000, expose(np.arange(26) * speed / RATE / PITCH, 256, seed=i))
        for i, (name, speed) in enumerate(zip(SENSORS, sensor_matrix(SENSORS) @ TWIST, strict=True))
    }
    port = OdometryPort("", configuration)
    [(_, found)] = itertools.chain.from_iterable(itertools.starmap(port.take, batches.items()))
    forward, sideways = wheel_velocity()
    expected = [-math.atan2(sideways, forward), math.nan]
    assert list(found) == ["front", "slow"]
    assert angles(found) == pytest.approx(expected, abs=1e-3, nan_ok=True)
    blind = LineScanOdometry(configuration).update({"side": batches["side"]})
    assert not WheelSideslip(WHEEL, SENSORS["side"]).measure_with(blind).measured


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"sensor": "rear"}, "sideslip.front.sensor", "'rear' is not one of left"),
        ({"sensor": "left"}, "sideslip.front.sensor", r"is 80\.0 deg from"),
        ({"steering_deg": 40.0}, "sideslip.front.sensor", r"is 35\.0 deg from"),
        ({"steering_deg": 35.3}, "sideslip.front.sensor", r"is 30\.3 deg from"),
    ],
)
def test_cameras_that_do_not_see_the_slide_are_refused(
    changes: dict[str, Any], key: str, words: str
) -> None:
    wheel = dataclasses.replace(WHEEL, **changes)
    with pytest.raises(ConfigurationError, match=words) as caught:
        OdometryConfiguration(sensors=SENSORS, sideslip={"front": wheel})
    assert caught.value.key == key


@pytest.mark.parametrize("skew_deg", [-30.0, 30.0])
@pytest.mark.parametrize("steering_deg", [-20.0, 0.0, 10.0, 90.0])
def test_a_camera_may_be_misaligned_with_the_axis_by_30_deg(
    skew_deg: float, steering_deg: float
) -> None:
    """At the limit of 30 deg, rounding of sine and arcsine must not cause a rejection."""
    wheel = dataclasses.replace(WHEEL, steering_deg=steering_deg)
    WheelSideslip(wheel, sensor(0.6, 0.5, 90.0 + steering_deg + skew_deg))


def test_a_meter_needs_a_wheel_it_knows() -> None:
    with pytest.raises(ConfigurationError, match="must name a wheel"):
        SideslipConfiguration(sensors={"side": SENSORS["side"]})
    configuration = OdometryConfiguration(sensors=SENSORS, sideslip={"front": WHEEL})
    with pytest.raises(ConfigurationError, match="'rear' is not one of front"):
        SideslipMeter(configuration, "rear")
