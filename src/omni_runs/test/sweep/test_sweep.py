"""A sweep gives the results of its single runs, in a table, a picture and a document."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from omni_bringup.cli import main
from omni_core.configuration import ConfigurationError
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_runs.options import is_swept
from omni_runs.sweep.sweep import combinations, short_keys

CONFIG = Path(__file__).resolve().parents[4] / "config"
FAST = ("feedback=velocity_sensor", "simulation.render_lines=false")


@pytest.mark.parametrize(
    ("override", "swept"),
    [("a.b=1,2", True), ("a=x,y", True), ("a=1", False), ("a=[1, 2]", False), ("a={b: 1}", False)],
)
def test_a_comma_outside_of_brackets_makes_a_sweep(override: str, swept: bool) -> None:
    assert is_swept(override) == swept


def test_every_combination_is_made_once() -> None:
    made = list(combinations(["a=1,2", "b=5", "c=x, y,z"]))
    assert len(made) == 6
    assert made[1] == ({"a": "1", "c": "y"}, ("a=1", "b=5", "c=y"))
    assert len({overrides for _, overrides in made}) == 6


def test_an_override_without_a_value_is_left_to_the_library_to_refuse() -> None:
    made = combinations(["a=1,2", "b"])
    assert [overrides for _, overrides in made] == [("a=1", "b"), ("a=2", "b")]


@pytest.mark.parametrize("overrides", [["a=1,,2"], ["a=1,"], ["a=" + ",".join("1" * 40)] * 2])
def test_a_sweep_that_makes_no_sense_is_refused(overrides: list[str]) -> None:
    with pytest.raises(ConfigurationError):
        list(combinations(overrides))


def test_the_table_holds_what_the_runs_come_to(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words = [word for override in FAST for word in ("--set", override)]
    out = tmp_path / "sweep"
    command = ["run", "small_stop", *words, "--set", "vehicle.load.mass=0,250", "--json"]
    with pytest.raises(SystemExit) as ended:
        main([*command, "--set", "brake_assist.k=1,7", "--variant", "assisted", "--out", str(out)])
    assert ended.value.code == 0
    document = json.loads(capfd.readouterr().out)
    assert document == json.loads((out / "summary.json").read_text())
    assert len(document["cases"]) == 4
    assert (out / "sweep.png").stat().st_size > 10_000
    assert len((out / "sweep.csv").read_text().splitlines()) == 5
    library = ExperimentLibrary(CONFIG)
    for case, entry in document["cases"].items():
        overrides = [f"{key}={value}" for key, value in entry["values"].items()]
        run = run_fast_loop(library.load("small_stop", entry["variant"], [*FAST, *overrides]))
        measured = document["metrics"][f"stopping_distance.{case}"]["value"]
        assert measured == run.stopping_distance


def test_a_mistake_is_refused_before_anything_runs(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", "--set", "vehicle.load.mass=0,heavy", "--out", str(tmp_path / "sweep")])
    assert ended.value.code == 2
    assert "vehicle.load.mass" in capfd.readouterr().err
    assert not (tmp_path / "sweep").exists()


def test_a_key_is_shortened_as_far_as_it_is_unambiguous() -> None:
    keys = ("vehicle.load.mass", "vehicle.body.mass", "brake_assist.k", "ground")
    assert short_keys(keys) == {
        "vehicle.load.mass": "load.mass",
        "vehicle.body.mass": "body.mass",
        "brake_assist.k": "k",
        "ground": "ground",
    }
    assert short_keys(("k", "brake_assist.k")) == {"k": "k", "brake_assist.k": "brake_assist.k"}
