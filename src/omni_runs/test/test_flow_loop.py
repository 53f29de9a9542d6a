"""The loop with flow sensors: alone, together with cameras, and after a failure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_runs.experiment import ExperimentLibrary
from omni_runs.history import RunHistory
from omni_runs.loop import run_closed_loop

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[3] / "config")


def turn_of(variant: str, *overrides: str) -> tuple[float, RunHistory]:
    """Return the rotation of the vehicle [deg], and the run."""
    run = run_closed_loop(LIBRARY.load("flow_sensors", variant, overrides))
    return abs(float(np.degrees(run.pose[-1, 2] - run.pose[0, 2]))), run


def test_three_flow_sensors_keep_the_heading() -> None:
    unassisted, _ = turn_of("unassisted")
    assisted, run = turn_of("assisted")
    assert unassisted > 8.0
    assert assisted < 2.0
    assert "assisting" in run.assist_state


@pytest.mark.parametrize("failure", ["zero", "frozen", "invalid", "double"])
@pytest.mark.parametrize("name", ["front", "left"])
def test_no_failure_of_one_of_them_turns_the_vehicle(name: str, failure: str) -> None:
    turned, run = turn_of(
        "assisted", f"flow.failing={name}", f"flow.failure={failure}", "flow.failure_start=0.65"
    )
    assert turned < 3.0
    assert np.linalg.norm(run.twist[-1]) < 0.1


def test_without_cameras_every_period_needs_a_measurement() -> None:
    rates = [f"flow_sensors.{name}.rate=50" for name in ("front", "left", "right")]
    with pytest.raises(
        ConfigurationError, match="without line cameras, one flow sensor must measure in every"
    ):
        LIBRARY.load("flow_sensors", "assisted", rates)
