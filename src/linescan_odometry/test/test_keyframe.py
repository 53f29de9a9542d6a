"""Texture that lines have in common, as motion across the axis replaces it."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from linescan_odometry.keyframe import Keyframe
from linescan_odometry.measurements import Decay

PIXELS, COVERED = 1024, 40  # COVERED: rows of the ground in the width of a pixel
BATCH, PERIOD_NS = 25, 400_000


def passing(
    step: int, shift: int, noise: float, *, oblique: bool = False, batches: int = 3
) -> NDArray[np.float64]:
    """Return lines that move over a ground by `step` rows and `shift` pixels per line."""
    generator, lines = np.random.default_rng(step), 1 + BATCH * batches
    ground = generator.normal(0.0, 1.0, (COVERED + step * lines, PIXELS + shift * lines))
    if oblique:
        ground[:] = ground[0]
    ground = gaussian_filter1d(ground, 3.0, axis=1)
    mean = np.array([ground[step * k :][:COVERED].mean(axis=0) for k in range(lines)])
    mean /= mean.std()
    seen = np.array([mean[k, shift * k :][:PIXELS] for k in range(lines)])
    return seen + generator.normal(0.0, noise, seen.shape)


def decays_of(lines: NDArray[np.float64], shift: float) -> list[tuple[Decay, ...]]:
    """Return the decays of successive batches."""
    keyframe = Keyframe(PIXELS)
    return [
        keyframe.compare(
            end * PERIOD_NS, PERIOD_NS, lines[end - BATCH : end + 1].astype(np.float32), shift
        )
        for end in range(BATCH, len(lines), BATCH)
    ]


def share_of(distances: NDArray[np.int64], step: int) -> float:
    """Return the mean share of the rows that lines at these distances have in common."""
    return float(np.maximum(1.0 - np.abs(distances) * step / COVERED, 0.0).mean())


def expected(step: int, count: int, distance: int) -> float:
    """Return the share that means of `count` lines at a distance keep of their common texture."""
    apart = np.subtract.outer(np.arange(count), np.arange(count))
    return share_of(distance + apart, step) / share_of(apart[::2, 1::2], step)


@pytest.mark.parametrize("noise", [0.1, 1.0])
@pytest.mark.parametrize(("step", "shift"), [(1, 0), (1, 5), (2, 5), (4, 0), (4, 15), (8, 2)])
def test_ordinary_texture_leaves_the_view_with_the_motion_across(
    step: int, shift: int, noise: float
) -> None:
    decays = decays_of(passing(step, shift, noise), float(shift))
    for which, (count, distance) in enumerate([(3, 3), (13, 13), (13, BATCH)]):
        found = [batch[which] for batch in decays if which < len(batch)]
        assert found
        assert found[0].age == pytest.approx(1e-9 * distance * PERIOD_NS)
        for decay in found if distance < BATCH else found[:1]:
            error = 0.05 + 4.0 * np.sqrt(decay.variance)
            assert error < 1.0
            share = expected(step, count, distance)
            assert decay.least - error < share < decay.most + error
            assert decay.most - decay.least < error


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_oblique_texture_moves_on_in_the_view(noise: float) -> None:
    for decays in decays_of(passing(2, 5, noise, oblique=True), 5.0):
        for decay in decays:
            error = 0.05 + 3.0 * np.sqrt(decay.variance)
            assert decay.least - error < 1.0 < decay.most + error
            assert decay.most - decay.least < error


@pytest.mark.parametrize("shift", [2, 4, 8])
def test_a_fixed_pattern_is_no_texture_that_has_left(shift: int) -> None:
    """Over stripes that never leave, a pattern moves against the texture and looks like a loss."""
    generator = np.random.default_rng(3)
    pattern = gaussian_filter1d(generator.normal(0.0, 1.0, PIXELS), 0.5)
    lines = passing(2, shift, 0.1, oblique=True) + pattern / pattern.std()
    for decays in decays_of(lines, float(shift))[1:]:
        for decay in decays[1:]:
            assert decay.shifted
            error = 0.05 + 3.0 * np.sqrt(decay.variance)
            assert decay.least - error < 1.0 < decay.most + error


@pytest.mark.parametrize("noise", [0.1, 0.5])
@pytest.mark.parametrize("blur", [1, 25, 60, 150])
def test_the_spectrum_of_stripes_limits_their_blur(blur: int, noise: float) -> None:
    """A blur that is finer than the details or the spectral resolution is not noticed."""
    generator, limits = np.random.default_rng(3), []
    for _ in range(9):
        details = gaussian_filter1d(generator.normal(0.0, 1.0, 3 * PIXELS), 3.0)
        line = uniform_filter1d(details, blur)[PIXELS:]
        lines = np.array([line[5 * k :][:PIXELS] for k in range(1 + 2 * BATCH)]) / line.std()
        lines += generator.normal(0.0, noise, lines.shape)
        limits.append(decays_of(lines, 5.0)[-1][-1].blur)
    assert 0.7 * blur < np.median(limits) < blur + 60.0


def test_lines_of_noise_determine_no_share() -> None:
    lines = np.random.default_rng(3).normal(0.0, 1.0, (1 + 2 * BATCH, PIXELS))
    found = [decay for decays in decays_of(lines, 1.0) for decay in decays]
    assert all(decay.variance > 0.2 and decay.blur == np.inf for decay in found)


@pytest.mark.parametrize("count", range(4, 30))
def test_any_number_of_lines_is_compared(count: int) -> None:
    lines = passing(1, 1, 0.1)[:count].astype(np.float32)
    for decay in Keyframe(PIXELS).compare(10**9, PERIOD_NS, lines, 1.0):
        assert np.isfinite(decay[:-1]).all()


@pytest.mark.parametrize(("lines", "shift"), [(3, 1.0), (26, 600.0)])
def test_too_few_lines_with_common_ground_are_not_compared(lines: int, shift: float) -> None:
    seen = np.zeros((lines, PIXELS), np.float32)
    assert Keyframe(PIXELS).compare(10**9, PERIOD_NS, seen, shift) == ()
