"""The line-scan odometry on rendered lines compared with the true motion."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from omni_runs.experiment import ExperimentLibrary
from omni_runs.loop import run_closed_loop

CONFIG = Path(__file__).resolve().parents[3] / "config"


@pytest.mark.parametrize("motion", ["straight", "sideways", "turning"])
@pytest.mark.parametrize("speed", [1.0, 5.0, 10.0])
def test_twist_is_right_within_one_per_cent_of_the_speed(speed: float, motion: str) -> None:
    direction = 90.0 if motion == "sideways" else 0.0
    yaw_rate = math.degrees(1.0) if motion == "turning" else 0.0
    configuration = ExperimentLibrary(CONFIG).load(
        "straight_line",
        "assisted",
        [
            f"maneuver.speed={speed}",
            f"maneuver.direction_deg={direction}",
            f"maneuver.yaw_rate_deg={yaw_rate}",
            "maneuver.brake_time=100.0",
            "simulation.duration_limit=0.6",
        ],
    )
    history = run_closed_loop(configuration)
    # The very first batch has one line and so no displacement.
    assert np.all(history.measured[1:])
    error = (history.estimate - history.twist)[1:]
    rmse = math.sqrt(float(np.mean(np.sum(error[:, :2] ** 2, axis=1))))
    assert rmse < 0.01 * speed
    # Error of 1 % of the speed, of a sensor 0.5 m from the center.
    assert math.sqrt(float(np.mean(error[:, 2] ** 2))) < 0.01 * speed / 0.5
    traveled = float(np.linalg.norm(history.pose[-1, :2] - history.pose[0, :2]))
    assert traveled > 0.5 * speed * 0.6
