"""Output of a study, and conditions under which it fails."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from omni_bringup.cli import main
from omni_runs.metrics import Metric
from omni_studies.claims import Claim
from omni_studies.command import _text
from omni_studies.studies import tires
from omni_studies.study import StudyResult


def printed(result: StudyResult) -> list[str]:
    shown = io.StringIO()
    console = Console(width=80, file=shown)
    for part in _text(result):
        console.print(part)
    return shown.getvalue().splitlines()


def test_a_table_of_80_columns_breaks_no_name_of_a_case() -> None:
    case = "turn_while_translate_allocation_proportional_46_deg"
    metrics = {
        f"stopping_distance.{case}": Metric(12.345, "m", at_most=10.0),
        "orientation_change.short": Metric(0.05564, "deg", at_most=5.0),
    }
    lines = printed(StudyResult(metrics))
    assert max(map(len, lines)) <= 80
    (row,) = (line.split() for line in lines if case in line)
    assert row == [case, "12.35", "10", "missed"]
    assert [line.strip() for line in lines if "[" in line] == [
        "stopping_distance [m]",
        "orientation_change [deg]",
    ]


def test_quantities_of_the_same_cases_share_a_table_with_a_row_for_each_case() -> None:
    cases = [f"my_robot_{source}_{law}" for source in ("otos", "lines") for law in ("a", "b")]
    metrics = {
        f"{quantity}.{case}": Metric(float(index), "deg")
        for quantity in ("rotation", "rotation_unassisted")
        for index, case in enumerate(cases)
    }
    lines = printed(StudyResult(metrics))
    rows = [line.split() for line in lines if line.startswith("my_robot")]
    assert rows == [[case, str(index), str(index)] for index, case in enumerate(cases)]


def test_a_long_reference_and_a_status_are_whole_at_80_columns() -> None:
    case = "a_case_of_a_vehicle_with_a_long_name_on_a_ground_with_an_even_longer_name"
    metric = Metric(12.3456, "m", reference=11.98765, at_least=0.125, at_most=10.0)
    lines = printed(StudyResult({f"stopping_distance.{case}": metric}))
    assert max(map(len, lines)) <= 80
    words = " ".join(lines).split()
    assert {"12.35", "11.99", "0.125", "10", "missed", "status"} <= set(words)


def test_a_limit_or_a_claim_is_missed_and_what_holds_is_not() -> None:
    held, broken = Metric(1.0, "1", at_most=2.0), Metric(3.0, "1", at_most=2.0)
    assert StudyResult({"x.a": held}, claims=(Claim("it holds", held),)).missed == []
    assert StudyResult({"x.a": broken, "x.b": held}).missed == ["x.a"]
    assert StudyResult({"x.a": held}, claims=(Claim("it fails", broken),)).missed == ["it fails"]


def test_a_missed_limit_ends_a_study_with_1_only_if_strict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    metrics = {"x.a": Metric(3.0, "1", at_most=2.0)}
    monkeypatch.setattr(tires, "run", lambda _, study: study.result(metrics))
    for strict, code in (((), 0), (("--strict",), 1)):
        with pytest.raises(SystemExit) as ended:
            main(["study", "tires", "--json", "--out", str(tmp_path), *strict])
        assert ended.value.code == code
        assert json.loads(capsys.readouterr().out)["metrics"]["x.a"]["status"] == "missed"
