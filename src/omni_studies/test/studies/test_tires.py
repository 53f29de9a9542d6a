"""The study of tires: written files, metrics, and trials that can fail."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_runs.experiment import ExperimentLibrary
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_studies.studies import tires
from omni_studies.study import StudyRun, run_study


@pytest.fixture(scope="module")
def library() -> ExperimentLibrary:
    return ExperimentLibrary(Path(__file__).parents[4] / "config")


@pytest.fixture(scope="module")
def robot(library: ExperimentLibrary) -> VehicleConfiguration:
    return library.load("straight_line", "assisted", ["vehicle=three_wheel_robot"]).vehicle


def test_study_draws_figures_4_to_6_and_keeps_every_limit(
    library: ExperimentLibrary, tmp_path: Path
) -> None:
    result, _ = run_study("tires", tires.Options(), StudyRun(library, tmp_path))
    names = {path.name for path in result.files}
    for number in (4, 5, 6):
        assert {f"figure_{number}.png", f"figure_{number}.csv"} <= names
    for path in result.files:
        assert path.stat().st_size > 500
    limited = [metric for metric in result.metrics.values() if metric.status]
    assert len(limited) == 9
    assert all(metric.status == "met" for metric in limited)
    # Table 1, read back from the curves.
    table = [metric for metric in result.metrics.values() if metric.reference is not None]
    assert len(table) == 8
    for metric in table:
        assert metric.value == pytest.approx(metric.reference, rel=1e-5)


def test_figure_6_is_the_inverted_parabola_of_equation_3_and_is_not_used_beyond_the_model(
    library: ExperimentLibrary, tmp_path: Path
) -> None:
    tires.run(tires.Options(tire=("linear",)), StudyRun(library, tmp_path))
    with (tmp_path / "figure_6.csv").open() as file:
        lines: dict[str, list[tuple[float, float]]] = {}
        for row in csv.DictReader(file):
            lines.setdefault(row["line"].split()[0], []).append((float(row["x"]), float(row["y"])))
    # One slope at two loads: 75 kN at 6 kN and at 9 kN; the slope is zero at 15 kN.
    assert lines["model"][-1] == pytest.approx((6.0, 75.0))
    load, slope = np.transpose(lines["parabola"])
    np.testing.assert_allclose(np.interp([6.0, 9.0, 15.0], load, slope), [75, 75, 0], atol=1e-3)
    for beyond, used in lines["used"]:
        assert beyond >= 6.0
        assert used == 75.0


def test_two_tires_of_one_name_are_refused(library: ExperimentLibrary, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="linear"):
        tires.run(tires.Options(tire=("linear", "linear")), StudyRun(library, tmp_path))


def test_trial_sees_a_tire_that_creeps(robot: VehicleConfiguration) -> None:
    # With the dissertation's kind of v_num a locked wheel creeps by slip times v_num.
    creeping = dataclasses.replace(robot, tire=dataclasses.replace(robot.tire, slip_speed=0.1))
    assert tires.slope_creep(creeping, 0.05)[1] > 1e-3
    assert tires.slope_creep(robot, 0.05)[1] < 1e-6


def test_tires_give_way_by_the_weight_on_the_slope_over_their_stiffness(
    robot: VehicleConfiguration,
) -> None:
    stiff = dataclasses.replace(robot, tire=dataclasses.replace(robot.tire, stiffness=4e5))
    give = [tires.slope_creep(vehicle, 0.02)[0] for vehicle in (robot, stiff)]
    assert give[0] == pytest.approx(2.0 * give[1], rel=0.1)


def test_brakes_that_do_not_hold_are_seen(robot: VehicleConfiguration) -> None:
    weak = dataclasses.replace(robot, brake=dataclasses.replace(robot.brake, max_torque=5.0))
    assert tires.slope_creep(weak, 0.05)[1] > 1.0
