"""What stands still in the view is taken off before the flat field knows it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from linescan_odometry.view.still import StillView, without_defects

Expose = Callable[..., Any]

PIXELS = 256
STEPS = 6.0 * (np.arange(PIXELS) * 8 // PIXELS % 2)  # of the dark signal of eight amplifiers


def faint(expose: Expose, positions: Any, seed: int, pattern: Any = 0.0) -> Any:
    """Expose a coarse ground of weak contrast by pixels with a pattern of their own."""
    lines = expose(positions, PIXELS, grain=8.0, noise=0.0)
    noise = np.random.default_rng(seed).standard_normal(lines.shape)
    gray = 120.0 + 0.15 * (lines.astype(np.float64) - 128.0) + pattern + noise
    return np.rint(gray).clip(0, 255).astype(np.uint8)


def test_the_mean_of_moving_lines_becomes_the_pattern(expose: Expose) -> None:
    still = StillView(PIXELS)
    for i in range(20):
        still.learn(faint(expose, -3000.0 + 15.0 * (25 * i + np.arange(25)), i, STEPS))
    assert still.weight > 5.0
    rest = still.without(np.full((2, PIXELS), 120, np.uint8)).astype(np.float64)
    # Lines without the pattern show it with the opposite sign.
    assert np.corrcoef(rest.mean(axis=0), STEPS)[0, 1] < -0.8


def test_nothing_is_learned_at_rest(expose: Expose) -> None:
    still = StillView(PIXELS)
    for i in range(10):
        still.learn(faint(expose, np.zeros(25), i))
    assert still.weight == 0.0


def test_defective_pixels_are_interpolated_and_only_they(expose: Expose) -> None:
    sound = faint(expose, 7.0 * np.arange(26), 3)
    assert without_defects(sound) is sound
    broken = sound.copy()
    broken[:, 40], broken[:, 100], broken[:, 101] = 0, 255, 200
    mended = without_defects(broken)
    assert np.abs(mended.astype(int) - sound)[:, [40, 100, 101]].max() < 30
    others = np.setdiff1d(np.arange(PIXELS), [40, 100, 101])
    assert np.array_equal(mended[:, others], sound[:, others])
    assert broken[0, 40] == 0  # the camera's own memory is left alone
