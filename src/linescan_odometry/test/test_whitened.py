"""All lines of a batch matched by their spectra: strong slanted edges, weak detail, specks."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from linescan_odometry.matching.whitened import WhitenedMatcher

PIXELS = 512
LINES = 26
STEP = 3  # rows of ground per line, across the axis
WIDTH = 15  # rows of ground that a line sees


def sideways(
    along: int,
    seed: int,
    *,
    edge: float = 0.0,
    specks: float = 0.0,
    noise: float = 0.5,
) -> NDArray[np.uint8]:
    """Return lines of a camera that moves across its axis, and by whole pixels along it.

    Args:
        along: displacement per line [px].
        seed: of the ground.
        edge: gray levels of an oblique edge, by a pixel per line.
        specks: deviation of what stands still in the view, in gray levels.
        noise: of the camera, in gray levels.
    """
    generator = np.random.default_rng(seed)
    rows, columns = STEP * LINES + WIDTH, PIXELS + abs(along) * LINES + 64
    ground = gaussian_filter(generator.standard_normal((rows, columns)), (1.5, 2.0))
    ground *= 12.0 / ground.std()
    place = np.arange(columns)[None, :] - np.arange(rows)[:, None] / STEP
    ground = ground + edge * (1.0 / (1.0 + np.exp(-(place - 0.5 * columns) / 2.0)))
    lines = np.empty((LINES, PIXELS))
    for i in range(LINES):
        first = along * i if along >= 0 else along * i - along * LINES
        view = ground[STEP * i : STEP * i + WIDTH, first : first + PIXELS]
        lines[i] = view.mean(axis=0)
    lines += specks * generator.standard_normal(PIXELS)
    lines += 100.0 + noise * generator.standard_normal(lines.shape)
    return np.rint(lines).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("along", [0, 3, -7])
def test_a_slanted_edge_does_not_pull(along: int) -> None:
    """The edge, stronger than all else in the view, runs by a pixel per line."""
    matcher = WhitenedMatcher(PIXELS, PIXELS // 2)
    for seed in range(6):
        found = matcher.match(sideways(along, seed, edge=60.0), settled=True)
        assert found is not None
        assert found.lone
        assert abs(found.displacement - along) < 0.3


def test_the_variance_is_that_of_the_errors() -> None:
    matcher = WhitenedMatcher(PIXELS, PIXELS // 2)
    score = []
    for seed in range(60):
        found = matcher.match(sideways(2, seed), settled=True)
        assert found is not None
        score.append((found.displacement - 2.0) ** 2 / found.variance)
    assert 0.4 < np.mean(score) < 1.6


def test_what_stands_still_is_taken_off_until_it_is_known() -> None:
    matcher = WhitenedMatcher(PIXELS, PIXELS // 2)
    lines = sideways(16, 1, specks=2.0)
    still = matcher.match(lines, settled=True)
    moving = matcher.match(lines, settled=False)
    assert still is not None
    assert moving is not None
    assert abs(moving.displacement - 16.0) < 0.5
    assert still.displacement < moving.displacement or abs(still.displacement - 16.0) < 0.5


def test_a_view_that_moves_on_loses_its_coherence() -> None:
    matcher = WhitenedMatcher(PIXELS, PIXELS // 2)
    across = matcher.match(sideways(0, 3), settled=True)
    at_rest = matcher.match(np.repeat(sideways(0, 3)[:1], LINES, axis=0), settled=True)
    assert across is not None
    assert across.lasting < 0.3
    assert at_rest is not None
    assert at_rest.lasting == pytest.approx(1.0, abs=0.01)


def test_a_few_lines_give_no_displacement() -> None:
    assert WhitenedMatcher(PIXELS, 256).match(sideways(0, 1)[:6], settled=True) is None


@pytest.mark.parametrize("along", [5.5, -5.5, 19.5])
def test_the_overlap_that_falls_as_lines_shift_does_not_pull(along: float) -> None:
    """Few pixels over red ground: what the window makes of it pulled by 0.013 px to zero."""
    pixels = 128
    matcher = WhitenedMatcher(pixels, pixels // 2)
    generator = np.random.default_rng(1)
    share = np.fft.rfftfreq(4096)
    shape = np.exp(-0.5 * (np.pi * share) ** 2) / np.sqrt(np.maximum(share, 0.005))
    off = []
    for _ in range(20):
        ground = np.fft.rfft(generator.standard_normal(4096)) * shape
        moved = np.exp(2j * np.pi * along * share * np.arange(40)[:, None])
        lines = np.fft.irfft(ground * moved, axis=1)[:, 1000 : 1000 + pixels]
        lines = 128.0 + 20.0 * lines / lines.std() + generator.standard_normal(lines.shape)
        found = matcher.match(np.rint(lines).clip(0, 255).astype(np.uint8), settled=True)
        assert found is not None
        off.append((found.displacement - along) * np.sign(along))
        assert off[-1] ** 2 < 16.0 * found.variance
    assert abs(np.mean(off)) < 0.003
