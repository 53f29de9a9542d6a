"""Claims of section 3.6 about its experiments, with the identified vehicle."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from omni_core.commands.command_options import parse_options
from omni_runs.experiment import ExperimentLibrary
from omni_studies.studies.braking import (
    ExperimentRuns,
    largest_error,
    run_experiment,
    table_2_vehicle,
)
from omni_studies.study import StudyResult, StudyRun, load_study, run_study

CONFIG = Path(__file__).resolve().parents[4] / "config"
FIGURES = {
    "straight_line": (30, 31, 32),
    "three_wheel_diagonal": (33, 34, 35),
    "ice_patch": (36, 37, 38),
    "ice_patch_noisy": (39, 40, 41, 42),
    "turn_while_translate": (43, 44, 45, 46, 47, 48),
}


def study(name: str, folder: Path, *arguments: str) -> StudyResult:
    options = parse_options(load_study(name).Options, arguments)
    return run_study(name, options, StudyRun(ExperimentLibrary(CONFIG), folder))[0]


@pytest.fixture(scope="module")
def straight() -> ExperimentRuns:
    library = ExperimentLibrary(CONFIG)
    return run_experiment(library, "straight_line", table_2_vehicle(library))


@pytest.fixture(scope="module")
def ice() -> ExperimentRuns:
    return run_experiment(ExperimentLibrary(CONFIG), "ice_patch_noisy", [])


def test_assisted_straight_braking_keeps_errors_an_order_of_magnitude_smaller(
    straight: ExperimentRuns,
) -> None:
    """Section 3.6.1; sideways and angular velocity are also negligible."""
    assisted, unassisted = straight.histories["assisted"], straight.histories["unassisted"]
    assert largest_error(assisted) < 0.1 * largest_error(unassisted)
    assert np.max(np.abs(assisted.twist[:, 1])) < 0.03 * assisted.twist[0, 0]
    assert np.max(np.abs(assisted.twist[:, 2])) < 0.15
    assert straight.metrics["orientation_change.unassisted"].value > 20.0
    assert straight.metrics["orientation_change.assisted"].value < 5.0


def test_three_wheeled_robot_stops_within_a_second_and_keeps_its_direction() -> None:
    runs = run_experiment(ExperimentLibrary(CONFIG), "three_wheel_diagonal", [])
    metrics = runs.metrics
    for variant in ("unassisted", "assisted"):
        assert metrics[f"stopping_time.{variant}"].value < 1.0
    assert metrics["orientation_change.unassisted"].value > 10.0
    assert metrics["orientation_change.assisted"].value < 1.0
    history = runs.histories["assisted"]
    moving = history.twist[:, 0] > 0.5
    together = history.twist[moving, 1] / history.twist[moving, 0]
    assert np.all(np.abs(together - 1.0) < 0.2)  # Figure 35: the components stay together


def test_ice_turns_only_the_unassisted_vehicle_and_costs_half_a_width(ice: ExperimentRuns) -> None:
    metrics = ice.metrics
    assert metrics["orientation_change.unassisted"].value > 30.0
    assert metrics["orientation_change.assisted"].value < 5.0
    assert metrics["lateral_deviation.assisted"].value < 0.15
    longer = (
        metrics["stopping_distance.assisted"].value - metrics["stopping_distance.unassisted"].value
    )
    width = ice.configurations["assisted"].vehicle.chassis_width
    assert longer == pytest.approx(0.5 * width, abs=0.15 * width)


def test_noise_hardly_changes_yaw_rate_and_orientation(ice: ExperimentRuns) -> None:
    """Section 3.6.2: minimal effect on the yaw rate, and no swerving."""
    metrics = ice.metrics
    clean, noisy = ice.histories["assisted"], ice.histories["noisy"]
    shorter = min(len(clean.stamp_ns), len(noisy.stamp_ns))
    difference = noisy.twist[:shorter, 2] - clean.twist[:shorter, 2]
    peak = metrics["peak_yaw_rate.unassisted"].value
    assert np.sqrt(np.mean(difference**2)) < 0.1 * peak
    turned = metrics["orientation_change.noisy"].value
    assert turned < 0.2 * metrics["orientation_change.unassisted"].value
    ratio = metrics["stopping_distance.noisy"].value / metrics["stopping_distance.assisted"].value
    assert 0.95 < ratio < 1.1


def test_ice_patch_and_its_noisy_variant_are_one_experiment(ice: ExperimentRuns) -> None:
    plain = run_experiment(ExperimentLibrary(CONFIG), "ice_patch", [])
    for variant in ("unassisted", "assisted"):
        np.testing.assert_array_equal(plain.histories[variant].pose, ice.histories[variant].pose)


@pytest.mark.parametrize("name", FIGURES)
def test_study_leaves_figures_with_their_data(name: str, tmp_path: Path) -> None:
    result = study(name, tmp_path)
    for number in FIGURES[name]:
        assert (tmp_path / f"figure_{number}.png").read_bytes().startswith(b"\x89PNG")
        with (tmp_path / f"figure_{number}.csv").open() as stream:
            rows = list(csv.DictReader(stream))
        assert len(rows) > 100
        assert np.isfinite([float(row["x"]) for row in rows]).all()
    assert len(result.claims) >= 2
    assert {claim.found.status for claim in result.claims} == {"met"}, list(map(str, result.claims))
    assert set(result.files) | {tmp_path / "summary.json"} == set(tmp_path.iterdir())
    assert {metric.unit for metric in result.metrics.values()} >= {"deg", "m", "s"}
