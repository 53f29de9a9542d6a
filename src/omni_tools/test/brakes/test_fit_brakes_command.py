"""``./omni fit-brakes``: files written for a recorded stop, and rejected recordings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from omni_bringup.cli import main
from omni_tools.brakes import fit

ROOT = Path(__file__).parents[4]
BAGS = ROOT / "bags" / "small_stop"


def omni(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["fit-brakes", *map(str, arguments)])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_sample_recording_gives_its_brakes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, out = BAGS / "assisted", tmp_path / "out"
    assert omni(bag, "--twist", "ground_truth/odom", "--json", "--out", out) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((out / "summary.json").read_text())
    true = yaml.safe_load((bag / "configuration.yaml").read_text())["vehicle"]["brake"]
    text = (out / "brake.yaml").read_text()
    assert "dead_time on its bound, time_constant on its bound" in text
    found = yaml.safe_load(text)["brake"]
    entry = document["metrics"]["max_torque.all"]
    assert entry["value"] == pytest.approx(true["max_torque"], rel=0.02)
    assert found["max_torque"] == pytest.approx(entry["value"], rel=1e-4)
    assert (out / "fit.png").read_bytes().startswith(b"\x89PNG")


def test_a_precise_twist_gives_a_certain_torque(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert omni(BAGS / "assisted", "--twist", "ground_truth/odom", "--out", tmp_path) == 0
    assert "standard error of the torque" not in capsys.readouterr().out


def test_an_uncertain_torque_is_noted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def uncertain(*arguments: Any) -> fit.BrakeFit:
        found = precise(*arguments)
        errors = np.array([0.2 * found.values[0], 0.0, 0.0])
        return found._replace(standard_errors=errors)

    precise = fit.fit_brakes
    monkeypatch.setattr(fit, "fit_brakes", uncertain)
    assert omni(BAGS / "assisted", "--twist", "ground_truth/odom", "--out", tmp_path) == 0
    assert "the standard error of the torque is 20 %" in capsys.readouterr().out


def test_what_does_not_suffice_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    bag = BAGS / "assisted"
    for *arguments, reason, code in (
        (tmp_path / "none", "none", 2),
        (bag, "--vehicle", "three_wheel", "three_wheel", 2),
        (bag, bag, "given twice", 2),
        (bag, "--vehicle", "table_2_mecanum", "check that the recordings are of this vehicle", 1),
    ):
        assert omni(*arguments, "--out", out) == code
        assert reason in capsys.readouterr().err
        assert not out.exists()
