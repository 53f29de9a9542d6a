"""Stops hardly depend on the rate of the IMU and on the control period."""

from pathlib import Path

from omni_runs.experiment import ExperimentLibrary
from omni_studies.studies import rates
from omni_studies.study import StudyRun, run_study

LIBRARY = ExperimentLibrary(Path(__file__).parents[4] / "config")


def test_allocation_meets_its_limits_at_all_rates(tmp_path: Path) -> None:
    options = rates.Options(random=8, seed=97_000_000, workers=1)
    result, _ = run_study("rates", options, StudyRun(LIBRARY, tmp_path))
    limited = [name for name, metric in result.metrics.items() if metric.at_most is not None]
    assert len(limited) == 4 * 6
    assert [name for name in limited if result.metrics[name].status != "met"] == []
    for condition in ("imu_50_hz", "imu_400_hz", "imu_1000_hz"):
        assert result.metrics[f"rotation_change.allocation_{condition}"].value > 0.0
