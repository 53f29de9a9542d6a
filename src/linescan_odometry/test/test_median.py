"""Single wrong displacements are excluded, and the others averaged (section 4.6)."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from linescan_odometry.pair_method import average, mark_inliers
from omni_core.quantities import FloatArray


def inliers(
    displacement: FloatArray, usable: NDArray[np.bool_] | None = None, group: int = 10
) -> NDArray[np.bool_]:
    marks = np.empty(len(displacement), np.bool_)
    if usable is None:
        usable = np.ones(len(displacement), np.bool_)
    mark_inliers(displacement, usable, group, 1.5, marks)
    return marks


def test_point_errors_are_distinguished_from_a_changing_speed() -> None:
    displacement: FloatArray = np.linspace(80.0, 72.2, 40)  # 0.2 px less with each line
    wrong = np.array([3, 4, 17, 22, 39])
    displacement[wrong] += np.array([-300.0, 12.0, 3.0, 90.0, -5.0])
    marks = inliers(displacement, group=5)
    assert np.flatnonzero(~marks).tolist() == wrong.tolist()
    weight = np.empty(40)
    mean = average(displacement, marks, weight)
    assert mean == pytest.approx(76.1, abs=1e-9)  # excluded values do not bias the mean


def test_a_group_without_a_majority_is_left_out() -> None:
    displacement = np.array([5.0, 5.1, 40.0, 5.0, -3.0, 30.0, 9.0, 77.0])
    assert inliers(displacement, group=4).tolist() == [True, True, False, True] + 4 * [False]


def test_half_of_a_group_is_no_majority() -> None:
    assert not inliers(np.array([5.0, 5.0, 40.0, -3.0])).any()
    assert inliers(np.array([5.0, 5.0, 5.0, 40.0, -3.0])).tolist() == 3 * [True] + 2 * [False]


def test_unusable_pairs_neither_vote_nor_count_as_agreeing() -> None:
    displacement = np.array([0.0, 0.0, 0.0, 8.0, 8.1, 8.0, 7.9])
    usable = np.array([False, False, False, True, True, True, True])
    assert inliers(displacement, usable).tolist() == usable.tolist()
    usable[3] = False  # 3 of 7 are left
    assert not inliers(displacement, usable).any()


@pytest.mark.parametrize("count", [1, 9, 10, 11, 25, 29])
def test_every_pair_belongs_to_one_group(count: int) -> None:
    assert inliers(np.full(count, 3.0)).all()
    assert not inliers(np.full(count, 3.0), np.zeros(count, np.bool_)).any()


def test_the_weights_are_those_of_the_mean() -> None:
    generator = np.random.default_rng(9)
    for count in (1, 2, 3, 25):
        displacement = generator.normal(7.0, 0.1, count)
        marks = generator.random(count) < 0.8
        marks[0] = True
        weight = np.empty(count)
        mean = average(displacement, marks, weight)
        assert mean == pytest.approx(weight @ displacement, abs=1e-12)
        assert weight.sum() == pytest.approx(1.0, abs=1e-12)
        assert not weight[~marks].any()


def test_a_full_batch_is_averaged_evenly() -> None:
    weight = np.empty(25)
    assert average(np.arange(25.0), np.ones(25, np.bool_), weight) == pytest.approx(12.0)
    assert weight == pytest.approx(np.full(25, 0.04))
