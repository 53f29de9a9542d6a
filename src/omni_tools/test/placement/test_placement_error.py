"""The mean twist error: closed forms, symmetries, and agreement with the odometry's solver."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from linescan_odometry.twist.least_squares import TwistSolver
from omni_core.sensors import sensor_matrix
from omni_tools.line_trials.rig import View
from omni_tools.placement.error import (
    ConditionNumber,
    MeanError,
    MotionMix,
    after_failure,
    closeness,
    gyration,
    poses_of,
)
from omni_tools.placement.mounting_area import named, ring
from omni_tools.placement.sensor_error import SensorError

VIEW = View()
NOISE = SensorError(4e-6, 0.0)  # 2 mm/s along the axis, and hardly more across it
TEXTURE = SensorError(2.5e-7, 2.6e-4)
SLOW = MotionMix.of(1e-6, 0.0, (1, 1, 1, 1))  # no overlap is lost
MIX = MotionMix.of(10.0, 1.0, (1, 2, 3, 4))


def scattered(count: int, seed: int = 3) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    generator = np.random.default_rng(seed)
    return generator.uniform((-0.8, -0.6, 0.0), (0.8, 0.6, math.pi), (count, 3))


@pytest.mark.parametrize("count", [3, 4, 7])
@pytest.mark.parametrize("radius", [0.3, 2.0])
def test_tangential_sensors_on_a_circle_have_the_closed_form(count: int, radius: float) -> None:
    criterion = MeanError(VIEW, NOISE, SLOW, 0.8)
    poses = ring(count, radius, 0.5 * math.pi)
    covariance = 4e-6 * np.diag([2.0 / count, 2.0 / count, 1.0 / (count * radius**2)])
    assert criterion.covariance(poses)[0] == pytest.approx(covariance, rel=1e-6, abs=1e-12)
    expected = 2e-3 * math.sqrt(4.0 / count + 0.8**2 / (count * radius**2))
    assert criterion.mean_error(poses) == pytest.approx(expected)


def test_the_error_is_the_mean_over_points_of_the_platform() -> None:
    length, width = 1.6, 1.2
    criterion = MeanError(VIEW, TEXTURE, MIX, gyration(length, width))
    poses = scattered(4)
    x, y = np.random.default_rng(1).uniform((-0.8, -0.6), (0.8, 0.6), (200_000, 2)).T
    over_points = math.sqrt(float(np.mean(criterion.point_error(poses, x, y) ** 2)))
    assert criterion.mean_error(poses) == pytest.approx(over_points, rel=2e-3)


def test_the_solver_scatters_as_predicted() -> None:
    """Sensor velocities with the stated variance give a twist with the predicted error."""
    criterion = MeanError(VIEW, TEXTURE, MIX, 0.58)
    sensors = named(scattered(5), VIEW)
    poses = poses_of(sensors)
    solver, matrix = TwistSolver(sensors, 0.02), sensor_matrix(sensors)
    generator = np.random.default_rng(2)
    squared, runs = 0.0, 1500
    for twist, share in zip(MIX.twist, MIX.share, strict=True):
        # The velocity of each sensor, from the rigid body and not from the criterion.
        v_x, v_y = twist[0] - twist[2] * poses[:, 1], twist[1] + twist[2] * poses[:, 0]
        speed, angle = np.hypot(v_x, v_y), np.arctan2(v_y, v_x) - poses[:, 2]
        variance = TEXTURE.variance(VIEW, speed * np.cos(angle), speed * np.sin(angle))
        for noise in generator.standard_normal((runs, len(poses))):
            measured = matrix @ twist + noise * np.sqrt(variance)
            error = solver.solve(measured, variance, (True,) * len(poses))[0] - twist
            squared += share / runs * float(np.sum((error * (1.0, 1.0, 0.58)) ** 2))
    assert criterion.mean_error(poses) == pytest.approx(math.sqrt(squared), rel=0.04)


@pytest.mark.parametrize("angle", [0.3, 1.5, math.pi])
@pytest.mark.parametrize("mirrored", [False, True])
def test_turning_and_mirroring_everything_changes_nothing(angle: float, mirrored: bool) -> None:
    poses = scattered(4)
    twist = MIX.twist.copy()
    sign = -1.0 if mirrored else 1.0
    turned = poses * (1.0, sign, sign)
    twist *= (1.0, sign, sign)
    rotation = np.array([(math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))])
    turned[:, :2] = turned[:, :2] @ rotation
    turned[:, 2] += angle
    twist[:, :2] = twist[:, :2] @ rotation
    before = MeanError(VIEW, TEXTURE, MIX, 0.58)
    after = MeanError(VIEW, TEXTURE, MotionMix(MIX.names, twist, MIX.share), 0.58)
    assert after.mean_error(turned) == pytest.approx(before.mean_error(poses), rel=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_another_sensor_never_makes_it_worse(seed: int) -> None:
    criterion = MeanError(VIEW, TEXTURE, MIX, 0.58)
    poses = scattered(6, seed)
    errors = [criterion.mean_error(poses[:count]) for count in (3, 4, 5, 6)]
    assert all(more <= fewer * (1.0 + 1e-9) for fewer, more in itertools.pairwise(errors))
    without = after_failure(criterion, poses)
    assert np.all(without >= errors[-1] * (1.0 - 1e-9))
    assert without[-1] == pytest.approx(errors[-2])


@pytest.mark.parametrize("turn", [0.0, math.pi])
def test_singular_placements_have_no_finite_error(turn: float) -> None:
    criterion = MeanError(VIEW, TEXTURE, MIX, 0.58)
    radial = ring(4, 0.5, turn)
    parallel = radial * (1.0, 1.0, 0.0)
    for poses in (radial, parallel, ring(2, 0.5, 0.5 * math.pi)):
        assert criterion.mean_error(poses) == math.inf
        assert np.all(np.isinf(criterion.covariance(poses)))
        assert ConditionNumber().value(ConditionNumber().information(poses).sum(0)) == math.inf
    spread, lever = closeness(named(radial, VIEW, rounded=False))
    assert (spread, lever) == pytest.approx((45.0, 0.0), abs=1e-6)
    assert closeness(named(parallel, VIEW, rounded=False))[0] == pytest.approx(0.0, abs=1e-6)


def test_the_condition_number_is_that_of_the_sensor_matrix() -> None:
    poses = scattered(5)
    condition = ConditionNumber()
    expected = np.linalg.cond(sensor_matrix(named(poses, VIEW, rounded=False)))
    assert float(condition.value(condition.information(poses).sum(0))) == pytest.approx(expected)


def test_error_grows_with_the_lost_overlap() -> None:
    """A strip of ground counts once when it enters the view and once when it leaves it."""
    pairs = 25  # line pairs in a batch of 10 ms
    for lines in (2, 10, 25, 100):  # until the camera has crossed its own width
        enters = np.arange(-lines, pairs)
        harm = (enters >= 0).astype(int) + (enters + lines < pairs)
        crossed = float(np.sum(harm**2)) / (2 * pairs) / lines
        across = np.array([VIEW.line_rate * VIEW.width / lines])
        variance = float(TEXTURE.variance(VIEW, np.zeros(1), across)[0])
        common = (1.0 - 1.0 / lines) ** 2
        assert variance == pytest.approx((2.5e-7 + 2.6e-4 * crossed) / common)
    whole = np.array([VIEW.line_rate * VIEW.width])
    assert TEXTURE.variance(VIEW, np.zeros(1), whole)[0] == math.inf


def test_names_say_where_sensors_sit_and_axes_look_forward() -> None:
    poses = np.array([(0.7, 0.01, math.pi), (0.7, -0.01, -2.0), (-0.7, 0.5, 1.5 * math.pi)])
    sensors = named(poses, VIEW)
    assert list(sensors) == ["front", "front_2", "rear_left"]
    assert [s.heading_deg for s in sensors.values()] == [65.0, 0.0, 90.0]
