"""Random stops of every law are compared with the bounds; a run below a bound is found."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.limit.bounds import (
    any_heading_bound,
    any_heading_sketch,
    maneuver_of,
    straight_bound,
    straight_sketch,
)
from omni_runs.limit.stop_kinds import Maneuver
from omni_sim.configuration import GroundConfiguration
from omni_studies.campaign.bound_trials import LAWS, BoundTrial, BoundTrials, _kept, below
from omni_studies.study import StudyRun, load_study

CONFIG = Path(__file__).resolve().parents[4] / "config"


@pytest.fixture(scope="module")
def library() -> ExperimentLibrary:
    return ExperimentLibrary(CONFIG)


@pytest.mark.parametrize(
    ("vehicle", "ramp"), [("mecanum_forklift", 0.05), ("six_wheel_mecanum", 0.0)]
)
def test_a_bound_is_not_above_its_sketch_and_not_far_below(
    library: ExperimentLibrary, vehicle: str, ramp: float
) -> None:
    twist = np.array([2.0, 0.5, 0.0])
    question = library.vehicle(vehicle), GroundConfiguration(friction=0.8)
    straight = straight_bound(*question, Maneuver(np.zeros(3), twist, 1.0, ramp)).distance
    sketch = straight_sketch(*question, Maneuver(np.zeros(3), twist, 1.0, ramp))
    assert straight * (1.0 - 1e-9) <= sketch < 1.1 * straight
    if ramp:  # its bound over headings takes seconds
        return
    anyhow = any_heading_bound(*question, Maneuver(np.zeros(3), twist)).distance
    sketch = any_heading_sketch(*question, Maneuver(np.zeros(3), twist))
    assert anyhow * (1.0 - 1e-9) <= sketch < 1.1 * anyhow


def test_random_stops_are_not_below_their_bounds(
    library: ExperimentLibrary, tmp_path: Path
) -> None:
    bounds: Any = load_study("bounds")
    options = bounds.Options(runs=12, seed=35, workers=1)
    result = bounds.run(options, StudyRun(library, tmp_path))
    assert result.metrics["runs.all"].value == 12
    assert result.metrics["compared.any_heading"].value == 12
    assert result.metrics["below_bound.any_heading"].value == 0
    assert result.metrics["least_over_bound.any_heading"].value > 1.0
    assert (tmp_path / "bounds.png").exists()


def test_a_stop_that_turns_and_returns_has_not_kept_its_heading(
    library: ExperimentLibrary,
) -> None:
    lawful = ["feedback=velocity_sensor", "brake_assist.law=allocation", "maneuver.speed=8"]
    experiment = library.load(
        "straight_line",
        "assisted",
        [*lawful, "vehicle.brake.kind=proportional", "maneuver.direction_deg=45"],
    )
    run, maneuver = run_fast_loop(experiment), maneuver_of(experiment.maneuver)
    assert _kept(run, experiment, maneuver) == pytest.approx(run.stopping_distance)
    for column, much in ((1, 0.2), (2, math.radians(1.0))):  # line [m] and heading [rad]
        bent = run.pose.copy()
        bent[(run.brake_start or 0) + 40, column] += much
        returned = dataclasses.replace(run, pose=bent)
        assert math.isnan(_kept(returned, experiment, maneuver))


def test_a_path_that_cannot_be_is_found(library: ExperimentLibrary) -> None:
    stop = BoundTrials(library)(36)
    assert below([stop], "any_heading") == 0
    shorter = stop._replace(path_allocation=0.8 * stop.any_heading)
    assert below([shorter], "any_heading") == 1
    fine = BoundTrial(0, "any", 1.0, math.nan, 2.0, 0.01, *[1.5] * len(LAWS), *[1.995] * len(LAWS))
    assert below([fine], "straight") == 0  # within the tolerance
    assert below([fine._replace(kept_unassisted=1.9)], "straight") == 1
    assert below([fine._replace(kept_unassisted=math.nan)], "straight") == 0
