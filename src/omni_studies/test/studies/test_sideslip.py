"""The sideslip study with little data: measured angles, and reports where it cannot measure."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from omni_core.commands.command_options import parse_options
from omni_core.configuration import ConfigurationError
from omni_core.sensors import LineSensor
from omni_runs.experiment import ExperimentLibrary
from omni_studies.studies import sideslip
from omni_studies.studies.sideslip import Angles
from omni_studies.study import StudyResult, StudyRun

CONFIG = Path(__file__).resolve().parents[4] / "config"


def options(*arguments: str) -> sideslip.Options:
    return parse_options(sideslip.Options, [*arguments, "--runs", "1", "--dpi", "200"])


def test_the_angle_is_measured_up_to_the_overlap_and_not_beyond(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    chosen = options("--ground", "cork", "--sensors", "generic")
    result = sideslip.run(chosen, StudyRun(ExperimentLibrary(CONFIG), tmp_path))
    metrics = {key: metric.value for key, metric in result.metrics.items()}
    for speed, share, limit in ((2, 0.95, 0.2), (10, 0.95, 0.1), (20, 0.9, 0.1)):
        assert metrics[f"measured_share.cork_generic_{speed}"] > share
        assert metrics[f"rms_error.cork_generic_{speed}"] < limit
    assert metrics["measured_share.cork_generic_80"] == 0.0  # lines have nothing in common
    assert math.isnan(metrics["rms_error.cork_generic_80"])
    assert metrics["overlap_limited_speed.generic"] == pytest.approx(20.0)
    assert metrics["rms_error_slipping.cork_generic_10"] > metrics["rms_error.cork_generic_10"]
    with (tmp_path / "sideslip.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["panel"] == "every batch at 10 m/s"]
    points = np.array([(row["x"], row["y"]) for row in rows if row["line"]], dtype=np.float64)
    angles = np.unique(points[:, 0])
    assert angles == pytest.approx(np.arange(-15.0, 15.1, 2.5))
    # Every angle by itself, so that signs cannot cancel.
    errors = [math.sqrt(np.mean(points[points[:, 0] == x, 1] ** 2)) for x in angles]
    assert max(errors) < 0.2


class Wheel:
    """Replaces the rendered wheel; the ground determines the share of measured batches."""

    def __init__(self, _: LineSensor, shares: dict[float, float], *_others: Any) -> None:
        self._shares = shares

    def measure(self, speed: float, truth: NDArray[np.float64], *_: Any) -> Angles:
        angle = truth[:, None] + 0.001 / speed * np.resize([-1.0, 1.0], (len(truth), 20))
        flat = angle.reshape(-1)
        flat[round(self._shares.get(speed, 0.0) * len(flat)) :] = math.nan
        sideways = -speed * np.tan(angle)
        return Angles(speed, 0.8, truth, angle, sideways)


def test_a_file_of_one_camera_is_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("omni_studies.line_options.grounds_of", lambda *_: {"fine": {1.0: 1.0}})
    monkeypatch.setattr(sideslip, "RollingWheel", Wheel)

    def run(text: str) -> StudyResult:
        path = tmp_path / "one.yaml"
        path.write_text(text, encoding="utf-8")
        study = StudyRun(ExperimentLibrary(CONFIG), tmp_path)
        return sideslip.run(options("--sensors", str(path)), study)

    result = run("only: {x: 0.7, y: 0.5, heading_deg: 90, width: 0.01}\n")
    assert result.metrics[f"overlap_limited_speed.{tmp_path / 'one.yaml'}"].value == pytest.approx(
        10.0
    )
    with pytest.raises(ConfigurationError, match=r"one\.yaml names no camera"):
        run("{}\n")
    with pytest.raises(ConfigurationError, match=r"sensors\.only\.pixels: 32 px leave"):
        run("only: {x: 0.7, y: 0.5, heading_deg: 90, pixels: 32}\n")


def test_slip_scales_the_tangent() -> None:
    truth = np.array([-0.2, 0.1])
    exact = Angles(
        10.0,
        0.8,
        truth,
        truth[:, None],
        -10.0 * np.sin(truth)[:, None],
    )
    slipping = np.arctan(np.tan(truth) / 0.9) - truth
    assert exact.rms_error_with(0.9) == pytest.approx(float(np.sqrt(np.mean(slipping**2))))


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    run = StudyRun(ExperimentLibrary(CONFIG), tmp_path)
    with pytest.raises(ConfigurationError, match="--noise"):
        sideslip.run(options("--noise", "nan"), run)
    with pytest.raises(ConfigurationError, match="'generik' is not known"):
        sideslip.run(options("--sensors", "generik", "--ground", "cork"), run)
