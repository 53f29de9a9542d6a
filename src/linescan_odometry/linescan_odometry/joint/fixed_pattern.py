"""Defective pixels of a camera, and its fixed pattern, estimated together with the displacement.

The optics blur every detail of the ground over several pixels. If a pixel differs from its
neighbors both in the mean of a batch and in each line, it is defective, or a speck of dirt covers
it. Such pixels are interpolated. At rest, some sharp features of the ground may also be
interpolated; the test of rest therefore uses the recorded pixels.

The fixed pattern consists of dirt, unequal pixels, shading and mud, which change every line in the
same way. For a given displacement, the posterior of the pattern is Gaussian at every frequency.
Earlier batches and the present one are weighted by their information. The prior variance is the
power of the estimated pattern (empirical Bayes), so a camera without dirt loses little information.
Before candidates for the displacement are compared, the posterior mean of the pattern is subtracted
from the lines. This mean is shrunk toward zero at frequencies where it consists mostly of errors.

In shapes, m is the number of lines, and F the number of spatial frequencies.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.joint import spectra
from omni_platform.kernels import kernel, linked
from omni_platform.signals import Lines

FEWEST_LINES = 8
"""Minimum number of lines for the estimation of a fixed pattern."""

# Smallest difference of a defective pixel from its neighbors, as a multiple of the median
# difference of all pixels [1]: about 6 standard deviations.
_OUTSTANDING = 9.0


class FixedPattern(NamedTuple):
    """Estimated fixed pattern of a camera: spectrum of the logarithm of the pixel gains.

    Attributes:
        information: precision times mean of the spectrum at each frequency, shape (F,).
        precision: precision of this mean at each frequency, 0 without information, shape (F,).
    """

    information: spectra.Spectrum
    precision: spectra.Doubles

    def deviation(self, pixels: int) -> float:
        """Return the standard deviation of the pixel gains, relative to their mean [1].

        The argument `pixels` is the number of pixels of a line.
        """
        power = np.abs(shrink(self.information, self.precision)) ** 2
        size = len(power) / spectra.HIGHEST
        return math.sqrt(2.0 * float(power.sum()) / (pixels * size))  # by Parseval's theorem


@kernel
def _power(mean: spectra.Spectrum, precision: spectra.Doubles) -> spectra.Doubles:
    """Return the power of a pattern minus the power of its estimation error, shape (F,).

    Where the difference would be negative, the power is 0.

    Args:
        mean: estimated spectrum of the pattern at each frequency, shape (F,).
        precision: precision of the estimate, 0 without information, shape (F,).
    """
    excess = np.zeros(len(precision))
    for f in range(len(precision)):
        if precision[f] > 0.0:
            square = mean[f].real * mean[f].real + mean[f].imag * mean[f].imag
            excess[f] = square - 1.0 / precision[f]
    power: spectra.Doubles = np.maximum(spectra.smoothed(excess), 0.0)
    return power


@linked
@kernel
def shrink(information: spectra.Spectrum, precision: spectra.Doubles) -> spectra.Spectrum:
    """Return the mean of a pattern, reduced at frequencies where it is mostly noise, shape (F,).

    Args:
        information: precision times mean, shape (F,).
        precision: precision at each frequency, 0 without information, shape (F,).
    """
    mean = posterior(information, precision)
    gain = _power(mean, precision) * precision
    shrunk: spectra.Spectrum = mean * (gain / (gain + 1.0)).astype(np.float32)
    return shrunk


@linked
@kernel
def prior(information: spectra.Spectrum, precision: spectra.Doubles) -> spectra.Doubles:
    """Return the prior precision of a pattern from its power (empirical Bayes), shape (F,).

    If the power is not significant, the precision is infinite: the pattern is assumed to be 0. A
    pattern that absorbs part of the ground texture would bias slow displacements away from 0.

    Args:
        information: precision times mean, shape (F,).
        precision: precision at each frequency, 0 without information, shape (F,).
    """
    power = _power(posterior(information, precision), precision)
    result = np.full(len(power), math.inf)
    for f in range(len(power)):
        if power[f] > 0.0:
            result[f] = 1.0 / power[f]
    return result


@linked
@kernel
def posterior(information: spectra.Spectrum, precision: spectra.Doubles) -> spectra.Spectrum:
    """Return the posterior mean of a pattern, which is 0 without information, shape (F,)."""
    mean = np.zeros(len(precision), np.complex64)
    for f in range(len(precision)):
        if precision[f] > 0.0:
            mean[f] = information[f] / np.float32(precision[f])
    return mean


@linked
@kernel
def observe(
    transformed: spectra.Spectrum, removed: spectra.Spectrum, paths: spectra.Doubles, size: int
) -> tuple[spectra.Spectrum, spectra.Doubles]:
    """Return the pattern estimated from one batch with known displacements.

    Args:
        transformed: spectra of the logarithm of whole lines, shape (m, F).
        removed: pattern to subtract before the covariance is estimated, shape (F,).
        paths: displacement of each line [px], shape (m,).
        size: length of the Fourier transform [px].

    Returns:
        Information (precision times mean) and precision at each frequency, shape (F,) each.
    """
    m, count = transformed.shape
    turn, edges = spectra.phases(paths, size, count), spectra.bands(size)
    white = (transformed - removed) * turn
    model, _ = spectra.covariance(white, np.array([0, m]), edges, np.zeros(count))
    spectra.whiten(turn, edges, model, white)
    information, precision = np.zeros(count, np.complex64), np.zeros(count, np.float32)
    white[:, : edges[0]] = 0.0
    for k in range(m):
        row, own, seen = white[k], turn[k], transformed[k]
        for f in range(count):
            information[f] += np.conj(row[f]) * own[f] * seen[f]
        for f in range(count):
            precision[f] += row[f].real * own[f].real + row[f].imag * own[f].imag
    return information, precision.astype(np.float64)


@kernel
def _defects(lines: Lines) -> NDArray[np.int64]:
    """Return the indices of the defective pixels, shape (d,), in lines of shape (m, n).

    A defective pixel differs from the median of the pixels within 2 px. The difference is large in
    the mean over all lines, and has the same sign in this mean and in every line.
    """
    m, n = lines.shape
    mean = np.zeros(n, np.float32)
    for k in range(m):
        for i in range(n):
            mean[i] += lines[k, i]
    mean /= np.float32(m)
    excess = np.empty(n, np.float32)
    for i in range(n):
        a, b = mean[max(i - 2, 0)], mean[max(i - 1, 0)]
        c, d = mean[min(i + 1, n - 1)], mean[min(i + 2, n - 1)]
        low, high = max(min(a, b), min(c, d)), min(max(a, b), max(c, d))
        excess[i] = mean[i] - min(max(mean[i], min(low, high)), max(low, high))
    deviation = np.abs(excess)
    limit = max(_OUTSTANDING * np.median(deviation), 1.0)
    defective = deviation > limit
    for pixel in np.flatnonzero(defective):
        for line in lines:
            value, beyond = line[pixel], 0  # neighbors from which the pixel differs
            for j in range(pixel - 2, pixel + 3):
                near = line[min(max(j, 0), n - 1)]
                beyond += value > near if excess[pixel] > 0.0 else value < near
            if beyond < 3:  # of five pixels, so the median does not differ
                defective[pixel] = False
                break
    found: NDArray[np.int64] = np.flatnonzero(defective)
    return found


def without_defects(lines: Lines) -> Lines:
    """Return the lines with interpolated defective pixels; without defects, the lines themselves.

    Args:
        lines: consecutive lines, shape (m, n).
    """
    if len(lines) < FEWEST_LINES:
        return lines
    pixels = lines.shape[1]
    defective = _defects(lines)
    if len(defective) == 0:
        return lines
    sound = np.setdiff1d(np.arange(pixels), defective, assume_unique=True)
    after = np.searchsorted(sound, defective).clip(1, len(sound) - 1)
    left, right = sound[after - 1], sound[after]
    share = ((defective - left) / (right - left)).clip(0.0, 1.0).astype(np.float32)
    repaired: Lines = lines.copy()
    between = (1.0 - share) * lines[:, left] + share * lines[:, right]
    repaired[:, defective] = np.rint(between).astype(lines.dtype)
    return repaired
