"""Errors of sub-pixel displacements compared with the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from linescan_odometry.matching.subpixel import SubpixelRefiner

Expose = Callable[..., Any]
Profile = Callable[..., NDArray[np.float64]]


def refine(lines: Any, shift: int) -> tuple[float, float]:
    displacement, errors = SubpixelRefiner(lines.shape[1]).refine(lines, np.array([shift]))
    return float(displacement[0]), float(np.sum(errors**2))


def cramer_rao_bound(
    profile: Profile, start: float, pixels: int, shift: int, noise: float, grain: float
) -> float:
    """Return the smallest variance of the displacement between two noisy lines [px^2].

    Both lines are noisy and the texture is unknown, so the bound is twice that of a known texture.
    The gradient is that of the noise-free line over the overlap; quantization adds 1/12 to the
    noise.
    """
    step = 0.01
    behind, ahead = profile([start - step, start + step], pixels, grain=grain)
    gradient = ((ahead - behind) / (2.0 * step))[max(0, shift) : pixels - max(0, -shift)]
    return 2.0 * (noise**2 + 1.0 / 12.0) / float(np.sum(gradient**2))


def trial_errors(
    expose: Expose, profile: Profile, trials: int, pixels: int, noise: float, grain: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return errors [px], reported variances and bounds [px^2] of random displacements."""
    generator = np.random.default_rng(7)
    errors, variances, bounds = np.empty((3, trials))
    for i in range(trials):
        start, motion = generator.uniform(-3000.0, 6000.0), generator.uniform(-90.0, 90.0)
        shift = round(motion)
        lines = expose([start, start + motion], pixels, noise=noise, grain=grain, noise_seed=i)
        displacement, variances[i] = refine(lines, shift)
        errors[i] = displacement - motion
        bounds[i] = cramer_rao_bound(profile, start, pixels, shift, noise, grain)
    return errors, variances, bounds


@pytest.mark.parametrize("noise", [1.0, 2.0])
@pytest.mark.parametrize("grain", [1.0, 3.0])
def test_errors_are_near_the_bound(
    noise: float, grain: float, expose: Expose, profile: Profile
) -> None:
    errors, variances, bounds = trial_errors(expose, profile, 400, 1024, noise, grain)
    mean_square = np.mean(errors**2)
    assert np.sqrt(mean_square / np.mean(bounds)) <= 1.3
    # 400 trials scatter by 7 % in the mean square.
    assert abs(np.mean(errors)) < 4.0 * np.std(errors) / 20.0
    assert 0.75 < np.mean(variances) / mean_square < 1.35


@pytest.mark.parametrize("pixels", [335, 128])
def test_short_lines_are_near_the_bound(pixels: int, expose: Expose, profile: Profile) -> None:
    errors, _, bounds = trial_errors(expose, profile, 400, pixels, 2.0, 1.5)
    assert np.sqrt(np.mean(errors**2) / np.mean(bounds)) <= 1.3


@pytest.mark.parametrize("fraction", [-0.5, -0.3, -0.1, 0.0, 0.1, 0.25, 0.4, 0.5])
def test_no_fraction_is_preferred(fraction: float, expose: Expose) -> None:
    starts = np.linspace(-3000.0, 6000.0, 80)
    errors = np.array(
        [
            refine(expose([start, start + 20 + fraction], 1024, noise=2.0, noise_seed=i), 20)[0]
            - (20 + fraction)
            for i, start in enumerate(starts)
        ]
    )
    assert abs(errors.mean()) < 4.0 * errors.std() / np.sqrt(len(starts)) + 5e-4


def test_exchanging_the_lines_reverses_the_motion(expose: Expose) -> None:
    lines = expose([0.0, 12.3], 512)
    forth, variance_forth = refine(lines, 12)
    back, variance_back = refine(lines[::-1].copy(), -12)
    assert forth == pytest.approx(-back, abs=1e-5)
    assert variance_forth == pytest.approx(variance_back, rel=1e-3)


def test_a_start_half_a_pixel_off_converges_to_the_same_place(expose: Expose) -> None:
    lines = expose([0.0, 12.5], 1024)
    assert refine(lines, 12)[0] == pytest.approx(refine(lines, 13)[0], abs=2e-3)


def test_brightness_and_contrast_do_not_matter(expose: Expose) -> None:
    lines = expose([0.0, 12.3], 1024, noise=0.0, dtype=np.uint16)
    changed = lines.copy()
    changed[1] = lines[1] // 2 + 9000
    assert refine(changed, 12)[0] == pytest.approx(refine(lines, 12)[0], abs=1e-3)


def test_16_bits_beat_8_bits_on_weak_contrast(expose: Expose) -> None:
    fine = expose([0.0, 12.3], 1024, noise=0.0, grain=3.0, dtype=np.uint16)
    coarse = (fine // 2048).astype(np.uint8)  # 5 bits
    assert abs(refine(fine, 12)[0] - 12.3) < 0.1 * abs(refine(coarse, 12)[0] - 12.3)


def test_without_gradient_there_is_no_variance() -> None:
    generator = np.random.default_rng(8)
    lines = generator.integers(0, 256, (2, 256)).astype(np.uint8)
    lines[1] = 99
    assert refine(lines, 3) == (3.0, np.inf)
    lines[:] = np.add.outer([10, 20], np.repeat([0, 5, 0, 5], 64))  # the same steps, brighter
    displacement, variance = refine(lines, 0)
    assert displacement == pytest.approx(0.0, abs=1e-6)
    assert variance == pytest.approx(0.0, abs=1e-9)
