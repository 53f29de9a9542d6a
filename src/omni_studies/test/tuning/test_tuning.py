"""The tuning study: fronts and recommendations by brute force, trials by the loop."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from omni_core.commands.command_options import parse_options
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentLibrary
from omni_studies.studies.tuning import _labels
from omni_studies.study import StudyResult, StudyRun, load_study
from omni_studies.tuning.trials import (
    OFF,
    BrakeLag,
    Setting,
    Trials,
    TuningTrial,
    configured,
    distance_at,
    front,
    recommended,
    situations,
)

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[4] / "config")
BLIND = ("simulation.render_lines=false", "feedback=velocity_sensor")


def trial(rotation: float, distance: float, switchings: float = 10.0, k: int = 7) -> TuningTrial:
    numbers = (np.array([0.9 * x, x]) for x in (rotation, distance, switchings))
    return TuningTrial(Setting("enhanced", k), BrakeLag(), *numbers)


@pytest.fixture
def cloud() -> list[TuningTrial]:
    """Random trials, of which one does not stop."""
    random = np.random.default_rng(2)
    points = random.uniform((5.0, 8.0, 10.0), (90.0, 14.0, 300.0), (60, 3))
    return [trial(*point) for point in points.tolist()] + [trial(math.inf, math.inf)]


def beats(one: TuningTrial, other: TuningTrial) -> bool:
    return (
        one.worst_rotation < other.worst_rotation and one.worst_distance <= other.worst_distance
    ) or (one.worst_rotation <= other.worst_rotation and one.worst_distance < other.worst_distance)


def test_front_is_what_nothing_beats(cloud: list[TuningTrial]) -> None:
    expected = {id(one) for one in cloud if not any(beats(other, one) for other in cloud)}
    best = front(cloud)
    assert {id(one) for one in best} == expected
    assert np.all(np.diff([one.worst_distance for one in best]) > 0.0)


def test_distance_between_two_settings_is_interpolated() -> None:
    tried = [trial(20.0, 12.0), trial(60.0, 10.0), trial(70.0, 11.0)]
    assert distance_at(tried, 30.0) == pytest.approx(11.5)
    assert distance_at(tried, 80.0) == 10.0
    assert math.isnan(distance_at(tried, 19.0))


@pytest.mark.parametrize(("rotation", "distance"), [(40.0, None), (None, 11.0), (60.0, 12.0)])
def test_choice_is_within_the_limits_and_the_best_there(
    cloud: list[TuningTrial], rotation: float | None, distance: float | None
) -> None:
    choice, sentence = recommended(cloud, rotation, distance)
    assert choice is not None
    for one in cloud:
        fits = one.worst_rotation <= (rotation or math.inf)
        if fits and one.worst_distance <= (distance or math.inf):
            if rotation is None:
                assert choice.worst_rotation <= 1.01 * one.worst_rotation
            else:
                assert choice.worst_distance <= 1.01 * one.worst_distance
    assert "brake_assist.k=7" in sentence


def test_of_equally_good_settings_the_calmer_one_is_chosen() -> None:
    tried = [trial(20.0, 10.0, 300.0), trial(20.0, 10.05, 50.0, 9), trial(20.0, 11.0, 1.0, 11)]
    choice, _ = recommended(tried, 30.0, None)
    assert choice is tried[1]


@pytest.mark.parametrize(
    ("rotation", "distance", "nearest"),
    [(5.0, None, "20.0 deg"), (None, 5.0, "10.00 m"), (25.0, 10.5, "20.0 deg and 11.00 m")],
)
def test_limits_that_nothing_meets_give_one_sentence(
    rotation: float | None, distance: float | None, nearest: str
) -> None:
    choice, sentence = recommended([trial(20.0, 11.0), trial(50.0, 10.0)], rotation, distance)
    assert choice is None
    assert sentence.startswith("No setting meets the limit ")
    assert nearest in sentence
    assert sentence.count(". ") == 0
    assert sentence.endswith(".")


def test_situations_deviate_little_and_by_their_seed() -> None:
    base = LIBRARY.load("turn_while_translate", "k1", BLIND)
    drawn = situations(base, 20, seed=3)
    assert drawn[0] is base
    assert drawn == situations(base, 20, seed=3)
    assert drawn[1:] != situations(base, 20, seed=4)[1:]
    speed = np.array([one.maneuver.speed for one in drawn]) / base.maneuver.speed
    grip = np.array([one.ground.friction for one in drawn]) / base.ground.friction
    ice = np.array([one.ground.patches["ice"].friction for one in drawn])
    np.testing.assert_allclose(ice / base.ground.patches["ice"].friction, grip)
    for share, bound in ((speed, 0.03), (grip, 0.05)):
        assert np.ptp(share) > bound
        assert np.all(np.abs(share - 1.0) <= bound + 1e-12)


@pytest.mark.parametrize("setting", [Setting("zero", 7, 0.05), Setting("enhanced", 3, 0.02)])
def test_the_sentence_names_what_was_tried(setting: Setting) -> None:
    base = LIBRARY.load("turn_while_translate", "unassisted", BLIND)
    overrides = (*BLIND, "brake_assist.enabled=true", *setting.overrides)
    by_hand = LIBRARY.load("turn_while_translate", "unassisted", overrides)
    assert configured(base, setting, BrakeLag()) == by_hand


def test_trials_are_runs_of_the_loop() -> None:
    base = LIBRARY.load("turn_while_translate", "unassisted", BLIND)
    lags = BrakeLag(), BrakeLag(0.01, 0.02)
    work = Trials([base], [OFF, Setting("enhanced", 7, 0.05)], lags)
    trials = work.collected([work.run(number) for number in range(work.count)])
    assert [one.lag for one in trials] == [lags[0], lags[0], lags[1], lags[1]]
    for one in trials:
        run = run_fast_loop(configured(base, one.setting, one.lag))
        assert one.rotation.tolist() == [run.orientation_change]
        assert one.distance.tolist() == [run.stopping_distance]
    # Nothing switches without the assistant; with it a wheel switches at most every 50 ms.
    assert [one.switchings[0] for one in trials[::2]] == [0.0, 0.0]
    assert 10.0 < trials[1].switchings[0] < 4 * 5.0 / 0.05


def run_study(folder: Path, *arguments: str) -> StudyResult:
    study = load_study("tuning")
    words = ["--k", "7", "--dwell", "0", "--situations", "2", *arguments]
    return study.run(parse_options(study.Options, words), StudyRun(LIBRARY, folder))


def test_study_recommends_for_another_vehicle(tmp_path: Path) -> None:
    result = run_study(
        tmp_path, "--vehicle", "mecanum_forklift", "--brakes", "0.01:0.03", "--max-rotation", "30"
    )
    rotation = result.metrics["orientation_change.recommended"]
    assert rotation.value <= 30.0 == rotation.at_most
    assert rotation.note in result.findings
    # Slower brakes keep the orientation no better than ideal ones.
    smallest = [
        result.metrics[f"smallest_rotation.{lag}_dwell_0_ms"] for lag in ("ideal", "10_30_ms")
    ]
    assert smallest[0].value < smallest[1].value
    assert all(path.stat().st_size > 0 for path in result.files)
    table = (tmp_path / "settings.csv").read_text().splitlines()
    assert len(table) == 1 + 2 * 4  # unassisted, cosine, k = 7 and zero with either brakes


def test_pieces_of_a_study_are_put_together(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("first", "second", "all")]
    for folder in folders:
        folder.mkdir()
    cut = ("--brakes", "0:0", "--workers", "1")
    first = run_study(folders[0], *cut, "--seeds", "0:3")
    assert first.metrics["runs.all"].value == 3
    run_study(folders[1], *cut, "--seeds", "3:99")
    parts = [word for folder in folders[:2] for word in ("--merge", str(folder))]
    merged = run_study(folders[2], *cut, *parts)
    assert "smallest_rotation.ideal_dwell_0_ms" in merged.metrics


def test_study_says_that_no_setting_meets_the_limit(tmp_path: Path) -> None:
    result = run_study(tmp_path, "--brakes", "0:0", "--max-distance", "1")
    assert math.isnan(result.metrics["stopping_distance.recommended"].value)
    assert any(sentence.startswith("No setting meets the limit ") for sentence in result.findings)


def test_labels_of_near_points_are_joined_and_no_label_is_lost() -> None:
    best = [trial(10.0, 5.0, k=3), trial(9.9, 5.01, k=5), trial(4.0, 8.0, k=7)]
    assert [words for words, _ in _labels(best, (10.0, 20.0))] == ["k = 7", "k = 3, k = 5"]
    assert [words for words, _ in _labels(best, (0.1, 0.1))] == ["k = 7", "k = 5", "k = 3"]
