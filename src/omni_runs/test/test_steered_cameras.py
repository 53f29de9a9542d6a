"""Cameras on steered carriers in the closed loop, and the checks of their configuration."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.sensors import LineSensor
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.loop import run_closed_loop

CONFIG = Path(__file__).parents[3] / "config"
CARRIED = LineSensor(
    x=-0.65, y=0.3, heading_deg=90.0, carrier="rear_left", carrier_x=-0.65, carrier_y=0.5
)
SHORT = (
    "maneuver.demands.time=[0, 0.2, 0.5, 0.51, 1.5]",
    "maneuver.demands.forward=[3, 3, 3, 0, 0]",
    "maneuver.demands.left=[0, 0, 0, 0, 0]",
    "maneuver.demands.turn=[0, 0, 0.6, 0, 0]",
    "maneuver.demands.pedal=[0, 0, 0, 1, 1]",
)


@pytest.fixture(scope="module")
def forklift() -> ExperimentConfiguration:
    """A short curve and a stop of the forklift with steered rear wheels."""
    return ExperimentLibrary(CONFIG).load("steered_forklift", "unassisted", SHORT)


def with_camera(
    configuration: ExperimentConfiguration, sensor: LineSensor
) -> ExperimentConfiguration:
    sensors = {**configuration.sensors, "front": sensor}
    odometry = dataclasses.replace(configuration.odometry, sensors=sensors)
    return dataclasses.replace(configuration, sensors=sensors, odometry=odometry)


def test_carrier_must_be_a_steered_wheel_at_its_place(forklift: ExperimentConfiguration) -> None:
    with_camera(forklift, CARRIED)
    for wrong, words in (
        (dataclasses.replace(CARRIED, carrier="front_left"), "not one of rear_left, rear_right"),
        (dataclasses.replace(CARRIED, carrier_x=0.6), "wheel rear_left is at"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            with_camera(forklift, wrong)


def test_twist_is_measured_with_a_camera_that_turns_with_a_wheel(
    forklift: ExperimentConfiguration,
) -> None:
    history = run_closed_loop(with_camera(forklift, CARRIED))
    driving = (history.time > 0.1) & (history.time < 0.5)
    # The estimate is the mean over the last control period.
    mean = 0.5 * (history.twist[1:] + history.twist[:-1])[driving[1:]]
    error = history.estimate[1:][driving[1:]] - mean
    assert np.isfinite(error).all()
    np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), 0.0, atol=0.02)
    assert np.max(history.twist[:, 2]) > 0.4
