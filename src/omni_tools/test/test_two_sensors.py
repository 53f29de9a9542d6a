"""Two two-dimensional sensors, Eqs. (73)-(78): conventions, redundancy, straight line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from linescan_odometry.twist.least_squares import TwistSolver
from omni_core.sensors import LineSensor
from omni_tools.two_sensors import (
    DisplacementError,
    PlanarDisplacement,
    SensorDisplacement,
    first_sensor_displacement,
    two_sensor_displacement,
)

D_1, D_2 = 0.3, 0.5
DT = 0.01


def paths(twist: tuple[float, float, float]) -> tuple[SensorDisplacement, SensorDisplacement]:
    """Displacements of sensors at (0, d_1) and (0, -d_2) along their own axes: v_i dt, Eq. (23)."""
    v_x, v_y, yaw_rate = twist
    return (
        SensorDisplacement((v_x - yaw_rate * D_1) * DT, v_y * DT),
        SensorDisplacement((v_x + yaw_rate * D_2) * DT, v_y * DT),
    )


def pose_after(twist: tuple[float, float, float], duration: float) -> tuple[float, float, float]:
    """Exact motion at constant body twist, by the exponential map."""
    v_x, v_y, yaw_rate = twist
    generator = np.array([[0.0, -yaw_rate, v_x], [yaw_rate, 0.0, v_y], [0.0, 0.0, 0.0]])
    pose = expm(generator * duration)
    return float(pose[0, 2]), float(pose[1, 2]), math.atan2(pose[1, 0], pose[0, 0])


def components(displacement: PlanarDisplacement) -> tuple[float, float, float]:
    return displacement.x, displacement.y, displacement.angle


def test_counter_clockwise_is_positive() -> None:
    turning = two_sensor_displacement(*paths((0.0, 0.0, 0.2)), D_1, D_2)
    assert turning.angle == pytest.approx(0.2 * DT, rel=1e-5)
    assert (turning.x, turning.y) == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("twist", [(10.0, 2.0, 20.0), (3.0, -4.0, -60.0), (0.0, 0.0, 80.0)])
def test_chords_along_the_first_axes_give_the_exact_motion(
    twist: tuple[float, float, float],
) -> None:
    x, y, angle = pose_after(twist, DT)
    sensors = []
    for y_i in (D_1, -D_2):
        end = (x - math.sin(angle) * y_i, y + math.cos(angle) * y_i - y_i)
        sensors.append(SensorDisplacement(*end))
    moved = two_sensor_displacement(sensors[0], sensors[1], D_1, D_2)
    assert components(moved) == pytest.approx((x, y, angle), abs=1e-12)
    # The y displacements of the sensors differ, so a single one is not sufficient.
    assert sensors[1].y - sensors[0].y == pytest.approx((D_1 + D_2) * (1.0 - math.cos(angle)))


@pytest.mark.parametrize("twist", [(10.0, 2.0, 2.0), (3.0, -4.0, -20.0)])
def test_the_straight_line_errs_as_stated(twist: tuple[float, float, float]) -> None:
    straight = two_sensor_displacement(*paths(twist), D_1, D_2)
    x, y, angle = pose_after(twist, DT)
    length = math.hypot(straight.x, straight.y)
    # The path is rotated by half the angle, for every direction ...
    turned = math.atan2(y, x) - math.atan2(straight.y, straight.x)
    assert turned == pytest.approx(angle / 2.0, rel=1e-9)
    # ... it is longer than the chord ...
    assert length / math.hypot(x, y) - 1.0 == pytest.approx(angle**2 / 24.0, rel=0.01)
    # ... and the arcsine adds a third order.
    assert straight.angle - angle == pytest.approx(angle**3 / 6.0, rel=0.03)
    assert math.hypot(straight.x - x, straight.y - y) == pytest.approx(
        length * abs(angle) / 2.0, rel=0.01
    )


@pytest.mark.parametrize("twist", [(10.0, 2.0, 2.0), (3.0, -4.0, -60.0), (5.0, 1.0, 1e-4)])
def test_the_arc_is_the_motion(twist: tuple[float, float, float]) -> None:
    moved = two_sensor_displacement(*paths(twist), D_1, D_2).along_arc()
    assert components(moved) == pytest.approx(pose_after(twist, DT), abs=1e-13)
    # Any other point of the platform, from its own velocity.
    v_x, v_y, yaw_rate = twist
    point = (v_x - yaw_rate * 0.7, v_y + yaw_rate * -0.4, yaw_rate)
    assert components(moved.at(-0.4, 0.7)) == pytest.approx(pose_after(point, DT), abs=1e-13)


def test_in_a_steady_turn_the_error_is_no_noise() -> None:
    """The end of half a circle, divided into 50 steps, is exact with arcs but not with chords."""
    twist = (5.0, 0.0, 2.0 * math.pi)
    ends = []
    for arc in (False, True):
        step = two_sensor_displacement(*paths(twist), D_1, D_2)
        step = step.along_arc() if arc else step
        whole = PlanarDisplacement(0.0, 0.0, 0.0)
        for _ in range(50):  # half a circle, of diameter 5 / pi
            sine, cosine = math.sin(whole.angle), math.cos(whole.angle)
            whole = PlanarDisplacement(
                whole.x + cosine * step.x - sine * step.y,
                whole.y + sine * step.x + cosine * step.y,
                whole.angle + step.angle,
            )
        ends.append(whole)
    straight, exact = ends
    assert components(exact) == pytest.approx((0.0, 5.0 / math.pi, math.pi), abs=1e-9)
    # All 50 errors add up: the direction from start to end is wrong by phi / 2.
    assert straight.x == pytest.approx(5.0 / math.pi * math.pi / 100.0, rel=0.05)


def test_the_special_case_is_the_general_one() -> None:
    first, second = SensorDisplacement(0.031, -0.004), SensorDisplacement(0.047, 0.9)
    general = two_sensor_displacement(first, second, 0.0, D_2)
    assert components(first_sensor_displacement(first, second.x, D_2)) == components(general)


@pytest.mark.parametrize("variances", [(1.0, 1.0, 1.0, 1.0), (1.0, 5.0, 0.2, 3.0)])
@pytest.mark.parametrize(("d_1", "d_2"), [(0.4, 0.4), (0.3, 0.5), (0.0, 0.8)])
def test_least_squares_agree_where_nothing_is_redundant(
    d_1: float, d_2: float, variances: tuple[float, ...]
) -> None:
    sensors = {
        name: LineSensor(x=0.0, y=y, heading_deg=heading)
        for name, y, heading in (
            ("x_1", d_1, 0.0), ("y_1", d_1, 90.0), ("x_2", -d_2, 0.0), ("y_2", -d_2, 90.0)
        )
    }  # fmt: skip
    x_1, y_1, x_2, y_2 = velocity = np.array([2.0, -1.0, 2.4, -0.7])
    twist, _ = TwistSolver(sensors, 0.02).solve(velocity, np.array(variances), (True,) * 4)
    dt = 1e-3
    moved = two_sensor_displacement(
        SensorDisplacement(x_1 * dt, y_1 * dt), SensorDisplacement(x_2 * dt, y_2 * dt), d_1, d_2
    )
    assert twist[0] * dt == pytest.approx(moved.x)
    assert twist[2] * dt == pytest.approx(moved.angle, rel=1e-6)
    weights = 1.0 / np.array([variances[1], variances[3]])
    assert twist[1] == pytest.approx(float(weights @ [y_1, y_2] / weights.sum()))
    if d_1 == d_2 and variances[1] == variances[3]:
        assert twist[1] * dt == pytest.approx(moved.y)


@pytest.mark.parametrize(
    ("second", "d_1", "d_2", "words"),
    [
        ((0.0, 0.0), 0.0, 0.0, "same position"),
        ((0.0, 0.0), -0.1, 0.5, "must not be negative"),
        ((0.9, 0.0), 0.3, 0.5, "differ by 0.9 m, but the sensors are only 0.8 m apart"),
        ((math.nan, 0.0), 0.3, 0.5, "x_2 is nan"),
        ((0.0, math.inf), 0.3, 0.5, "y_2 is inf"),
    ],
)
def test_what_no_rigid_motion_has_is_refused(
    second: tuple[float, float], d_1: float, d_2: float, words: str
) -> None:
    with pytest.raises(DisplacementError, match=words):
        two_sensor_displacement(SensorDisplacement(0.0, 0.0), SensorDisplacement(*second), d_1, d_2)
    if d_1 == 0.0:
        with pytest.raises(DisplacementError, match=words):
            first_sensor_displacement(SensorDisplacement(0.0, 0.0), second[0], d_2)
