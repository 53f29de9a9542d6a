"""Sources of the twist have the errors of their tables, and poor sources give longer stops."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.signals import UNMEASURED_VARIANCE
from omni_runs.experiment import ExperimentLibrary
from omni_sim.twist_sources import SOURCES, SourceModel
from omni_studies.studies import feedback
from omni_studies.study import StudyRun
from omni_tools.vehicles.estimates import Measured, write_vehicle

WHEELS = {
    f"{x}_{y}": WheelMount(x=x, y=y, roller_angle_deg=-45.0 * x * y, radius=0.1)
    for x in (-1.0, 1.0)
    for y in (-1.0, 1.0)
}
KINEMATICS = PlatformKinematics.of(WHEELS)
TWIST = np.array([1.0, -0.4, 0.3])


def measured(name: str, steps: int = 400, factor: float = 1.0) -> list[Any]:
    model = SourceModel(SOURCES[name], KINEMATICS, 3)
    twist = factor * TWIST
    speeds = KINEMATICS.wheel_speeds(twist)
    return [model.measure(10_000_000 * step, twist, speeds) for step in range(steps)]


@pytest.mark.parametrize("name", [name for name in SOURCES if name != "encoders_imu"])
def test_errors_are_as_large_as_stated(name: str) -> None:
    twists = [one for one in measured(name, factor=0.5) if one.covariance[0, 0] < 1.0]
    assert len(twists) > 100
    errors = np.array([one.value - 0.5 * TWIST for one in twists])
    stated = np.mean([np.diag(one.covariance) for one in twists], axis=0)
    assert np.all(np.mean(errors**2, axis=0) < 4.0 * stated)


def test_a_late_source_gives_what_was_true_then() -> None:
    twists = measured("late_50ms", 30)
    assert [one.stamp_ns for one in twists[5:]] == [10_000_000 * step for step in range(25)]
    assert all(one.stamp_ns < -1_000_000_000 for one in twists[:5])  # nothing has arrived yet


def test_a_slow_source_holds_its_last_sample() -> None:
    stamps = {one.stamp_ns for one in measured("rate_25hz", 40)}
    assert len(stamps) == 10


def test_a_chip_beyond_its_speed_measures_nothing() -> None:
    assert math.hypot(*TWIST[:2]) > SOURCES["pmw3901_2"].maximum_speed
    assert all(one.covariance[0, 0] >= 1e6 for one in measured("pmw3901_2"))


def test_a_third_chip_replaces_one_whose_image_is_invalid() -> None:
    shares = {}
    for chips in (2, 3):
        source = dataclasses.replace(SOURCES[f"paa5100_{chips}"], lost=0.1)
        model = SourceModel(source, KINEMATICS, 4)
        twists = [model.measure(10_000_000 * k, 0.5 * TWIST, np.zeros(4)) for k in range(2000)]
        shares[chips] = np.mean([one.covariance[0, 0] >= UNMEASURED_VARIANCE for one in twists])
    # Every twist requires two valid chips.
    assert shares[2] == pytest.approx(1.0 - 0.9**2, abs=0.03)
    assert shares[3] == pytest.approx(0.1**3 + 3.0 * 0.9 * 0.1**2, abs=0.01)


def test_flow_chips_report_the_whole_counts_between_their_last_images() -> None:
    source = dataclasses.replace(SOURCES["pmw3901_2"], relative=0.0, scale=0.0)
    step = 1.0 / (source.counts * source.period)  # velocity of one count [m/s]
    model = SourceModel(source, KINEMATICS, 5)
    speed, deceleration, found = 0.6, 2.0, []
    for k in range(30):
        now = 0.01 * k
        twist = np.array([speed - deceleration * now, 0.0, 0.0])
        found.append(model.measure(10_000_000 * k, twist, np.zeros(4)))
    ages = [10_000_000 * k - one.stamp_ns for k, one in enumerate(found)]
    assert 0 < max(ages) < 1e9 * source.period
    for one in found[1:]:
        half_steps = one.value[0] / (0.5 * step)  # the mean of two chips
        assert half_steps == pytest.approx(round(half_steps), abs=1e-6)
        # The mean velocities of the last images of both chips, which differ by up to an image.
        now = 1e-9 * one.stamp_ns
        highest = speed - deceleration * (now - 2.0 * source.period)
        lowest = speed - deceleration * now
        assert lowest - step < one.value[0] < highest + step


def test_wheels_that_roll_measure_the_twist() -> None:
    np.testing.assert_allclose(measured("encoders")[-1].value, TWIST, atol=1e-9)


def test_encoders_and_an_imu_assist_without_any_twist() -> None:
    assert all(one.stamp_ns < -1_000_000_000 for one in measured("encoders_imu"))
    library = ExperimentLibrary(Path(__file__).parents[4] / "config")
    options = feedback.Options(vehicle=(), source=("encoders_imu",), named=True)
    cases = feedback.Cases.of(library, options)
    unassisted, _, assisted = [cases.run(number) for number in range(3)]  # straight ahead
    assert assisted.law == "allocation"
    assert assisted.distance < unassisted.distance
    assert assisted.rotation < 0.3 * unassisted.rotation


def test_with_an_imu_a_late_source_is_as_good_as_its_stamps() -> None:
    library = ExperimentLibrary(Path(__file__).parents[4] / "config")
    options = feedback.Options(
        vehicle=("mecanum_forklift",), source=("ideal", "late_50ms"), runs=1, named=True
    )
    cases = feedback.Cases.of(library, options)
    stops = [cases.run(number) for number in range(len(cases))]
    found = {(one.vehicle, one.stop, one.law, one.source): one for one in stops}
    late = {key: one for key, one in found.items() if key[-1] == "late_50ms"}
    assert len(late) == 10
    for (vehicle, stop, law, _), one in late.items():
        ideal = found[vehicle, stop, law, "ideal"]
        assert one.distance <= 1.03 * ideal.distance
        assert one.rotation <= ideal.rotation + 1.0


def test_lines_are_rendered_in_the_first_stops_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared: list[Any] = []
    monkeypatch.setattr(feedback, "prepare_grounds", lambda runs, _cache: prepared.extend(runs))
    library = ExperimentLibrary(Path(__file__).parents[4] / "config")
    found = {}
    for rendered in (0, 1):
        options = feedback.Options(
            vehicle=("mecanum_forklift",),
            source=("lines_coarse",),
            runs=2,
            rendered=rendered,
            speed=1.0,
            brakes="proportional",
            workers=1,
        )
        folder = tmp_path / str(rendered)
        folder.mkdir()
        feedback.run(options, StudyRun(library, folder))
        rows = (folder / "stops.csv").read_text().splitlines()
        found[rendered] = [row for row in rows if "allocation" in row]
    assert found[0][0] != found[1][0]
    assert found[0][1] == found[1][1]
    # Before the workers start: they would all render the same ground.
    assert [one.simulation.render_lines for one in prepared] == [True, True]


def test_a_vehicle_is_measured_with_its_own_brakes_and_its_assistant(tmp_path: Path) -> None:
    measured = Measured(length=0.6, width=0.4, mass=30.0, wheel_radius=0.05, brakes="spring")
    write_vehicle("mine", measured, tmp_path / "mine")
    text = (tmp_path / "mine/experiment.yaml").read_text().replace("k: 7", "k: 3")
    (tmp_path / "mine/experiment.yaml").write_text(text)
    library = ExperimentLibrary(Path(__file__).parents[4] / "config")
    found = {}
    for brakes in (None, "velocity"):
        options = feedback.Options(
            vehicle=(str(tmp_path / "mine"),), source=("ideal",), brakes=brakes, runs=1, workers=1
        )
        base = feedback.Cases.of(library, options).bases["mine"]
        assert base.brake_assist.k == 3
        assert base.brake_assist.minimum_dwell_time == 0.1
        document = feedback.run(options, StudyRun(library, tmp_path)).conditions["mine"]
        found[brakes] = document["brake.kind"], document["brake.dead_time"], document["imu"]
    assert found == {None: ("on_off", 0.06, True), "velocity": ("velocity", 0.0, True)}
