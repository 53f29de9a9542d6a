"""A line camera that is wrong says so: small drives of the study, faulty cameras among them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from omni_analysis.line_trials.honesty_trials import FAULTS, Ground, Motion, Tally, drive_over
from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.metrics import Metric
from omni_analysis.studies import StudyRun, honesty
from omni_platform.command_options import parse_options

CONFIG = Path(__file__).parents[3] / "config"

MOTIONS = (Motion((6.0, 0.0, 0.2)), Motion((0.5, 0.1, 0.0)))


@pytest.fixture(scope="module")
def tallies() -> dict[str, Tally]:
    names = ("none", "dirt_spots", "stuck_pixel", "hot_pixels", "prnu", "wrong_rate", "lost_lines")
    ground = Ground("cork", texels=2048)
    return drive_over(ground, {name: FAULTS[name] for name in names}, range(2), 10, 5, MOTIONS)


@pytest.mark.parametrize("fault", ["dirt_spots", "stuck_pixel", "hot_pixels", "prnu"])
def test_what_stands_still_in_the_view_is_no_ground(fault: str, tallies: dict[str, Tally]) -> None:
    tally = tallies[fault]
    assert not tally.silent.any()
    assert tally.available > 0.6


def test_steps_of_the_dark_signal_do_not_draw_quick_matches_of_a_faint_ground() -> None:
    motions = (Motion((8.0, 0.0, 0.3), -1.0), Motion((5.0, 0.0, 0.0), -1.5))
    ground = Ground("brick", texels=2048)
    tally = drive_over(ground, {"steps": FAULTS["dark_steps"]}, range(2), 9, 1, motions)["steps"]
    assert not tally.silent.any()
    assert tally.available > 0.1


@pytest.mark.parametrize("fault", ["dirt_spots", "shadow_fixed"])
def test_who_sees_dirt_alone_does_not_confirm_what_others_see_of_grain(fault: str) -> None:
    ground = Ground("planks", texels=4096)
    tally = drive_over(ground, {fault: FAULTS[fault]}, range(4, 5), 20, 1)[fault]
    assert not tally.silent.any()


def test_honest_lines_are_believed(tallies: dict[str, Tally]) -> None:
    tally = tallies["none"]
    assert tally.available > 0.95
    assert np.nanmean(tally.ratio**2) < 3.0


@pytest.mark.parametrize("fault", ["wrong_rate", "lost_lines"])
def test_time_that_contradicts_the_line_rate_is_named(
    fault: str, tallies: dict[str, Tally]
) -> None:
    tally = tallies[fault]
    assert not tally.silent.any()
    assert any(reason.startswith("time:") for reason in tally.reasons)


def test_drives_add_up_in_whatever_pieces_they_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(honesty, "GROUNDS", {"cork": Ground("cork", texels=2048)})

    def study(folder: str, *words: str) -> dict[str, Metric]:
        (tmp_path / folder).mkdir(exist_ok=True)
        options = [*words, "--faults", "none,swapped_batches", "--batches", "2", "--workers", "1"]
        run = StudyRun(ExperimentLibrary(CONFIG), tmp_path / folder)
        return dict(honesty.run(parse_options(honesty.Options, options), run).metrics)

    whole = study("whole")
    assert whole["availability.cork_none"].value > 50.0
    study("parts", "--seeds", "0:5")
    assert study("parts", "--resume") == whole
