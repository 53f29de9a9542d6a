"""Trials of the wheels compared with closed forms, and the study that uses them."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from omni_core.commands.command_options import parse_options
from omni_core.configuration import ConfigurationError
from omni_core.quantities import GRAVITY
from omni_runs.experiment import ExperimentLibrary
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_studies.studies import wheels
from omni_studies.study import StudyRun, run_study
from omni_studies.wheels.trials import (
    ROLLERS,
    SINGLE,
    TRIALS,
    Outcome,
    force_difference,
    force_trace,
    motion_difference,
    outcome,
    start_angles,
    with_wheels,
)

CONFIG = Path(__file__).parents[4] / "config"


@pytest.fixture(scope="module")
def library() -> ExperimentLibrary:
    """Return the repository's experiments."""
    return ExperimentLibrary(CONFIG)


@pytest.fixture(scope="module")
def forklift(library: ExperimentLibrary) -> VehicleConfiguration:
    """Return the Mecanum forklift."""
    return library.load("straight_line", "unassisted").vehicle


def test_free_wheels_resist_a_push_with_their_spin_alone(forklift: VehicleConfiguration) -> None:
    result = outcome(with_wheels(forklift, SINGLE, 12), TRIALS["push"], np.zeros((1, 4)))
    mass = forklift.masses.mass
    push = TRIALS["push"].push[1] * mass * GRAVITY
    spin = 4.0 * forklift.wheel_inertia / 0.2**2  # as a mass, wheels turning with v / R
    assert result.force[0, 1] == pytest.approx(-push * spin / (mass + spin), rel=0.05)
    assert result.force_scale == pytest.approx(push)
    expected = 0.5 * push / (mass + spin) * TRIALS["push"].duration ** 2
    assert result.motion[0, -1, 1] == pytest.approx(expected, rel=0.01)


def test_mean_force_of_a_wheel_carries_its_part_of_the_push(forklift: VehicleConfiguration) -> None:
    mass = forklift.masses.mass
    wheels = with_wheels(forklift, ROLLERS, 12)
    total = sum(
        float(force_trace(wheels, wheel, 2.0 * math.pi / 3.0)[1][:, 0].mean()) for wheel in range(4)
    )
    assert total == pytest.approx(0.2 * mass * GRAVITY, rel=0.02)


def test_differences_are_shares_of_the_reference() -> None:
    def moved(x: float, force: float) -> Outcome:
        motion = np.zeros((2, 3, 6))
        motion[:, -1, 0] = [x - 0.1, x + 0.1]
        return Outcome(np.arange(3.0), motion, np.array([[force, 0.0]] * 2), 200.0)

    reference = moved(2.0, 100.0)
    assert motion_difference(moved(2.1, 100.0), reference) == pytest.approx(0.05)
    assert force_difference(moved(2.0, 110.0), reference) == pytest.approx(0.05)
    assert motion_difference(reference, reference) == force_difference(reference, reference) == 0.0


def test_start_angles_are_those_of_their_seed() -> None:
    np.testing.assert_array_equal(start_angles(3, 4, 5), start_angles(3, 4, 5))
    assert start_angles(3, 4, 5).shape == (3, 4)


def test_study_shows_agreement_rest_and_cost(
    library: ExperimentLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wheels, "_COUNTS", (12, 24))
    options = wheels.Options(starts=3, repeats=1)
    result, _ = run_study("wheels", options, StudyRun(library, tmp_path))
    limited = {key: metric for key, metric in result.metrics.items() if metric.status}
    assert len(limited) == 2 * 6 * 3 + 2 * 3 * 3
    for key, metric in limited.items():
        assert metric.status == "met", key
    assert "cost_ratio.rollers_over_single" in result.metrics
    written = {path.name for path in tmp_path.iterdir()} - {"summary.json"}
    assert {path.name for path in result.files} == written
    # Two counts of rollers of six trials on two platforms, each for motion and force.
    with (tmp_path / "differences.csv").open(encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["line"]]
    assert len(rows) == 2 * 6 * 2 * 2
    assert {row["line"] for row in rows} == {trial.title for trial in TRIALS.values()}


@pytest.mark.parametrize("words", [["--starts", "1"], ["--seed", "-1"]])
def test_study_refuses_bad_options(words: list[str]) -> None:
    with pytest.raises(ConfigurationError, match="--s"):
        parse_options(wheels.Options, words)
