"""Comparison of both kinds of feedback on a short stop, and the lag of shifted histories."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from omni_core.commands.command_options import parse_options
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.history import RunHistory
from omni_studies.studies.braking import OPTIONS, odometry_lag
from omni_studies.study import StudyRun, load_study

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[4] / "config")


@pytest.fixture(scope="module")
def history() -> RunHistory:
    """An assisted stop without odometry."""
    overrides = ("simulation.render_lines=false", "feedback=velocity_sensor")
    return run_fast_loop(LIBRARY.load("straight_line", "assisted", overrides))


@pytest.mark.parametrize("lag", [0.0, 0.003, 0.02])
def test_lag_of_a_late_and_noisy_estimate_is_found(history: RunHistory, lag: float) -> None:
    late = np.column_stack(
        [np.interp(history.time - lag, history.time, column) for column in history.twist.T]
    )
    noise = np.random.default_rng(4).normal(0.0, 0.02, late.shape)
    estimated = dataclasses.replace(history, estimate=late + noise)
    assert odometry_lag(estimated) == pytest.approx(lag, abs=5e-4, rel=0.1)


def test_every_experiment_that_runs_by_default_exists() -> None:
    for name in OPTIONS["optical"]().experiment:
        assert LIBRARY.variants(name)


def test_study_reports_the_difference_of_both_feedbacks(tmp_path: Path) -> None:
    study = load_study("optical")
    options = parse_options(study.Options, ["--experiment", "small_stop"])
    result = study.run(options, StudyRun(LIBRARY, tmp_path))
    metrics = {name: metric.value for name, metric in result.metrics.items()}
    for quantity in ("orientation_change", "stopping_distance"):
        sensor, optical, difference = (
            metrics[f"{quantity}{name}"]
            for name in (
                ".small_stop_assisted_sensor",
                ".small_stop_assisted_optical",
                "_difference.small_stop_assisted",
            )
        )
        assert difference == optical - sensor
        assert difference != 0.0
    # The twist of the odometry is the mean over a control period of 10 ms.
    assert metrics["odometry_lag.small_stop_assisted"] == pytest.approx(0.005, rel=0.3)
    # With the odometry, the stopping distance is the same within 10 %.
    assert abs(metrics["stopping_distance_difference.small_stop_assisted"]) < 0.3
    assert metrics["fail_safe_share.small_stop_assisted"] == 0.0
    assert all(path.stat().st_size > 0 for path in result.files)
