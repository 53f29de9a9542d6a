"""Loss of the texture that lines have in common, as motion across the axis replaces it."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from linescan_odometry.joint import candidates, spectra
from linescan_odometry.joint.likelihood import window

LINES, PIXELS, COVERED = 26, 1024, 40  # COVERED: rows of the ground in the width of a pixel
LAYOUT = candidates.Layout(LINES, PIXELS, 2 * PIXELS, PIXELS // 2)


def decay_of(lines: NDArray[np.float64], displacement: float) -> tuple[float, float]:
    """Return the kept share of texture and its standard deviation, at a distance of 8 lines."""
    transformed = spectra.spectra_of(lines.astype(np.float32), window(PIXELS), LAYOUT.size)
    rest = candidates.correlate(transformed, np.zeros_like(transformed[0]))
    found = candidates.decay(rest, LAYOUT, displacement)
    assert found.lines in (0, 8)
    return found.kept, float(np.sqrt(found.variance))


def passing(step: int, shift: int, noise: float, oblique: bool = False) -> NDArray[np.float64]:
    """Return lines that move over a ground by `step` rows and `shift` pixels per line."""
    generator = np.random.default_rng(step)
    count = COVERED + step * LINES
    ground = generator.normal(0.0, 1.0, (count, PIXELS + shift * LINES))
    if oblique:
        ground[:] = ground[0]
    ground = gaussian_filter1d(ground, 3.0, axis=1)
    mean = np.array([ground[step * k :][:COVERED].mean(axis=0) for k in range(LINES)])
    mean /= mean.std()
    lines = np.array([mean[k, shift * k :][:PIXELS] for k in range(LINES)])
    return lines + generator.normal(0.0, noise, lines.shape)


@pytest.mark.parametrize("noise", [0.1, 1.0])
@pytest.mark.parametrize(("step", "shift"), [(1, 0), (2, 5), (4, 0), (4, 20)])
def test_ordinary_texture_leaves_the_view_with_the_motion_across(
    step: int, shift: int, noise: float
) -> None:
    kept, deviation = decay_of(passing(step, shift, noise), float(shift))
    expected = (1.0 - 8.0 * step / COVERED) / (1.0 - step / COVERED)
    assert deviation < 0.1
    assert kept == pytest.approx(expected, abs=0.1 + 3.0 * deviation)


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_oblique_texture_moves_on_in_the_view(noise: float) -> None:
    kept, deviation = decay_of(passing(2, 5, noise, oblique=True), 5.0)
    assert kept == pytest.approx(1.0, abs=0.05 + 3.0 * deviation)


def test_lines_of_noise_determine_no_share() -> None:
    lines = np.random.default_rng(3).normal(0.0, 1.0, (LINES, PIXELS))
    assert decay_of(lines, 1.0)[1] > 1.0


@pytest.mark.parametrize("lines", [2, 9, 25, 26, 27, 51])
def test_line_spacings_are_at_most_a_third_of_the_lines(lines: int) -> None:
    distances = candidates.spacings(lines)
    assert distances[0] == 1
    assert np.all(np.diff(distances) >= 0)
    assert distances[-1] == max(1, lines // 3)
