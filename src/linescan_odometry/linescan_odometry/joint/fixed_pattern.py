"""Fixed pattern of a camera, estimated together with the displacement.

The fixed pattern consists of dirt, unequal pixels, shading and mud, which change every line in the
same way. For a given displacement, its posterior is Gaussian at every frequency. Earlier batches
and the present one are weighted by their information. The prior variance is the power of the
estimated pattern (empirical Bayes), so a camera without dirt loses little information. Candidates
for the displacement are compared after subtraction of a shrunk mean, which is small where the
estimate consists mostly of errors.

In shapes, m is the number of lines, and F the number of spatial frequencies.
"""

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint import spectra
from omni_platform.kernels import kernel


class FixedPattern(NamedTuple):
    """Estimated fixed pattern of a camera, as the logarithm of the gains.

    Attributes:
        information: precision times mean of each frequency, shape (F,).
        precision: precision at each frequency, 0 without information, shape (F,).
    """

    information: spectra.Spectrum
    precision: spectra.Doubles

    def deviation(self, pixels: int) -> float:
        """Return the standard deviation of the relative gains over a line of n pixels [1]."""
        power = np.abs(shrink(self.information, self.precision)) ** 2
        size = len(power) / spectra.HIGHEST
        return math.sqrt(2.0 * float(power.sum()) / (pixels * size))  # by Parseval's theorem


@kernel
def _power(mean: spectra.Spectrum, precision: spectra.Doubles) -> spectra.Doubles:
    """Return the power of a pattern without the power of its estimation error, shape (F,).

    Where the difference would be negative, the power is 0.

    Args:
        mean: estimated mean of each frequency, shape (F,).
        precision: precision of the mean, 0 without information, shape (F,).
    """
    excess = np.zeros(len(precision))
    for f in range(len(precision)):
        if precision[f] > 0.0:
            square = mean[f].real * mean[f].real + mean[f].imag * mean[f].imag
            excess[f] = square - 1.0 / precision[f]
    power: spectra.Doubles = np.maximum(spectra.smoothed(excess), 0.0)
    return power


@kernel
def shrink(information: spectra.Spectrum, precision: spectra.Doubles) -> spectra.Spectrum:
    """Return the mean of a pattern, shrunk towards 0 where it is mostly noise, shape (F,).

    Args:
        information: precision times mean, shape (F,).
        precision: precision at each frequency, 0 without information, shape (F,).
    """
    mean = posterior(information, precision)
    gain = _power(mean, precision) * precision
    shrunk: spectra.Spectrum = mean * (gain / (gain + 1.0)).astype(np.float32)
    return shrunk


@kernel
def prior(information: spectra.Spectrum, precision: spectra.Doubles) -> spectra.Doubles:
    """Return the prior precision of a pattern from its power (empirical Bayes), shape (F,).

    Without a significant power, the precision is infinite: the pattern is known to be 0. A pattern
    that absorbs part of the ground texture would bias slow displacements away from 0.

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


@kernel
def posterior(information: spectra.Spectrum, precision: spectra.Doubles) -> spectra.Spectrum:
    """Return the posterior mean of a pattern, 0 at frequencies without information, shape (F,)."""
    mean = np.zeros(len(precision), np.complex64)
    for f in range(len(precision)):
        if precision[f] > 0.0:
            mean[f] = information[f] / np.float32(precision[f])
    return mean


@kernel
def observe(
    transformed: spectra.Spectrum, removed: spectra.Spectrum, paths: spectra.Doubles, size: int
) -> tuple[spectra.Spectrum, spectra.Doubles]:
    """Estimate the pattern from one batch whose displacements are known.

    Args:
        transformed: spectra of whole lines, shape (m, F).
        removed: pattern to subtract before the covariance is estimated, shape (F,).
        paths: displacement of each line [px], shape (m,).
        size: length of the Fourier transform [px].

    Returns:
        Information (precision times mean) and precision, each with shape (F,).
    """
    m, count = transformed.shape
    turn, edges = spectra.phases(paths, size, count), spectra.bands(size)
    white = (transformed - removed) * turn
    model, _ = spectra.covariance(white, np.array([0, m]), edges)
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
