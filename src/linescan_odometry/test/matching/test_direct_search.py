"""Every metric finds the minima that scipy finds; window and prior follow the motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy  # loads scipy.stats at its first use
from scipy.spatial import distance

from linescan_odometry.configuration import METRIC_NAMES
from linescan_odometry.matching.search import METRICS, ShiftSearch, make_search
from linescan_odometry.matching.subpixel import SubpixelRefiner

Expose = Callable[..., Any]

DIRECT: dict[str, Callable[[Any, Any], float]] = {
    "pearson": distance.correlation,
    "cosine": distance.cosine,
    "euclidean": lambda x, y: distance.euclidean(x, y) / len(x),
    "squared_euclidean": lambda x, y: distance.sqeuclidean(x, y) / len(x),
    "manhattan": lambda x, y: distance.cityblock(x, y) / len(x),
    "spearman": lambda x, y: distance.correlation(*map(scipy.stats.rankdata, (x, y))),
}


def direct(metric: str, new: Any, old: Any, limit: int) -> int:
    """Evaluate the distance with scipy at every shift, over the part where the lines overlap."""
    n = len(new)
    best = (np.inf, 0)
    for s in sorted(range(-limit, limit + 1), key=abs):
        x = new[max(0, -s) : n - max(0, s)].astype(np.float64)
        y = old[max(0, s) : n - max(0, -s)].astype(np.float64)
        d = DIRECT[metric](x, y)
        if d < best[0] - 1e-12:
            best = (d, s)
    return best[1]


def search(finder: ShiftSearch, lines: Any) -> tuple[Any, Any]:
    shift = np.empty(len(lines) - 1, np.int64)
    similarity = np.empty(len(lines) - 1)
    finder.match(lines, shift, similarity)
    return shift, similarity


def test_every_metric_has_its_direct_evaluation() -> None:
    assert set(DIRECT) == set(METRICS) == set(METRIC_NAMES)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_shifts_are_those_of_a_direct_evaluation(metric: str, dtype: Any, expose: Expose) -> None:
    generator = np.random.default_rng(1)
    full = np.iinfo(dtype).max
    moving = expose(np.cumsum([0.0, 3.4, -20.7, 40.2]), 96, noise=5.0, dtype=dtype)
    coarse = (generator.integers(0, 4, (3, 75)) * (full // 3)).astype(dtype)  # many ties
    random = generator.integers(0, full, (4, 61), endpoint=True).astype(dtype)
    for lines in (moving, coarse, random):
        pixels = lines.shape[1]
        shift, similarity = search(METRICS[metric](pixels // 2), lines)
        for i, s in enumerate(shift):
            assert s == direct(metric, lines[i + 1], lines[i], pixels // 2)
            x = lines[i + 1, max(0, -s) : pixels - max(0, s)].astype(np.float64)
            y = lines[i, max(0, s) : pixels - max(0, -s)].astype(np.float64)
            assert similarity[i] == pytest.approx(1.0 - distance.correlation(x, y), abs=1e-12)


@pytest.mark.parametrize("metric", METRICS)
def test_refined_shifts_are_the_same_for_every_metric(metric: str, expose: Expose) -> None:
    lines = expose([0.0, 31.3, 57.7, -10.05], 256, noise=1.0)
    shift, _ = search(METRICS[metric](128), lines)
    displacement, _ = SubpixelRefiner(256).refine(lines, shift)
    assert displacement == pytest.approx([31.3, 26.4, -67.75], abs=0.02)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("level", [0, 9])
def test_constant_lines_have_no_match(metric: str, level: int) -> None:
    shift, similarity = search(METRICS[metric](32), np.full((3, 64), level, np.uint8))
    assert shift.tolist() == [0, 0]
    assert similarity.tolist() == [-1.0, -1.0]


@pytest.mark.parametrize(
    ("metric", "tolerant"),
    [("pearson", True), ("spearman", True), ("manhattan", False), ("squared_euclidean", False)],
)
def test_an_offset_of_brightness_misleads_plain_differences(
    metric: str, tolerant: bool, expose: Expose
) -> None:
    lines = (expose(29.0 * np.arange(40), 256, grain=20.0) // 3 + 50).astype(np.uint8)
    lines[1::2] += 30
    shift, _ = search(METRICS[metric](128), lines)
    assert bool(np.all(np.abs(shift - 29) <= 1)) == tolerant


@pytest.mark.parametrize("metric", METRICS)
def test_a_window_that_follows_finds_what_the_full_search_finds(
    metric: str, expose: Expose
) -> None:
    lines = expose(np.cumsum(np.linspace(-30.0, 30.0, 30)), 128)
    lines[12:] = expose(np.cumsum(np.full(18, 5.0)), 128, seed=3)  # a pair without a match
    lines[20:] = expose(2000.0 + np.cumsum(np.full(10, -40.0)), 128)  # and a jump of speed
    window = search(make_search(metric, 64, 6), lines)[0]
    full = search(METRICS[metric](64), lines)[0]
    matched = np.delete(np.arange(29), [11, 19])
    assert window[matched].tolist() == full[matched].tolist()


def test_a_window_does_not_depend_on_batches(expose: Expose) -> None:
    lines = expose(np.cumsum(np.linspace(-30.0, 30.0, 30)), 128)
    at_once = search(make_search("manhattan", 64, 4, 0.5), lines)[0]
    in_parts = make_search("manhattan", 64, 4, 0.5)
    found = [search(in_parts, lines[i : i + 2])[0][0] for i in range(29)]
    assert at_once.tolist() == found


def test_a_window_is_what_is_searched(expose: Expose) -> None:
    # Period 16: shifts of 21 and 5 match equally well, and only the window is unambiguous.
    texture = np.tile(expose([0.0], 16, noise=0.0)[0], 40)
    lines = np.stack([texture[s : s + 160] for s in (0, 21, 42)])
    finder = make_search("pearson", 80, 4)
    unique = expose([0.0, 21.0], 160)
    assert search(finder, unique)[0].tolist() == [21]
    assert search(finder, lines)[0].tolist() == [21, 21]
    finder.reset()
    assert search(finder, lines)[0].tolist() == [5, 5]


@pytest.mark.parametrize("metric", METRICS)
def test_a_prior_decides_between_like_matches(metric: str, expose: Expose) -> None:
    texture = np.tile(expose([0.0], 16, noise=0.0)[0], 40)
    noise = np.random.default_rng(5).integers(0, 3, (3, 160))
    lines = (np.stack([texture[s : s + 160] for s in (0, 21, 42)]) + noise).astype(np.uint8)
    finder = make_search(metric, 80, 0, 10.0)
    assert search(finder, expose([0.0, 21.0], 160))[0].tolist() == [21]
    assert search(finder, lines)[0].tolist() == [21, 21]
