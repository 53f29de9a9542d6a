"""Pages contain the measured numbers of their studies; differences are reported."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from omni_studies import page_numbers

PAGE = """Before.
<!-- numbers: ice.stops -->
| old |
<!-- /numbers -->
After.
"""
TEMPLATE = "| {rotation.assisted:.1f} deg | {other:length.b:.2f} m | {rotation.gone:.1f} |\n"


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "docs/templates").mkdir(parents=True)
    (tmp_path / "docs/templates/ice.stops.txt").write_text(TEMPLATE)
    (tmp_path / "docs/page.md").write_text(PAGE)
    (tmp_path / "docs/dissertation.yaml").write_text("chapter: []\n")
    (tmp_path / "docs/numbers.json").write_text("{}")
    monkeypatch.setenv("OMNI_WORKSPACE", str(tmp_path))
    return tmp_path


def summary(folder: Path, name: str, metrics: dict[str, float | None]) -> str:
    path = folder / f"{name}.json"
    entries = {key: {"value": value, "unit": "1"} for key, value in metrics.items()}
    path.write_text(json.dumps({"name": name, "metrics": entries}))
    return str(path)


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["page_numbers", *arguments])
    return page_numbers.main()


def test_a_page_is_filled_and_old_numbers_are_found(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = workspace / "docs/page.md"
    ice = summary(workspace, "ice", {"rotation.assisted": 2.4449, "rotation.gone": None})
    other = summary(workspace, "other", {"length.b": 10.07})
    assert run(monkeypatch, "--check", ice, other) == 1
    assert "page.md: ice rotation.assisted: None, now 2.4449" in capsys.readouterr().err
    assert page.read_text() == PAGE
    assert run(monkeypatch, ice, other) == 0
    assert "-->\n| 2.4 deg | 10.07 m | - |\n<!-- /numbers -->\nAfter." in page.read_text()
    assert run(monkeypatch, "--check", ice, other) == 0
    for new, code in ((2.5, 0), (2.6, 1)):  # one unit of the last digit is within the tolerance
        assert run(monkeypatch, "--check", summary(workspace, "ice", {"rotation.assisted": new,
            "rotation.gone": None})) == code  # fmt: skip


@pytest.mark.parametrize(
    ("form", "old", "near", "beyond"),
    [
        (".0%", 0.05, 0.06, 0.0611),
        (".1%", 0.05, 0.051, 0.0521),
        (".0f", 5.0, 6.0, 6.11),
        (".0%", 1.0, 0.981, 0.979),
    ],
)
def test_the_last_printed_digit_may_differ_by_one(
    form: str, old: float, near: float, beyond: float
) -> None:
    place = page_numbers.Place("study", "metric.case", form)
    assert not page_numbers.outdated(place, old, near)
    assert page_numbers.outdated(place, old, beyond)


def test_a_number_typed_into_a_page_is_found(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = workspace / "docs/page.md"
    run(monkeypatch, summary(workspace, "ice", {"rotation.assisted": 2.4}))
    page.write_text(page.read_text().replace("| 2.4 deg", "| 2.2 deg"))
    assert run(monkeypatch, "--check") == 1
    assert "page.md: its numbers are not those" in capsys.readouterr().err


def test_a_number_that_a_page_loses_is_reported(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, summary(workspace, "ice", {"rotation.assisted": 2.4})) == 0
    assert run(monkeypatch, summary(workspace, "ice", {"rotation.gone": 1.0})) == 1
    assert "page.md: ice rotation.assisted: 2.4, now None" in capsys.readouterr().err
    assert "| - deg | - m | 1.0 |" in (workspace / "docs/page.md").read_text()


def test_two_values_of_one_metric_are_refused(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = summary(workspace, "ice", {"rotation.assisted": 2.4})
    (workspace / "other").mkdir()
    second = summary(workspace / "other", "ice", {"rotation.assisted": 2.5})
    with pytest.raises(SystemExit, match=f"{second}: .* another value of ice rotation.assisted"):
        run(monkeypatch, first, second)
    assert run(monkeypatch, first, f"dry={second}") == 0


def test_numbers_come_from_tables(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = workspace / "docs/page.md"
    page.write_text("<!-- numbers: tires -->\n<!-- /numbers -->\n")
    (workspace / "docs/templates/tires.txt").write_text(
        "| soft tire | {grip.soft_tire_mean_1:.1f} | {soft:grip.soft_tire_mean_1:.1f} |\n"
        "| hard tire | {grip.hard_tire_mean_1:.1f} | {soft:grip.hard_tire_mean_1:.1f} |\n"
    )
    for folder, factor in (("a", 1.0), ("b", 2.0)):
        (workspace / folder).mkdir()
        table = f"tire,mean [1]\nsoft tire,{factor}\nhard tire,{3.0 * factor}\n"
        (workspace / folder / "grip.csv").write_text(table)
        summary(workspace / folder, "tires", {})
    first, other = (str(workspace / folder / "tires.json") for folder in "ab")
    assert run(monkeypatch, first, f"soft={other}") == 0
    rows = "-->\n| soft tire | 1.0 | 2.0 |\n| hard tire | 3.0 | 6.0 |\n<!--"
    assert rows in page.read_text()
    (workspace / "a/grip.csv").write_text("tire,mean [1]\nsoft tire,1.5\nhard tire,3\n")
    assert run(monkeypatch, "--check", first) == 1
