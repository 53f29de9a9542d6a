"""The study of cameras on vehicles with steered wheels reproduces what Figure 70 promises."""

from __future__ import annotations

from pathlib import Path

import pytest

from omni_runs.experiment import ExperimentLibrary
from omni_studies.studies import steered_cameras
from omni_studies.study import StudyRun, run_study

CONFIG = Path(__file__).parents[4] / "config"


def test_cameras_measure_sideslip_and_twist_until_the_axle_skids(tmp_path: Path) -> None:
    study = StudyRun(ExperimentLibrary(CONFIG), tmp_path)
    result, _ = run_study("steered_cameras", steered_cameras.Options(), study)
    value = {name: metric.value for name, metric in result.metrics.items()}
    assert value["measured_share.sideslip"] == pytest.approx(1.0, abs=0.02)
    assert value["largest_sideslip.lane_change"] > 1.0
    assert value["sideslip_error.lane_change"] < 0.2
    for case in ("lane_change", "skid"):
        for arrangement in ("ackermann", "carriers", "differential"):
            # The constraint hides the sideways slip of the axle entirely (closed form).
            slip = value[f"axle_slip.{arrangement}_{case}"]
            assert value[f"sideways_error.{arrangement}_{case}"] == pytest.approx(slip, rel=0.02)
            assert value[f"yaw_rate_error.{arrangement}_{case}"] < 0.01
            assert value[f"reported_skids.{arrangement}_{case}"] == 0.0
        assert value[f"sideways_error.three_on_carriers_{case}"] < 0.01
    assert value["axle_slip.ackermann_skid"] > 0.2
    assert value["reported_skids.three_on_carriers_skid"] > 0.2
