"""The supplied sensor placements of chapter 4 on rendered lines along exact arcs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from linescan_odometry.odometry import LineScanOdometry, TwistEstimate
from omni_core.configuration import ConfigurationError
from omni_core.signals import LineBatch
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_sim.camera.camera import LineCameraArray
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.texture.texture import GroundTexture, generate_texture
from omni_tools.two_sensors import (
    PlanarDisplacement,
    SensorDisplacement,
    two_sensor_displacement,
)

CONFIG = Path(__file__).resolve().parents[4] / "config"
BATCH, BATCHES = 25, 4
AXLE = "odometry.kinematics.constraint=unsteered_axle"

Twist = tuple[float, float, float]


@pytest.fixture(scope="module")
def ground() -> GroundTexture:
    return generate_texture(TextureConfiguration(kind="cork", size=0.1, texels=1024))


def load(sensors: str, *overrides: str) -> ExperimentConfiguration:
    return ExperimentLibrary(CONFIG).load(
        "straight_line", "assisted", [f"sensors={sensors}", *overrides]
    )


def drive(
    configuration: ExperimentConfiguration, ground: GroundTexture, twist: Twist
) -> list[TwistEstimate]:
    """Move along an arc and return the estimate of the odometry for every batch."""
    eyes = LineCameraArray(
        configuration.sensors, ground, configuration.camera, np.random.SeedSequence(3)
    )
    odometry = LineScanOdometry(configuration.odometry)
    estimates = []
    for first in range(0, BATCH * BATCHES, BATCH):
        poses = arc(twist, np.arange(first, first + BATCH) / 2500.0)
        lines = eyes.render(dict.fromkeys(configuration.sensors, poses))
        stamp_ns = round((first + BATCH - 1) * 1e9 / 2500.0)
        estimates.append(
            odometry.update({name: LineBatch(stamp_ns, seen) for name, seen in lines.items()})
        )
    return estimates


def arc(twist: Twist, time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses at constant body twist, shape (m, 3)."""
    poses = []
    for t in time:
        # The arcsine of (75) is undone by along_arc.
        path = PlanarDisplacement(twist[0] * t, twist[1] * t, math.asin(twist[2] * t))
        moved = path.along_arc()
        poses.append((moved.x, moved.y, moved.angle))
    return np.array(poses)


def rmse(estimates: list[TwistEstimate], twist: Twist) -> NDArray[np.float64]:
    assert all(estimate.measured for estimate in estimates)
    error = np.array([estimate.twist for estimate in estimates]) - np.array(twist)
    result: NDArray[np.float64] = np.sqrt(np.mean(error**2, axis=0))
    return result


@pytest.mark.parametrize(
    ("sensors", "axle_x", "twist"),
    [
        ("differential", 0.0, (2.0, 0.0, 0.0)),
        ("differential", 0.0, (2.0, 0.0, 2.0)),
        ("differential", 0.0, (0.0, 0.0, -2.0)),
        ("ackermann", -0.6, (8.0, 0.6 * 0.8, 0.8)),  # a curve of 10 m
        ("ackermann", -0.6, (3.0, 0.6 * -1.0, -1.0)),  # a curve of 3 m
    ],
)
def test_two_sensors_measure_vehicles_that_grip(
    sensors: str, axle_x: float, twist: Twist, ground: GroundTexture
) -> None:
    configuration = load(sensors, AXLE, f"odometry.kinematics.axle_x={axle_x}")
    estimates = drive(configuration, ground, twist)
    assert all(estimate.assumed for estimate in estimates)
    error = rmse(estimates, twist)
    speed = max(math.hypot(*twist[:2]), 0.4 * abs(twist[2]))
    assert math.hypot(*error[:2]) < 0.01 * speed
    assert 0.4 * error[2] < 0.01 * speed


def test_a_skid_is_hidden_from_two_sensors_and_seen_by_three(ground: GroundTexture) -> None:
    skid = 0.5
    twist = (4.0, skid + 0.6 * 0.8, 0.8)
    axle = (AXLE, "odometry.kinematics.axle_x=-0.6")
    blind = drive(load("ackermann", *axle), ground, twist)
    error = np.array([estimate.twist for estimate in blind]) - np.array(twist)
    assert error == pytest.approx(np.tile([0.0, -skid, 0.0], (BATCHES, 1)), abs=0.02)
    assert not any(estimate.skid for estimate in blind)
    seeing = drive(load("three_generic", *axle), ground, twist)
    assert math.hypot(*rmse(seeing, twist)[:2]) < 0.01 * 4.0
    assert all("the platform skids" in estimate.reason for estimate in seeing)


def test_two_sensors_need_the_constraint() -> None:
    with pytest.raises(ConfigurationError, match=r"two suffice .*kinematics\.constraint"):
        load("differential")


@pytest.mark.parametrize("twist", [(3.0, -2.0, 1.0), (0.5, 4.0, -1.5)])
def test_crossed_cameras_are_the_two_sensors_of_figure_55(
    twist: Twist, ground: GroundTexture
) -> None:
    """The twist by weighted least squares, times dt, agrees with Eqs. (73)-(75) to first order."""
    dt = BATCH / 2500.0
    for estimate in drive(load("two_crossed"), ground, twist):
        speed = {name: reading.velocity for name, reading in estimate.readings.items()}
        moved = two_sensor_displacement(
            SensorDisplacement(speed["left_forward"] * dt, speed["left_sideways"] * dt),
            SensorDisplacement(speed["right_forward"] * dt, speed["right_sideways"] * dt),
            0.5,
            0.5,
        )
        assert estimate.twist[0] * dt == pytest.approx(moved.x, rel=1e-9)
        assert estimate.twist[2] * dt == pytest.approx(math.sin(moved.angle), rel=1e-9)
        # Least squares weigh the two y by their variances, (74) by the distances.
        assert estimate.twist[1] * dt == pytest.approx(moved.y, abs=4e-3 * dt)
        assert estimate.twist == pytest.approx(twist, abs=0.01 * math.hypot(*twist[:2]))
