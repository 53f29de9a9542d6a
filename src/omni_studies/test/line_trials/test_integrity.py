"""Small drives of the integrity study: faulty cameras give no undetected errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omni_core.commands.command_options import parse_options
from omni_runs.experiment import ExperimentLibrary
from omni_runs.metrics import Metric
from omni_studies.line_trials.integrity_cases import FAULTS, PathMotion
from omni_studies.line_trials.integrity_trials import Ground, Tally, _Exposed, drive_over
from omni_studies.studies import integrity
from omni_studies.study import StudyRun

CONFIG = Path(__file__).parents[4] / "config"

MOTIONS = (PathMotion((6.0, 0.0, 0.2)), PathMotion((0.5, 0.1, 0.0)))


@pytest.fixture(scope="module")
def tallies() -> dict[str, Tally]:
    names = ("none", "dirt_spots", "stuck_pixel", "hot_pixels", "prnu", "wrong_rate", "lost_lines")
    ground = Ground("cork", texels=2048)
    return drive_over(ground, {name: FAULTS[name] for name in names}, range(2), 10, 5, MOTIONS)


@pytest.mark.parametrize("fault", ["dirt_spots", "stuck_pixel", "hot_pixels", "prnu"])
def test_a_fixed_pattern_is_not_taken_for_the_ground(fault: str, tallies: dict[str, Tally]) -> None:
    tally = tallies[fault]
    assert not tally.undetected.any()
    assert float(np.mean(np.isfinite(tally.ratio))) > 0.6


def test_steps_of_the_dark_signal_do_not_bias_fast_motion_over_a_faint_ground() -> None:
    braked = ((0.0, 1.0), (0.5, 0.25))
    motions = (PathMotion((8.0, 0.0, 0.3), braked), PathMotion((5.0, 0.0, 0.0), braked))
    ground = Ground("brick", texels=2048)
    tally = drive_over(ground, {"steps": FAULTS["dark_steps"]}, range(2), 9, 1, motions)["steps"]
    assert not tally.undetected.any()
    assert float(np.mean(np.isfinite(tally.ratio))) > 0.03


def test_slow_motion_across_an_axis_over_a_smooth_ground_is_measured() -> None:
    ground, motions = Ground("brick", texels=2048), (PathMotion((0.05, 0.0, 0.0)),)
    tally = drive_over(ground, {"none": FAULTS["none"]}, range(4), 9, 1, motions)["none"]
    assert not tally.undetected.any()
    assert float(np.mean(np.isfinite(tally.ratio))) > 0.4


@pytest.mark.parametrize("fault", ["dirt_spots", "shadow_fixed"])
def test_a_camera_that_sees_dirt_alone_rarely_confirms_oblique_texture(fault: str) -> None:
    ground = Ground("planks", texels=4096)
    tally = drive_over(ground, {fault: FAULTS[fault]}, range(4, 16), 20, 1)[fault]
    assert float(np.mean(np.isfinite(tally.ratio))) > 0.02
    # The grain is as clear as other textures, and a fast camera sees it too briefly.
    assert tally.undetected.mean() < 0.05


def test_fault_free_lines_are_measured(tallies: dict[str, Tally]) -> None:
    tally = tallies["none"]
    assert float(np.mean(np.isfinite(tally.ratio))) > 0.95
    assert np.nanmean(tally.ratio**2) < 3.0


@pytest.mark.parametrize("fault", ["wrong_rate", "lost_lines"])
def test_stamps_that_contradict_the_line_rate_are_reported(
    fault: str, tallies: dict[str, Tally]
) -> None:
    tally = tallies[fault]
    assert not tally.undetected.any()
    assert any(reason.startswith("time:") for reason in tally.reasons)


def test_a_campaign_in_parts_gives_the_same_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(integrity, "GROUNDS", {"cork": Ground("cork", texels=2048)})

    def study(folder: str, *words: str) -> dict[str, Metric]:
        (tmp_path / folder).mkdir(exist_ok=True)
        options = [
            *words,
            "--faults",
            "none",
            "swapped_batches",
            "--batches",
            "2",
            "--workers",
            "1",
        ]
        run = StudyRun(ExperimentLibrary(CONFIG), tmp_path / folder)
        return dict(integrity.run(parse_options(integrity.Options, options), run).metrics)

    whole = study("whole")
    assert whole["availability.cork_none"].value > 50.0
    study("parts", "--seeds", "0:5")
    assert study("parts", "--resume") == whole


def test_the_path_of_a_motion_is_the_integral_of_its_speed() -> None:
    motion = PathMotion((1.0, 0.0, 0.0), ((0.0, 0.0), (0.2, 0.0), (0.4, 2.0)))
    wanted = [0.0, 0.0, 0.05, 0.2, 0.4]
    np.testing.assert_allclose(motion.traveled(np.array([0.0, 0.2, 0.3, 0.4, 0.5])), wanted)


def test_a_case_counts_what_follows_its_lead_and_knows_the_covered_camera() -> None:
    ground, faults = Ground("gravel", texels=2048), {"cover_left": FAULTS["cover_left"]}
    tally = drive_over(ground, faults, range(2), 4, 5)["cover_left"]
    assert len(tally.ratio) == 2 * 4 * 3
    assert tally.covered.sum() == 2 * 4
    seen = np.isfinite(tally.ratio[~tally.covered])
    assert len(tally.scores) == 2
    assert tally.scores[0].shape == (4, 3)
    assert seen.size == 16


def test_a_drive_over_two_grounds_has_the_exposures_of_both() -> None:
    time, one, two = np.linspace(0.0, 0.5, 6), np.zeros((6, 2)), np.ones((6, 2))
    first, drive = (_Exposed(time, time, {"left": own.astype(np.float32)}) for own in (one, two))
    assert drive.after(first, 0.3).exposures["left"][:, 0].tolist() == [0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize("name", ["low_light", "heave", "start", "rest_flicker"])
def test_difficult_light_and_motions_are_simulated(name: str) -> None:
    ground = Ground("flake_epoxy", texels=2048)
    tally = drive_over(ground, {name: FAULTS[name]}, range(1, 3), 4, 5)[name]
    assert np.isfinite(tally.error).all()
    assert len(tally.ratio) == 2 * 4 * 3


def test_the_autocorrelation_of_constant_errors_is_one() -> None:
    nothing = np.zeros(0)
    scores = (np.full((5, 3), 2.0), np.full((3, 3), np.nan))
    products, squares = Tally(nothing, nothing, (), nothing > 0.0, scores).autocovariance
    assert products == squares == 4 * 3 * 4.0


def test_the_bound_of_a_rate_without_events_is_that_of_clopper_and_pearson() -> None:
    assert integrity._upper_bound(0, 3000) == pytest.approx(1e3 * (1.0 - 0.05 ** (1.0 / 3000)))
    assert integrity._upper_bound(3000, 3000) == 1000.0
