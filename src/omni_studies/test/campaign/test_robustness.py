"""Random braking maneuvers and their limits; a campaign loses no run."""

from __future__ import annotations

import csv
import dataclasses
import multiprocessing
import os
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from local_cluster import local_client

from omni_core.configuration import ConfigurationError
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_sim.masses import MassProperties
from omni_studies.campaign.random_braking import (
    Outcome,
    RandomBraking,
    compare,
    draw,
    energy_rise,
    outcome,
    violations,
)
from omni_studies.studies import robustness
from omni_studies.study import StudyRun
from omni_tools.campaign import runner
from omni_tools.campaign.runner import (
    CampaignOptions,
    ResultTable,
    connected,
    run_campaign,
)

if TYPE_CHECKING:
    from distributed import Client

CONFIG = Path(__file__).resolve().parents[4] / "config"
# A seed whose vehicle turns farther because its sensor fails, without fault detection.
SENSOR_FAILS = 328
ALONE = ("brake_assist.fault_detection=false",)
FINE = Outcome(1, "mecanum_forklift", 20.0, 2.0, 5.0, 6.0, 0.0, 0.0, 1, 1, 0, 0.0)


@pytest.fixture(scope="module")
def braking() -> RandomBraking:
    return RandomBraking(ExperimentLibrary(CONFIG))


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    with local_client() as client:
        yield client


@pytest.mark.parametrize("seed", [0, 1, 2, 7, SENSOR_FAILS])
def test_the_file_of_a_run_is_that_run(braking: RandomBraking, seed: int, tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text(braking.experiment_file(seed, "worst: of all"))
    library = ExperimentLibrary(CONFIG)
    assert set(library.variants(str(path))) == {"unassisted", "assisted"}
    for variant, configuration in braking.configurations(draw(seed)).items():
        loaded = library.load(str(path), variant)
        assert "worst: of all" in loaded.description
        described = dataclasses.replace(configuration, description=loaded.description)
        assert loaded == described
        assert configuration.brake_assist.enabled == (variant == "assisted")


def test_every_kind_of_adversity_is_drawn() -> None:
    drawn = [draw(seed) for seed in range(200)]
    assert {one["vehicle"] for one in drawn} == {
        "mecanum_forklift",
        "three_wheel_robot",
        "six_wheel_mecanum",
    }
    failures = {one["velocity_sensor"].get("failure", "none") for one in drawn}
    assert failures == {"none", "frozen", "zero", "invalid"}
    assert {len(one["ground"]["patches"]) for one in drawn} == {0, 1, 2, 3}
    for entry in ("speed", "direction_deg", "yaw_rate_deg", "pedal"):
        assert len({one["maneuver"][entry] for one in drawn}) > 50


@pytest.mark.parametrize(
    ("change", "broken"),
    [
        ({}, ()),
        ({"orientation_assisted": 24.9}, ()),
        ({"orientation_assisted": 25.1}, ("orientation",)),
        ({"distance_assisted": 10.1}, ("distance",)),
        ({"distance_unassisted": 0.01, "distance_assisted": 0.1}, ()),
        ({"energy_rise_assisted": 0.01}, ("energy",)),
        ({"stopped_assisted": 0}, ("rest",)),
        ({"stopped_assisted": 0, "stopped_unassisted": 0}, ()),
    ],
)
def test_limits(change: dict[str, Any], broken: tuple[str, ...]) -> None:
    assert violations(FINE._replace(**change)) == broken


def test_energy_that_comes_back_is_found(braking: RandomBraking) -> None:
    configuration = braking.configurations(draw(8))["assisted"]
    run = run_fast_loop(configuration)
    assert energy_rise(run, configuration) < 1e-9
    assert run.energy[-1] < 1e-3 * run.energy[0]
    vehicle = configuration.vehicle
    masses = MassProperties.of(vehicle.body, vehicle.load)
    v_x, v_y, yaw_rate = run.twist[0]
    velocity = v_x - yaw_rate * masses.center[1], v_y + yaw_rate * masses.center[0]
    body = masses.mass * np.dot(velocity, velocity) + masses.yaw_inertia * yaw_rate**2
    wheels = vehicle.wheel_inertia * np.sum(run.wheel_speed[0] ** 2)
    # The tires store little energy before the braking.
    assert run.energy[0] == pytest.approx(0.5 * (body + wheels), rel=1e-6)
    energy = run.energy.copy()
    energy[((run.brake_start or 0) + len(energy)) // 2] += 0.02 * run.energy[0]
    pushed = dataclasses.replace(run, energy=energy)
    assert energy_rise(pushed, configuration) > 0.01


def test_fault_detection_keeps_the_limit_where_the_sensor_fails(braking: RandomBraking) -> None:
    assert violations(compare(braking, draw(SENSOR_FAILS))) == ()


def test_without_its_cause_a_run_keeps_the_limit() -> None:
    braking = RandomBraking(ExperimentLibrary(CONFIG), ALONE)
    result = outcome(braking, SENSOR_FAILS)
    assert result.orientation == "failure"
    drawn = draw(SENSOR_FAILS)
    assert violations(compare(braking, drawn)) == ("orientation",)
    for entry in ("failure", "failure_time", "failure_duration"):
        del drawn["velocity_sensor"][entry]
    assert violations(compare(braking, drawn)) == ()


def test_a_killed_worker_loses_no_run_and_changes_none(
    braking: RandomBraking, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeds = range(40)
    work = partial(outcome, braking)
    expected = [work(seed) for seed in seeds]
    monkeypatch.setattr(runner, "_WORTH", 0.0)
    killed: list[int] = []

    def report(share: float, _words: str) -> None:
        team = [process.pid for process in multiprocessing.active_children()]
        if not killed and share > 0.2:
            killed.extend(pid for pid in team if pid is not None)
            os.kill(killed[0], signal.SIGKILL)

    options = CampaignOptions(workers=2)
    path = tmp_path / "runs.csv"
    assert run_campaign(work, seeds, Outcome, options, path, "abc", report) == expected
    assert len(killed) == 2
    assert not multiprocessing.active_children()


def test_what_is_not_drawn_can_be_changed(tmp_path: Path) -> None:
    library = ExperimentLibrary(CONFIG)
    law = "brake_assist.law=omni_brake_assist.laws.sliding_mode:SlidingMode"
    changed = RandomBraking(library, ["brake_assist.weighting=zero", law])
    path = tmp_path / "run.yaml"
    path.write_text(changed.experiment_file(3, "why not"))
    loaded = library.load(str(path), "assisted").brake_assist
    assert loaded == changed.configurations(draw(3))["assisted"].brake_assist
    assert (loaded.weighting, loaded.k) == ("zero", 7)
    assert changed.fingerprint != RandomBraking(library).fingerprint
    with pytest.raises(ConfigurationError, match="the campaign draws this value"):
        RandomBraking(library, ["maneuver.speed=3"])


def test_an_interrupted_campaign_goes_on(
    client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = ExperimentLibrary(CONFIG)
    monkeypatch.setattr(runner, "CHUNK_TIME", 1e-6)

    def run(folder: Path, interrupt_at: float = 2.0, *, resume: bool = False) -> None:
        folder.mkdir(exist_ok=True)

        def report(share: float, _words: str) -> None:
            if share >= interrupt_at:
                raise KeyboardInterrupt

        options = robustness.Options(
            runs=20,
            seed=SENSOR_FAILS - 10,
            overrides=ALONE,
            scheduler=client.scheduler.address,
            resume=resume,
        )
        robustness.run(options, StudyRun(library, folder, report))

    once, twice = tmp_path / "once", tmp_path / "twice"
    run(once)
    with pytest.raises(KeyboardInterrupt, match="--resume"):
        run(twice, interrupt_at=0.3)
    rows = (twice / "runs.csv").read_text().splitlines()
    assert 6 <= len(rows) - 2 < 20
    # Existing results are not computed again, even if they are wrong.
    cells = rows[2].split(",")
    cells[2] = "0.125"
    (twice / "runs.csv").write_text("\n".join([*rows[:2], ",".join(cells), *rows[3:]]) + "\n")
    run(twice, resume=True)
    resumed = (twice / "runs.csv").read_text().splitlines()
    assert resumed[2] == ",".join(cells)
    assert resumed[3:] == (once / "runs.csv").read_text().splitlines()[3:]
    with (once / "violations.csv").open() as stream:
        violation = {row["seed"]: row["cause"] for row in csv.DictReader(stream)}
    assert violation[str(SENSOR_FAILS)] == "failure"
    assert f"seed: {SENSOR_FAILS}\n" in (once / "worst_orientation_1.yaml").read_text()


def test_a_table_that_was_cut_off_loses_its_last_line_only(tmp_path: Path) -> None:
    path = tmp_path / "runs.csv"
    exact = FINE._replace(distance_assisted=float(np.nextafter(6.0, 7.0)), orientation="noise")
    table: ResultTable[Outcome] = ResultTable(path, Outcome, "abc", resume=False)
    table.add([exact._replace(seed=2), FINE])
    assert len(path.read_text().splitlines()) == 4
    table.save()
    whole = path.read_text()
    assert ResultTable(path, Outcome, "abc", resume=True).results == {
        1: FINE,
        2: exact._replace(seed=2),
    }
    path.write_text(whole[:-5])
    assert ResultTable(path, Outcome, "abc", resume=True).results == {1: FINE}
    with pytest.raises(ConfigurationError, match="--resume"):
        ResultTable(path, Outcome, "def", resume=True)
    assert not ResultTable(path, Outcome, "def", resume=False).results


def test_a_cluster_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="--scheduler"), connected("tcp://[::1]:9", 0.2):
        pass
