"""Stops on cameras that see what stands still keep their heading, or brake with every wheel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.loop import run_closed_loop

CONFIG = Path(__file__).parents[3] / "config"


@pytest.mark.parametrize("fault", ["camera.dirt_spots=30", "camera.stuck_pixels=1"])
def test_what_stands_still_in_the_view_does_not_turn_the_stop(fault: str) -> None:
    overrides = ("feedback=optical", "ground=asphalt", fault)
    run = run_closed_loop(ExperimentLibrary(CONFIG).load("straight_line", "assisted", overrides))
    turned = float(np.ptp(np.unwrap(run.pose[:, 2])))
    assert np.degrees(turned) < 5.0 or set(run.assist_state) <= {"inactive", "low_confidence"}
