"""A line camera that is wrong says so: small drives of the study, faulty cameras among them."""

from __future__ import annotations

import numpy as np
import pytest

from omni_analysis.line_trials.honesty_trials import FAULTS, Ground, Motion, Tally, drive_over

MOTIONS = (Motion((6.0, 0.0, 0.2)), Motion((0.5, 0.1, 0.0)))


@pytest.fixture(scope="module")
def tallies() -> dict[str, Tally]:
    names = ("none", "dirt_spots", "stuck_pixel", "hot_pixels", "prnu", "wrong_rate", "lost_lines")
    ground = Ground("cork", texels=2048)
    return drive_over(ground, {name: FAULTS[name] for name in names}, 2, 10, 5, MOTIONS)


@pytest.mark.parametrize("fault", ["dirt_spots", "stuck_pixel", "hot_pixels", "prnu"])
def test_what_stands_still_in_the_view_is_no_ground(fault: str, tallies: dict[str, Tally]) -> None:
    tally = tallies[fault]
    assert not tally.silent.any()
    assert tally.available > 0.6


def test_steps_of_the_dark_signal_do_not_draw_quick_matches_of_a_faint_ground() -> None:
    motions = (Motion((8.0, 0.0, 0.3), -1.0), Motion((5.0, 0.0, 0.0), -1.5))
    ground = Ground("brick", texels=2048)
    tally = drive_over(ground, {"steps": FAULTS["dark_steps"]}, 2, 9, 1, motions)["steps"]
    assert not tally.silent.any()
    assert tally.available > 0.1


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
