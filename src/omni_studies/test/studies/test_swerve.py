"""Locked wheels rotate a vehicle with an uneven load, and no other."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from omni_runs.experiment import ExperimentLibrary
from omni_studies.studies import swerve
from omni_studies.study import StudyRun, run_study

LIBRARY = ExperimentLibrary(Path(__file__).parents[4] / "config")


def test_an_even_load_slides_straight_and_an_uneven_one_turns_to_it(tmp_path: Path) -> None:
    result, _ = run_study("swerve", swerve.Options(), StudyRun(LIBRARY, tmp_path))
    value = {name: metric.value for name, metric in result.metrics.items()}
    assert value["side_force.even"] == pytest.approx(0.0, abs=1e-6)
    assert value["yaw_moment.even"] == pytest.approx(0.0, abs=1e-6)
    assert value["yaw_moment.uneven"] > 500.0  # the load is to the front left
    # Figure 24: the active direction of the loaded wheel becomes parallel to the velocity.
    assert value["equilibrium_angle.start"] == pytest.approx(45.0, abs=0.5)
    assert value["equilibrium_angle.later"] < 1.0
    # A raised load moves more of the weight to the front wheels, and so to the loaded one.
    assert value["fork_rotation.raised_unassisted"] > value["fork_rotation.lowered_unassisted"]
    assert value["fork_rotation.raised_assisted"] < 10.0
    assert [claim.found.status for claim in result.claims] == ["met"] * 3
    figures = [path for path in result.files if path.suffix == ".png"]
    assert all(path.stat().st_size > 10_000 for path in figures)


def test_a_mirrored_load_turns_it_the_other_way() -> None:
    vehicle = LIBRARY.vehicle("mecanum_forklift")
    load = dataclasses.replace(vehicle.load, y=-vehicle.load.y)
    left, right = (
        swerve.locked(one, 5.0) for one in (vehicle, dataclasses.replace(vehicle, load=load))
    )
    assert right.moment == pytest.approx(-left.moment, rel=1e-6)
    assert right.total == pytest.approx(left.total * (1.0, -1.0), rel=1e-6)
    # The force is along the roller and within the friction limit of the load.
    assert np.all(np.abs(left.force) < 1.2 * left.load)
