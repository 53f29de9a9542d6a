"""Body twist from sensor velocities: exact, with a consistent covariance, from enough sensors."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from linescan_odometry.twist.least_squares import TwistSolver, check_placement
from omni_core.configuration import ConfigurationError
from omni_core.sensors import LineSensor, velocity_row

TWIST = np.array([9.0, -2.0, 0.7])


def ring(
    count: int, turn_deg: float = 90.0, radius: float = 0.6, x: float = 0.0
) -> dict[str, LineSensor]:
    """Sensors on a circle, with axes rotated from the radial direction; 90 deg is tangential."""
    angles = [2.0 * math.pi * i / count for i in range(count)]
    return {
        f"s{i}": LineSensor(
            x=x + radius * math.cos(angle),
            y=radius * math.sin(angle),
            heading_deg=math.degrees(angle) - 180.0 + turn_deg,
        )
        for i, angle in enumerate(angles)
    }


def velocities(sensors: dict[str, LineSensor]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Velocities along the sensor axes in rigid-body motion."""
    result = []
    for sensor in sensors.values():
        v_x = TWIST[0] - TWIST[2] * sensor.y
        v_y = TWIST[1] + TWIST[2] * sensor.x
        angle = math.radians(sensor.heading_deg)
        result.append(v_x * math.cos(angle) + v_y * math.sin(angle))
    return np.array(result)


@pytest.mark.parametrize("count", [3, 4, 7])
@pytest.mark.parametrize("turn_deg", [90.0, 60.0, -90.0])
def test_exact_velocities_give_the_exact_twist(count: int, turn_deg: float) -> None:
    sensors = ring(count, turn_deg)
    solver = TwistSolver(sensors, 0.02)
    variance = np.geomspace(1e-6, 1e-3, count)  # for any weights
    twist, _ = solver.solve(velocities(sensors), variance, (True,) * count)
    assert twist == pytest.approx(TWIST, abs=1e-9)


def test_covariance_is_the_scatter() -> None:
    sensors = ring(4, 70.0, x=0.4)
    solver = TwistSolver(sensors, 0.02)
    variance = np.array([1e-4, 4e-4, 1e-4, 9e-4])
    generator = np.random.default_rng(11)
    truth = velocities(sensors)
    errors = np.empty((4000, 3))
    for row in errors:
        noisy = truth + np.sqrt(variance) * generator.standard_normal(4)
        twist, covariance = solver.solve(noisy, variance, (True,) * 4)
        row[:] = twist - TWIST
    # In units of the stated covariance the scatter is the identity, to within 1/sqrt(4000).
    white = errors @ np.linalg.inv(np.linalg.cholesky(covariance)).T
    assert white.T @ white / 4000 == pytest.approx(np.eye(3), abs=0.1)
    assert abs(white.mean(axis=0)).max() < 4.0 / math.sqrt(4000)


def test_the_weights_are_the_variances() -> None:
    sensors = ring(4)
    solver = TwistSolver(sensors, 0.02)
    wrong = velocities(sensors)
    wrong[1] += 5.0
    twist, _ = solver.solve(wrong, np.array([1e-6, 1e6, 1e-6, 1e-6]), (True,) * 4)
    assert twist == pytest.approx(TWIST, abs=1e-6)


def test_a_sensor_that_has_not_measured_does_not_enter() -> None:
    sensors = ring(4)
    solver = TwistSolver(sensors, 0.02)
    velocity = velocities(sensors)
    velocity[2] = 1e9
    twist, _ = solver.solve(velocity, np.full(4, 1e-4), (True, True, False, True))
    assert twist == pytest.approx(TWIST, abs=1e-9)


@pytest.mark.parametrize("x", [0.0, 3.0, -50.0])
@pytest.mark.parametrize(
    ("sensors", "words"),
    [
        (ring(3, 0.0), "pass through one point"),
        (ring(5, 1.0), "pass through one point"),
        (ring(3, 90.0, radius=0.001), "pass through one point"),
        (
            {
                name: LineSensor(x=x, y=y, heading_deg=heading)
                for name, x, y, heading in (
                    ("s0", 0.0, 0.5, 30.0),
                    ("s1", 0.4, -0.5, 32.0),
                    ("s2", -0.4, 0.0, 210.0),
                )
            },
            "parallel",
        ),
    ],
)
def test_singular_placements_are_refused_wherever_base_link_is(
    x: float, sensors: dict[str, LineSensor], words: str
) -> None:
    moved = {
        name: LineSensor(x=sensor.x + x, y=sensor.y, heading_deg=sensor.heading_deg)
        for name, sensor in sensors.items()
    }
    with pytest.raises(ConfigurationError, match=words) as caught:
        check_placement(moved, 0.02)
    assert caught.value.key == "sensors"
    assert "s0, s1, s2" in caught.value.problem


def test_the_point_of_a_concurrent_placement_is_named() -> None:
    with pytest.raises(ConfigurationError, match=r"\(1\.50, -?0\.00\) m"):
        check_placement(ring(3, 0.0, x=1.5), 0.02)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_sensors_are_refused(count: int) -> None:
    with pytest.raises(ConfigurationError, match="three sensors are needed"):
        check_placement(ring(count) if count else {}, 0.02)


def test_two_parallel_axes_and_one_across_are_a_placement() -> None:
    sensors = {
        "left": LineSensor(x=0.0, y=0.5, heading_deg=0.0),
        "right": LineSensor(x=0.0, y=-0.5, heading_deg=0.0),
        "front": LineSensor(x=0.6, y=0.0, heading_deg=90.0),
    }
    twist, _ = TwistSolver(sensors, 0.02).solve(velocities(sensors), np.ones(3), (True,) * 3)
    assert twist == pytest.approx(TWIST, abs=1e-9)


def test_four_sensors_may_be_singular_without_one_of_them() -> None:
    sensors = ring(3, 0.0) | {"fourth": LineSensor(x=0.5, y=0.5, heading_deg=-45.0)}
    solver = TwistSolver(sensors, 0.02)
    assert solver.problem((True,) * 4) == ""
    assert "pass through one point" in solver.problem((True, True, True, False))
    assert "three sensors" in solver.problem((True, False, False, True))


@pytest.mark.parametrize("count", [3, 5])
def test_the_covariance_holds_what_calibration_leaves(count: int) -> None:
    nominal = {
        name: dataclasses.replace(
            sensor, scale_error=0.004, heading_error_deg=0.2, lever_error=0.004
        )
        for name, sensor in ring(count, 75.0, x=0.3).items()
    }
    generator = np.random.default_rng(5)
    solver = TwistSolver(nominal, 0.02)
    variance = np.full(count, 1e-6)
    squares, scores = [], []
    for _ in range(600):
        true = {}
        for name, sensor in nominal.items():
            scale, turn, lever = generator.standard_normal(3)
            heading = sensor.heading + math.radians(0.2) * turn
            # Along the axis of the configured camera, so that only the lever changes, by this much.
            off = 0.004 * lever + velocity_row(sensor.x, sensor.y, sensor.heading)[2]
            off -= velocity_row(sensor.x, sensor.y, heading)[2]
            true[name] = dataclasses.replace(
                sensor,
                x=sensor.x + off * math.sin(heading),
                y=sensor.y - off * math.cos(heading),
                heading_deg=math.degrees(heading),
                length=sensor.length * (1.0 + 0.004 * scale),
            )
        # A camera whose pixels are longer than configured measures less than its velocity.
        share = np.array([sensor.length / true[name].length for name, sensor in nominal.items()])
        said = velocities(true) * share + generator.normal(0.0, 1e-3, count)
        twist, covariance = solver.solve(said, variance, (True,) * count)
        error = twist - TWIST
        squares.append(float(error @ np.linalg.solve(covariance, error)) / 3.0)
        scores += list(solver.contradictions(said, variance, (True,) * count, twist, covariance))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.12)
    if count > 3:  # cameras that are calibrated so well do not contradict each other
        assert np.mean(np.square(scores)) == pytest.approx(1.0, abs=0.2)


def test_a_scale_error_enlarges_the_covariance_and_keeps_the_twist() -> None:
    sensors = ring(3)
    variance = np.full(3, 1e-4)
    plain = TwistSolver(sensors, 0.02).solve(velocities(sensors), variance, (True,) * 3)
    scaled = {n: dataclasses.replace(s, scale_error=0.01) for n, s in sensors.items()}
    twist, covariance = TwistSolver(scaled, 0.02).solve(velocities(sensors), variance, (True,) * 3)
    assert twist == pytest.approx(plain[0], abs=1e-9)
    assert (np.diag(covariance) > np.diag(plain[1])).all()
