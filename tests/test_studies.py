"""The studies, started like by a user."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from omni_process import omni_here

from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.recorded_run import read_run
from omni_studies.identification import identification

if TYPE_CHECKING:
    from conftest import RunExperiment


def test_table_2_is_within_its_tolerances_on_the_command_line(tmp_path: Path) -> None:
    finished = omni_here(["study", "table2", "--json", "--out", str(tmp_path)])
    assert finished.returncode == 0, finished.stderr
    document = json.loads(finished.stdout)
    assert document == json.loads((tmp_path / "summary.json").read_text())
    assert document["name"] == "table2"
    assert {m["status"] for m in document["metrics"].values() if "status" in m} == {"met"}
    with (tmp_path / "metrics.csv").open() as stream:
        rows = {row["case"]: row for row in csv.DictReader(stream)}
    for case in ("unassisted", "zero", "cosine", "k1", "k7"):
        for quantity in ("orientation_change", "stopping_distance"):
            metric = document["metrics"][f"{quantity}.{case}"]
            assert {"value", "unit", "reference", "at_most", "status"} <= set(metric)
            written = float(rows[case][f"{quantity} [{metric['unit']}]"])
            assert written == pytest.approx(metric["value"], rel=1e-5)
            deviation = document["metrics"][f"{quantity}_deviation.{case}"]
            assert abs(metric["value"] - metric["reference"]) == deviation["value"]


def test_a_search_leaves_its_configuration_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def search(
        bases: dict[str, ExperimentConfiguration], *, generations: int, **_: object
    ) -> dict[str, float]:
        assert generations == 1
        return {**identification.parameters_of(bases["k7"]), "speed": 5.5}

    monkeypatch.setattr(identification, "search", search)  # test_identification.py has it
    finished = omni_here(
        ["study", "table2", "--identify", "--generations", "1", "--json", "--out", str(tmp_path)]
    )
    assert finished.returncode == 0, finished.stderr
    assert len(json.loads(finished.stdout)["metrics"]) == 21
    vehicle = yaml.safe_load((tmp_path / "table_2_mecanum.yaml").read_text())
    experiment = yaml.safe_load((tmp_path / "turn_while_translate.yaml").read_text())
    assert experiment["vehicle"] == "table_2_mecanum"
    assert experiment["maneuver"]["speed"] == 5.5
    assert set(vehicle["wheels"]) == {"rear_left", "front_left", "front_right", "rear_right"}


def test_braking_out_of_a_turn_is_the_same_over_the_graph(
    run_experiment: RunExperiment, library: ExperimentLibrary
) -> None:
    words = ["turn_while_translate", "--variant", "k1", "--set", "simulation.render_lines=false"]
    over_topics = read_run(run_experiment(*words).folder / "k1")
    fast = run_fast_loop(library.load("turn_while_translate", "k1"))
    for name in ("stamp_ns", "pose", "twist", "wheel_speed", "brake_torque", "enable", "error"):
        np.testing.assert_array_equal(getattr(over_topics, name), getattr(fast, name))
