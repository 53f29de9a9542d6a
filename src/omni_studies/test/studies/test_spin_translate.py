"""Spin while translating, section 2.5.3: the commands of (34), (35) and the resulting motion."""

from __future__ import annotations

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from omni_core.commands.command_options import parse_options
from omni_core.configuration import ConfigurationError
from omni_runs.experiment import ExperimentLibrary
from omni_sim.masses import MassConfiguration
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_studies.studies import spin_translate
from omni_studies.studies.spin_translate import SpinTranslate, track
from omni_studies.study import StudyRun, run_study

LIBRARY = ExperimentLibrary(Path(__file__).parents[4] / "config")
MANEUVER = SpinTranslate(speed=1.0, amplitude=0.8, period=5.0, yaw_rate=0.6)


def vehicle(name: str) -> VehicleConfiguration:
    loaded = LIBRARY.load("straight_line", "unassisted", [f"vehicle={name}"]).vehicle
    # Without deflection the rolling radius is that of the equations.
    stiff = dataclasses.replace(loaded.tire, vertical_stiffness=1e9)
    return dataclasses.replace(loaded, tire=stiff)


def test_reference_is_the_integral_of_its_velocity() -> None:
    time = np.linspace(0.0, 7.0, 7001)
    pose = MANEUVER.pose(time)
    world = MANEUVER.twist(time, np.zeros_like(time))
    numeric = np.gradient(pose, time, axis=0)
    np.testing.assert_allclose(numeric[1:-1], world[1:-1], atol=1e-6)
    body = MANEUVER.twist(time, pose[:, 2])
    np.testing.assert_allclose(np.hypot(*body[:, :2].T), np.hypot(*world[:, :2].T))


def test_mecanum_commands_are_those_of_equation_35() -> None:
    configuration = vehicle("mecanum_forklift")
    tracking = track(configuration, MANEUVER, 1.0)
    v_x, v_y, rate = MANEUVER.twist(tracking.history.time, tracking.reference[:, 2]).T
    lever = 0.65 + 0.5
    expected = np.column_stack(
        (
            v_x + v_y - lever * rate,
            v_x - v_y - lever * rate,
            v_x + v_y + lever * rate,
            v_x - v_y + lever * rate,
        )
    )
    np.testing.assert_allclose(tracking.wheel_command, expected / 0.2, atol=1e-3)


def test_three_wheel_commands_are_those_of_equation_34() -> None:
    tracking = track(vehicle("three_wheel_robot"), MANEUVER, 1.0)
    v_x, v_y, rate = MANEUVER.twist(tracking.history.time, tracking.reference[:, 2]).T
    half = math.sqrt(3.0) / 2.0
    expected = np.column_stack(
        (
            0.5 * v_x - half * v_y - 0.9 * rate,
            0.5 * v_x + half * v_y - 0.9 * rate,
            -v_x - 0.9 * rate,
        )
    )
    np.testing.assert_allclose(tracking.wheel_command, expected / 0.15, atol=1e-3)


@pytest.mark.parametrize("name", ["mecanum_forklift", "three_wheel_robot"])
def test_error_is_the_slip_that_the_tires_need(name: str) -> None:
    soft = vehicle(name)
    curve = soft.tire.tmeasy.x
    hard_curve = dataclasses.replace(
        curve,
        slope_1=10.0 * curve.slope_1,
        slope_2=10.0 * curve.slope_2,
        peak_slip_1=0.1 * curve.peak_slip_1,
        peak_slip_2=0.1 * curve.peak_slip_2,
    )
    hard_tmeasy = dataclasses.replace(soft.tire.tmeasy, x=hard_curve)
    hard_tire = TireConfiguration(**(vars(soft.tire) | {"tmeasy": hard_tmeasy}))
    hard = dataclasses.replace(soft, tire=hard_tire)
    errors = [np.max(track(c, MANEUVER, 5.0).position_error) for c in (soft, hard)]
    assert errors[0] < 0.03
    assert errors[1] < 0.5 * errors[0]


def test_maneuver_beyond_the_grip_is_not_followed() -> None:
    heavy = MassConfiguration(mass=600.0, height=0.3)
    configuration = dataclasses.replace(vehicle("mecanum_forklift"), load=heavy)
    fast = dataclasses.replace(MANEUVER, amplitude=4.0, period=1.5)  # needs 17 m/s^2
    assert np.max(track(configuration, fast, 3.0).position_error) > 0.5


def test_study_writes_figures_data_and_errors_within_limits(tmp_path: Path) -> None:
    options = spin_translate.Options(duration=2.0)
    result, _ = run_study("spin_translate", options, StudyRun(LIBRARY, tmp_path))
    assert {path.name for path in result.files} == {"metrics.csv"} | {
        f"{what}_{name}.{kind}"
        for name in ("mecanum", "three_wheel")
        for what in ("snapshots", "commands")
        for kind in ("png", "csv")
    }
    for name, metric in result.metrics.items():
        assert metric.status != "missed", name
    with (tmp_path / "snapshots_three_wheel.csv").open(encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["line"] == "reference path"]
    assert len(rows) == 201
    assert float(rows[-1]["x"]) == pytest.approx(2.0)


def test_option_out_of_range_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="--yaw-rate-deg"):
        parse_options(spin_translate.Options, ["--yaw-rate-deg", "nan"])
