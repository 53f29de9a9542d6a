"""The graph with the vehicle in MuJoCo: the same nodes and topics with another plant."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import FinishedRun, RunExperiment

INSTALLED = importlib.util.find_spec("mujoco") is not None


@pytest.fixture(scope="module")
def in_mujoco(run_experiment: RunExperiment) -> FinishedRun:
    return run_experiment("small_stop", "--simulator", "mujoco")


@pytest.mark.skipif(not INSTALLED, reason="MuJoCo is optional and not installed")
def test_the_line_cameras_keep_a_vehicle_on_real_rollers_straight(in_mujoco: FinishedRun) -> None:
    assert in_mujoco.value("orientation_change.assisted") < 2.0
    assert in_mujoco.value("twist_rmse.assisted") < 0.05
    assert in_mujoco.value("fail_safe_share.assisted") == 0.0
