"""Details that a bar of shadow and the ground share from line to line."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.joint import details

LINES, PIXELS = 26, 1024
GROUND, SHADOW = 2.0, -1.0  # displacement per line [px]


def _texture(shift: NDArray[Any], longest: float) -> NDArray[Any]:
    """Return ground with waves of at least half of `longest` [px], shape (lines, pixels)."""
    generator = np.random.default_rng(3)
    place = np.arange(PIXELS) + shift[:, None]
    waves = zip(generator.uniform(0.5, 1.0, 60), generator.uniform(0.0, 7.0, 60), strict=True)
    return np.asarray(
        sum(0.005 * np.cos(2.0 * math.pi * place / (longest * w) + p) for w, p in waves)
    )


def _bar(center: NDArray[Any]) -> NDArray[Any]:
    """Return the logarithm of a bar of shadow, 150 px wide, shape (lines, pixels)."""
    place = np.arange(PIXELS) - center[:, None]
    return np.asarray(-0.4 * (np.tanh((place + 75.0) / 8.0) - np.tanh((place - 75.0) / 8.0)) / 2.0)


def _lines(longest: float) -> NDArray[Any]:
    kappa = np.arange(LINES) - 0.5 * (LINES - 1)
    noise = np.random.default_rng(5).normal(0.0, 0.01, (LINES, PIXELS))
    logs = _texture(-GROUND * kappa, longest) + _bar(400.0 + SHADOW * kappa) + noise
    return np.asarray(details.limited(logs.astype(np.float32)))


def test_distant_lines_separate_long_details_of_the_ground_from_a_bar_of_shadow() -> None:
    lines, shadow = _lines(60.0), np.array([-SHADOW, 0.0])
    assert min(details.spread(lines, shadow, 1, 8)) > 3.0
    number, others = details.spread(lines, shadow, 4, 8)
    assert number < 7.5
    assert others < 3.0


def test_the_ground_beside_a_bar_of_shadow_moves_on() -> None:
    number, others = details.spread(_lines(60.0), np.array([-GROUND, 0.0]), 4, 8)
    assert number > 7.5
    assert others > 3.0
