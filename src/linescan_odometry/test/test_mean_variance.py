"""The variance of a mean of displacements whose errors cancel, add up, or do neither."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from linescan_odometry.matching.mean_variance import Overlaps, mean_variance
from linescan_odometry.matching.subpixel import SubpixelRefiner
from omni_platform.quantities import FloatArray

Expose = Callable[..., Any]

PAIRS, BLOCKS, LENGTH = 25, 32, 1024


def judged(errors: FloatArray, gradient: FloatArray, drift: int) -> tuple[float, float]:
    """Return the error of a mean and its stated variance, as the refinement would see them.

    Args:
        errors: sum of (true error times slope) in each block of each pair, shape (m, blocks).
        gradient: energy of each block of ground, as many as the pairs see.
        drift: blocks by which the ground passes from pair to pair.
    """
    pairs, blocks = errors.shape
    sums = np.zeros((pairs, blocks, 4))
    displaced = np.empty(pairs)
    for i in range(pairs):
        sums[i, :, 3] = gradient[drift * i : drift * i + blocks]
        displaced[i] = -errors[i].sum() / sums[i, :, 3].sum()
        # What is left of e g where the fit has come to rest.
        sums[i, :, 2] = 2.0 * (errors[i] + displaced[i] * sums[i, :, 3])
    overlaps = Overlaps(
        sums, np.full(pairs, LENGTH), np.full(pairs, blocks), drift * np.arange(pairs)
    )
    variance = mean_variance(overlaps, np.full(pairs, 1.0 / pairs))
    return float(displaced.mean()), variance


def white(generator: np.random.Generator) -> FloatArray:
    return generator.standard_normal((PAIRS, BLOCKS))


def cancelling(generator: np.random.Generator) -> FloatArray:
    """Noise of the lines of a camera at rest: each enters two pairs, with opposite signs."""
    return np.diff(generator.standard_normal((PAIRS + 1, BLOCKS)), axis=0)


def persistent(generator: np.random.Generator) -> FloatArray:
    """Stones that spoil ten pairs one after another alike."""
    stones = generator.standard_normal((PAIRS + 9, BLOCKS))
    return np.array([stones[i : i + 10].sum(axis=0) for i in range(PAIRS)])


def neighboring(generator: np.random.Generator) -> FloatArray:
    """Errors that reach over two blocks."""
    wide = persistent(generator)
    return wide + np.roll(wide, 1, axis=1)


@pytest.mark.parametrize("errors", [white, cancelling, persistent, neighboring])
@pytest.mark.parametrize("even", [True, False])
def test_errors_squared_are_as_large_as_stated(
    errors: Callable[[np.random.Generator], FloatArray], even: bool
) -> None:
    generator = np.random.default_rng(3)
    ratios = np.empty(1500)
    for i in range(len(ratios)):
        gradient = np.ones(BLOCKS) if even else generator.gamma(2.0, 1.0, BLOCKS)
        noise = errors(generator) * np.sqrt(gradient)
        error, variance = judged(noise, gradient, 0)
        ratios[i] = error**2 / variance
    assert 0.8 < ratios.mean() < 1.25  # +- 0.05 by chance


def test_ground_that_passes_by_is_followed() -> None:
    generator = np.random.default_rng(4)
    ratios = np.empty((2, 600))
    for i in range(600):
        gradient = np.ones(BLOCKS + PAIRS)
        ground = 0.2 * generator.standard_normal(BLOCKS + PAIRS)  # wrong for as long as it is seen
        errors = np.array([ground[k : k + BLOCKS] for k in range(PAIRS)])
        errors += 0.1 * white(generator)
        error, variance = judged(errors, gradient, 1)
        ratios[0, i] = error**2 / variance
        # Not followed, the errors of one place look like those of many.
        sideways = np.array([np.roll(row, 7 * k) for k, row in enumerate(errors)])
        error, variance = judged(sideways, gradient, 0)
        ratios[1, i] = error**2 / variance
    assert 0.8 < ratios[0].mean() < 1.25
    assert ratios[1].mean() > 1.5


def test_one_block_that_holds_all_the_texture_gives_no_variance() -> None:
    generator = np.random.default_rng(5)
    gradient = np.full(BLOCKS, 1e-3)
    gradient[9] = 1.0
    errors = white(generator) * np.sqrt(gradient)
    _, variance = judged(errors, gradient, 0)
    assert np.isfinite(variance)
    assert variance > 0.0


@pytest.mark.parametrize("speed", [0.0, 0.3, 12.4, -70.2])
def test_straight_motion_is_stated_as_accurate_as_it_is(speed: float, expose: Expose) -> None:
    generator = np.random.default_rng(6)
    refiner = SubpixelRefiner(512, 4)
    ratios, cancelled = np.empty((2, 250))
    for i in range(len(ratios)):
        motion = speed * generator.uniform(0.9, 1.1)
        positions = generator.uniform(-1000.0, 3000.0) + motion * np.arange(26)
        lines = expose(positions, 512, noise=2.0, grain=2.0, noise_seed=i)
        displacement, variance = np.empty((2, 25))
        refiner.refine(lines, np.full(25, round(motion)), displacement, variance)
        weight = np.full(25, 0.04)
        stated = refiner.mean_variance(displacement, weight)
        ratios[i] = (displacement.mean() - motion) ** 2 / stated
        cancelled[i] = stated / (variance.mean() / 25)
    # The noise of the lines in between cancels, but for what one of two pairs does not see.
    assert cancelled.mean() < 0.1 + 3.0 * abs(speed) / 512
    # 250 trials scatter by 10 %. Fast motion is judged on the safe side.
    assert (0.7 if abs(speed) < 1.0 else 0.45) < ratios.mean() < 1.3


def test_pairs_left_out_count_neither_for_nor_against(expose: Expose) -> None:
    lines = expose(5.3 * np.arange(26), 512, noise=2.0)
    spoilt = lines.copy()
    spoilt[8] = expose([4000.0], 512)[0]
    weight = np.full(25, 1.0 / 23.0)
    weight[7:9] = 0.0
    stated = []
    for record in (lines, spoilt):
        refiner = SubpixelRefiner(512)
        displacement, variance = np.empty((2, 25))
        refiner.refine(record, np.full(25, 5), displacement, variance)
        stated.append(refiner.mean_variance(displacement, weight))
    assert stated[1] == pytest.approx(stated[0], rel=0.05)
