"""The full search finds the same shift as a direct evaluation of the definition."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import correlation

from linescan_odometry.matching.search import METRICS

Expose = Callable[..., Any]


def direct(new: Any, old: Any, limit: int) -> tuple[int, float]:
    """Evaluate Eq. (81) with scipy at every shift, over the part where the lines overlap."""
    n = len(new)
    best = (0, -1.0)
    for s in sorted(range(-limit, limit + 1), key=abs):
        x = new[max(0, -s) : n - max(0, s)].astype(np.float64)
        y = old[max(0, s) : n - max(0, -s)].astype(np.float64)
        if np.ptp(x) > 0 and np.ptp(y) > 0:
            r = 1.0 - float(correlation(x, y))
            if r > best[1] + 1e-12:
                best = (s, r)
    return best


def search(lines: Any, limit: int) -> tuple[Any, Any]:
    shift = np.empty(len(lines) - 1, np.int64)
    similarity = np.empty(len(lines) - 1)
    METRICS["pearson"](limit).match(lines, shift, similarity)
    return shift, similarity


def assert_is_direct(lines: Any, limit: int) -> None:
    shift, similarity = search(lines, limit)
    for i in range(len(shift)):
        expected_shift, expected_r = direct(lines[i + 1], lines[i], limit)
        assert shift[i] == expected_shift
        assert similarity[i] == pytest.approx(expected_r, abs=1e-9)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("pixels", "divisor"), [(1024, 2), (335, 2), (128, 2), (101, 3)])
def test_random_lines_match_direct_evaluation(dtype: Any, pixels: int, divisor: int) -> None:
    generator = np.random.default_rng(pixels)
    full = np.iinfo(dtype).max
    lines = generator.integers(0, full, (5, pixels), endpoint=True).astype(dtype)
    assert_is_direct(lines, pixels // divisor)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_moving_lines_match_direct_evaluation(dtype: Any, expose: Expose) -> None:
    positions = np.cumsum([0.0, 3.4, -20.7, 60.2, 0.1, -64.0])
    assert_is_direct(expose(positions, 128, grain=3.0, noise=5.0, dtype=dtype), 64)


def test_weak_contrast_on_a_bright_background_keeps_16_bits() -> None:
    lines = 65530 + np.random.default_rng(3).integers(0, 5, (4, 256))
    assert_is_direct(lines.astype(np.uint16), 128)


def test_uneven_lines_match_direct_evaluation() -> None:
    # One bright part dominates the sums, the others determine the match. Rounding would decide.
    generator = np.random.default_rng(4)
    lines = generator.integers(100, 104, (6, 300))
    lines[:, 200:] += generator.integers(0, 60000, (6, 100))
    lines[3:, :150] = 7
    assert_is_direct(lines.astype(np.uint16), 150)


def test_black_and_white_lines_match_direct_evaluation() -> None:
    lines = 65535 * np.random.default_rng(5).integers(0, 2, (2, 4096))
    assert_is_direct(lines.astype(np.uint16), 40)


def test_longer_overlap_wins_at_equal_correlation() -> None:
    period = np.tile(np.array([0, 50, 200, 90], np.uint8), 32)
    shift, similarity = search(np.stack((period, np.roll(period, -1))), 64)
    assert shift[0] == 1  # 5, 9, -3, ... match as perfectly
    assert similarity[0] == pytest.approx(1.0, abs=1e-12)


def test_a_negative_correlation_counts_before_none() -> None:
    # Toward negative shifts the overlap of one line is constant, and the spikes never meet.
    lines = np.zeros((2, 128), np.uint8)
    lines[0, 127] = lines[1, 0] = 200
    assert_is_direct(lines, 64)


@pytest.mark.parametrize("level", [0, 7, 255])
def test_constant_lines_have_no_correlation(level: int) -> None:
    lines = np.random.default_rng(6).integers(0, 256, (4, 128)).astype(np.uint8)
    lines[1:3] = level
    shift, similarity = search(lines, 64)
    assert shift.tolist() == [0, 0, 0]
    assert similarity.tolist() == [-1.0, -1.0, -1.0]


def test_brightness_and_contrast_do_not_matter(expose: Expose) -> None:
    lines = expose([0.0, 37.0], 256, noise=1.0)
    changed = lines.copy()
    changed[1] = lines[1] // 2 + 100
    assert search(changed, 128)[0][0] == search(lines, 128)[0][0] == 37


@pytest.mark.parametrize("shift", [-512, -511, 511, 512])
def test_straight_motion_is_found_up_to_the_limit(shift: int, expose: Expose) -> None:
    found, similarity = search(expose([0.0, float(shift)], 1024, noise=2.0), 512)
    assert found[0] == shift
    assert similarity[0] > 0.9


def test_long_batches_equal_pair_by_pair(expose: Expose) -> None:
    lines = expose(np.cumsum(np.linspace(-30.0, 30.0, 80)), 128)
    shift, similarity = search(lines, 64)
    for i in range(len(shift)):
        single_shift, single_similarity = search(lines[i : i + 2], 64)
        assert (shift[i], similarity[i]) == (single_shift[0], single_similarity[0])
