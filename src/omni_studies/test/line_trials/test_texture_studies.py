"""Sideways motion is measured on ground with texture, and flagged on ground without."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from omni_core.commands.command_options import parse_options
from omni_core.configuration import ConfigurationError
from omni_runs.experiment import ExperimentLibrary
from omni_sim.texture.configuration import TextureConfiguration
from omni_sim.texture.texture import GroundTexture, generate_texture
from omni_studies.line_trials.view_grid import GROUP, MOTION
from omni_studies.study import StudyRun, load_study
from omni_tools.line_trials.rig import View
from omni_tools.line_trials.trials import Matches, ViewMotion, measure

CONFIG = Path(__file__).resolve().parents[4] / "config"
VIEW = View(256, 0.05, 0.02, 2500.0)


def ground(kind: str) -> GroundTexture:
    return generate_texture(TextureConfiguration(kind=kind, size=0.1, texels=1024))


def move(
    kind: str, speed: float, angle: float = MOTION.angle, axis: float = 0.0, noise: float = 1.0
) -> Matches:
    motions = [ViewMotion(VIEW, speed, angle, axis)]
    return measure(motions, ground(kind), GROUP, noise, seed=1, runs=2)[0]


@pytest.mark.parametrize("axis", [0.0, 0.7, math.pi / 2])
def test_motion_is_found_whatever_the_heading(axis: float) -> None:
    matches = move("cork", 6.0, math.radians(40.0), axis)
    expected = 6.0 / 2500.0 * math.cos(math.radians(40.0)) / (0.05 / 256)
    assert matches.truth == pytest.approx(np.full(2 * GROUP, expected))
    assert matches.mean_error <= 0.5
    assert matches.usable.all()
    assert matches.undetected_share == 0.0
    assert matches.right_medians(GROUP) == 1.0


def test_overlap_is_the_common_area() -> None:
    assert VIEW.overlap(20.0, math.pi / 2) == pytest.approx(0.6)
    assert VIEW.overlap(25.0, 0.0) == pytest.approx(0.8)
    assert VIEW.overlap(60.0, math.pi / 2) == 0.0


def test_wood_is_measured_parallel_to_its_grain_only() -> None:
    parallel = move("wood", 12.0, axis=math.pi / 2)
    across = move("wood", 12.0)
    assert parallel.mean_error <= 1.0
    assert across.mean_error > 5.0


def test_noise_drowns_plastic() -> None:
    assert move("plastic", 6.0, noise=0.0).right_medians(GROUP) == 1.0
    assert not move("plastic", 6.0, noise=5.0).usable.any()


def run(name: str, folder: Path, *arguments: str) -> dict[str, float]:
    study = load_study(name)
    options = parse_options(study.Options, [*arguments, "--runs", "1", "--dpi", "400"])
    result = study.run(options, StudyRun(ExperimentLibrary(CONFIG), folder))
    assert all(path.stat().st_size > 0 for path in result.files)
    return {key: metric.value for key, metric in result.metrics.items()}


def test_presets_reach_the_speeds_of_table_4(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    metrics = run("sensor_presets", tmp_path, "--ground", "cork", "--hard", "brick")
    assert metrics["computed_speed.lis770i"] == pytest.approx(3.0, rel=0.02)
    assert metrics["computed_speed.s3901"] == pytest.approx(120.0, rel=0.02)
    for name in ("lis770i", "s3901"):
        assert metrics[f"max_speed.{name}"] == pytest.approx(metrics[f"computed_speed.{name}"])
        assert metrics[f"measurable_speed.{name}_cork"] > metrics[f"computed_speed.{name}"]
        assert metrics[f"usable_share.{name}_cork"] > 0.95
        assert metrics[f"usable_share.{name}_brick"] > 0.9
        assert metrics[f"right_median_share.{name}_brick"] > 0.9
    assert metrics["computed_speed.lis770i_full"] == pytest.approx(1.3)
    for name, rate in (("lis770i", 2985.0), ("lis770i_full", 1300.0), ("s3901", 15600.0)):
        assert metrics[f"clocked_line_rate.{name}"] == pytest.approx(rate, rel=0.005)
    # Table 4 rounds the width of the view with the largest height, 312.5 / 6006 of 50 mm.
    assert metrics["height_width.step_5"] == pytest.approx(2.6, rel=0.005)
    assert metrics["height_speed.step_2"] == pytest.approx(0.4 * 1.04e-3 * 2985.0, rel=0.005)


def test_surfaces_are_written_with_every_shape(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    metrics = run("texture_direction", tmp_path, "--drives", "2")
    assert metrics["mean_error.wood_parallel"] < 1.0 < metrics["mean_error.wood_across"]
    assert metrics["odometry_measured_share_smallest.wood_parallel"] == 1.0
    for direction in ("parallel", "across"):
        assert metrics[f"odometry_wrong_share.wood_{direction}"] == 0.0
    with (tmp_path / "texture_direction.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 70
    assert np.isfinite([float(row["mean_error_px"]) for row in rows]).all()


def test_options_out_of_range_are_refused(tmp_path: Path) -> None:
    for wrong in (["--runs", "0"], ["--seed", "-1"], ["--ground", "lawn"]):
        study = load_study("difficult_textures")
        with pytest.raises(ConfigurationError):
            study.run(
                parse_options(study.Options, wrong), StudyRun(ExperimentLibrary(CONFIG), tmp_path)
            )


def test_the_plate_of_grounds_shows_contrast_and_fineness(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    study = load_study("grounds")
    arguments = ["--dpi", "600"]
    for kind in ("sand", "plastic", "worn_asphalt"):
        arguments += ["--ground", kind]
    options = parse_options(study.Options, arguments)
    result = study.run(options, StudyRun(ExperimentLibrary(CONFIG), tmp_path))
    value = {name: metric.value for name, metric in result.metrics.items()}
    assert value["texels_per_pixel.sand"] == pytest.approx(0.05 / 1024 / (0.0254 / 600.0), rel=0.01)
    assert value["contrast.sand"] > 2.0 * value["contrast.plastic"]
    assert value["median_frequency.sand"] > 2.0 * value["median_frequency.worn_asphalt"]
    # As photographs of asphalt after a box of 20 mm.
    assert 1.9 < value["contrast.worn_asphalt"] < 3.1
    assert all(path.stat().st_size > 0 for path in result.files)
