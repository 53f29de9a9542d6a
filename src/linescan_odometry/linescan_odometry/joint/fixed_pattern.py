"""The fixed pattern of a camera, estimated along with the displacement.

Dirt, unequal pixels, shading and mud change every line in the same way: this is the fixed pattern.
For a given displacement its posterior is Gaussian at every frequency; earlier batches and this one
are weighted by their information. The prior variance is the power of the estimated pattern
(empirical Bayes), so that a camera without dirt loses little information. Before candidates for the
displacement are compared, a shrunk mean is subtracted, which is small where it is mostly error.
"""

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint.spectra import (
    Doubles,
    Spectrum,
    bands,
    covariance,
    phases,
    smoothed,
    whiten,
)
from omni_platform.kernels import kernel

LEAST_NOISE = 0.2  # smallest noise over a band's power, so that no band outweighs all others


class FixedPattern(NamedTuple):
    """Estimate of the fixed pattern of a camera, as the logarithm of its gains.

    Attributes:
        information: precision times mean of each frequency, shape (F,).
        precision: precision at each frequency, 0 where nothing is known, shape (F,).
    """

    information: Spectrum
    precision: Doubles

    def deviation(self, pixels: int) -> float:
        """Return the standard deviation over a line of n pixels, of relative gains [1]."""
        power = np.abs(shrink(self.information, self.precision)) ** 2
        # Of a line padded to twice its length, each frequency counts twice (Parseval).
        return math.sqrt(float(power.sum()) / pixels**2)


@kernel
def shrink(information: Spectrum, precision: Doubles) -> Spectrum:
    """Return the posterior mean of a pattern, shape (F,).

    Args:
        information: precision times mean, shape (F,).
        precision: precision at each frequency, 0 where nothing is known, shape (F,).
    """
    count = len(precision)
    mean = np.zeros(count, np.complex64)
    excess = np.zeros(count)
    for f in range(count):
        if precision[f] > 0.0:
            mean[f] = information[f] / np.float32(precision[f])
            power = mean[f].real * mean[f].real + mean[f].imag * mean[f].imag
            excess[f] = power - 2.0 / precision[f]
    excess = np.maximum(smoothed(excess), 0.0)
    for f in range(count):
        gain = excess[f] * precision[f]
        mean[f] *= np.float32(gain / (gain + 1.0))
    return mean


@kernel
def prior(information: Spectrum, precision: Doubles) -> Doubles:
    """Return the prior precision of a pattern by its power (empirical Bayes), shape (F,).

    Args:
        information: precision times mean, shape (F,).
        precision: precision at each frequency, 0 where nothing is known, shape (F,).
    """
    mean = posterior(information, precision)
    power: Doubles = smoothed((mean.real**2 + mean.imag**2).astype(np.float64))
    for f in range(len(power)):
        power[f] = 1.0 / power[f] if power[f] > 0.0 else 0.0
    return power


@kernel
def posterior(information: Spectrum, precision: Doubles) -> Spectrum:
    """Return the mean of a pattern, 0 where nothing is known, shape (F,)."""
    mean = np.zeros(len(precision), np.complex64)
    for f in range(len(precision)):
        if precision[f] > 0.0:
            mean[f] = information[f] / np.float32(precision[f])
    return mean


@kernel
def observe(
    spectra: Spectrum, removed: Spectrum, paths: Doubles, size: int
) -> tuple[Spectrum, Doubles]:
    """Return the estimate of the pattern by one batch with given displacements of its lines.

    Args:
        spectra: spectra of whole lines, shape (m, F).
        removed: pattern to subtract before the covariance is estimated, shape (F,).
        paths: displacement of every line [px], shape (m,).
        size: size of the transform [px].

    Returns:
        Information (precision times mean) and precision, each with shape (F,).
    """
    m, count = spectra.shape
    turn = phases(paths, size, count)
    aligned = spectra * turn
    edges = bands(size)
    model, _ = covariance(
        (spectra - removed) * turn, np.array([0, m]), edges, np.full(len(edges) - 1, -LEAST_NOISE)
    )
    white = np.zeros((m, count), np.complex64)
    whiten(turn, np.ones(m), edges, model, white)
    information, precision = np.zeros(count, np.complex64), np.zeros(count, np.float32)
    for k in range(m):
        row, own, seen = white[k], turn[k], aligned[k]
        for f in range(count):
            information[f] += np.conj(row[f]) * seen[f]
            precision[f] += row[f].real * own[f].real + row[f].imag * own[f].imag
    return information, precision.astype(np.float64)
