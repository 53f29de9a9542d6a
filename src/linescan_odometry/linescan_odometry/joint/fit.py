"""Robust variance of a displacement, and number of the ground features that determine it.

The variance is the sandwich estimate ``J^-1 B J^-1`` over segments of the ground, where J is the
curvature of the log-likelihood. B is the covariance of its derivative by Newey and West (1987):
segments up to `_CORRELATED` apart may have correlated errors, because texture that is longer than a
segment is part of several of them. The sandwich is valid even if the noise is not white and the
model is not exact.
"""

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint.likelihood import Cut, Expansion
from linescan_odometry.joint.spectra import (
    LEAST_NOISE,
    SIGNIFICANT,
    Doubles,
    Floats,
    summing,
    window,
)
from linescan_odometry.matching.transforms import transform_size
from omni_platform.kernels import kernel, linked

PLACES = 24  # number of ground segments in a line
_CORRELATED = 2  # segments; largest distance at which the errors of two segments are correlated
_LEAST_FREEDOM = 2.5  # degrees of freedom; limits Student's factor of the variance to 5


class Fit(NamedTuple):
    """Properties of a displacement at a maximum of the likelihood.

    Attributes:
        variance: robust variance of the displacement [px^2].
        white: variance of the displacement according to the model with white noise [px^2], infinite
            without information.
        features: effective number of independent features that move with the displacement.
        coherence: coherence between neighboring lines, weighted by power [1].
        contrast: energy of the gradients that neighboring lines have in common, relative to the
            energy of the gradients of the noise [1].
        difference: displacement per line estimated from neighboring lines, minus that estimated
            from all lines [px]; 0 if the difference is not significant.
    """

    variance: float
    white: float
    features: float
    coherence: float
    contrast: float
    difference: float


@summing
def _shared(cut: Cut) -> float:
    """Return the energy of the gradients that neighboring lines have in common.

    The energy is the mean over pairs of lines of the sum of ``f^2 Re(new conj(old))``, where f is
    the index of the frequency.
    """
    total, number = 0.0, 0
    for block in range(len(cut.first) - 1):
        for r in range(cut.first[block] + 1, cut.first[block + 1]):
            new, old = cut.spectra[r], cut.spectra[r - 1]
            number += 1
            for f in range(1, len(new)):
                total += f * f * (new[f].real * old[f].real + new[f].imag * old[f].imag)
    return total / number


@kernel
def _gain(cut: Cut) -> float:
    """Return the energy of the gradients of a line of white noise with the variance 1."""
    taper = window(cut.length)
    own = 0.0
    for i in range(len(taper)):
        own += taper[i] * taper[i]
    total = 0.0
    for f in range(1, cut.spectra.shape[1]):
        total += f * f
    return own * total


@kernel
def _noise(lines: Floats) -> float:
    """Return the median of the pixels' noise variances, estimated from lines of shape (m, n).

    Differences between lines contain no fixed pattern. Their third differences along the line
    contain hardly any ground texture, because the optics blur it.
    """
    m, n = lines.shape
    square = np.zeros(n - 3, np.float32)
    for k in range(1, m):
        new, old = lines[k], lines[k - 1]
        for i in range(n - 3):
            outer = new[i] - old[i] - new[i + 3] + old[i + 3]
            inner = new[i + 2] - old[i + 2] - new[i + 1] + old[i + 1]
            value = outer + np.float32(3.0) * inner
            square[i] += value * value
    # The coefficients 1, 3, 3 and 1 of a third difference have the sum of squares 20, and the
    # difference of two lines has twice the noise variance of one line.
    noise: float = np.median(square) / (2.0 * 20.0 * (m - 1))
    return noise


@linked
@kernel
def assess(lines: Floats, here: Expansion) -> Fit:
    """Return variance and quality measures of the displacement at a maximum of the likelihood.

    Args:
        lines: logarithm of the lines minus the pattern, shape (m, n).
        here: expansion of the log-likelihood near its maximum.
    """
    cut, edges, moments = here.cut, here.model.edges, here.moments
    if not math.isfinite(here.inverse[0, 0]):
        return Fit(math.inf, math.inf, 0.0, 0.0, 0.0, 0.0)
    contrast = _shared(cut) / max(_noise(lines) * _gain(cut), 1e-12)
    weight = np.zeros(cut.spectra.shape[1])
    for b in range(len(edges) - 1):
        gamma = min(moments[1, b] / moments[0, b], 1.0 - LEAST_NOISE)
        weight[edges[b] : edges[b + 1]] = math.sqrt(gamma / ((1.0 - gamma * gamma) * moments[0, b]))
    parts = _places(here, weight, lines.shape[1])
    variance = _sandwich(parts, here.inverse[0])
    # With weights of amplitude times coherence, a bright edge dominates less than with energies.
    energy = np.maximum(parts[:, 2], 0.0)
    amplitude = energy**1.5 / np.maximum(parts[:, 3], 1e-12)
    features = amplitude.sum() ** 2 / max((amplitude * amplitude).sum(), 1e-12)
    # With oblique edges or a second motion, neighboring and distant lines shift differently.
    total = max(parts[:, 2].sum(), 1e-12)
    offset = parts[:, 4].sum() / total
    scatter = (parts[:, 4] - offset * parts[:, 2]) / total
    excess = max(offset**2 - SIGNIFICANT**2 * (scatter * scatter).sum(), 0.0)
    variance += excess
    coherence = moments[1].sum() / max(moments[0].sum(), 1e-9)
    white = here.inverse[0, 0]
    return Fit(variance, white, features, coherence, contrast, math.sqrt(excess))


@kernel
def _sandwich(parts: Doubles, inverse: Doubles) -> float:
    """Return the variance of the displacement [px^2].

    It is infinite if the coherent energy is concentrated in effectively two segments or fewer.

    Args:
        parts: properties of the p segments from `_places`, shape (p, 5).
        inverse: row of the inverse information that belongs to d, shape (2,).
    """
    energy = np.maximum(parts[:, 2], 0.0)
    total = energy.sum()
    if total <= 0.0:
        return math.inf
    share = energy / total
    slope = inverse[0] * parts[:, 0] + inverse[1] * parts[:, 1]
    own = slope - share * slope.sum()
    scatter = (own * own).sum()
    for lag in range(1, _CORRELATED + 1):
        weight = 1.0 - lag / (_CORRELATED + 1.0)  # Bartlett's, so that the sum is not negative
        scatter += 2.0 * weight * (own[lag:] * own[:-lag]).sum()
    effective = 1.0 / (share * share).sum()
    if effective <= 2.0:
        return math.inf
    # Student's factor, with the degrees of freedom of a sum with Bartlett's weights.
    freedom = max(1.5 * effective / (_CORRELATED + 1.0), _LEAST_FREEDOM)
    variance: float = scatter * freedom / (freedom - 2.0)
    return variance


@kernel
def _places(here: Expansion, weight: Doubles, pixels: int) -> Doubles:
    """Return five properties of each of the p ground segments, shape (p, 5).

    Columns 0 and 1 are the derivatives of the log-likelihood with respect to the displacement d per
    line and its change a. Columns 2 and 3 are the coherent and the total energy. Column 4 is the
    derivative with respect to d, computed from neighboring lines alone.

    Each property is a sum of products of lines over the positions in a segment, on a grid as coarse
    as the highest frequency allows. The energy is the information ``f^2 gamma^2 / (1 - gamma^2)``
    of a coherence gamma. Its coherent part is computed from products of neighboring lines, in which
    only the ground is correlated. The derivatives of the paths are taken relative to their mean
    over a block: a constant in them would not change the derivative of the whole line, but it would
    change that of each segment.

    Args:
        here: expansion of the log-likelihood near its maximum.
        weight: weight of each frequency in the energies, shape (F,).
        pixels: number of pixels n of a line.
    """
    cut, model = here.cut, here.model
    rows, count = cut.spectra.shape
    size = transform_size(2 * count)
    parted = np.zeros((4, rows, size // 2 + 1), np.complex64)
    turn = (1j * model.rate).astype(np.complex64)
    for r in range(rows):
        for f in range(1, count):
            parted[0, r, f] = here.white[r, f]
            parted[1, r, f] = turn[f] * cut.spectra[r, f]
            parted[2, r, f] = parted[1, r, f] * np.float32(weight[f])
            parted[3, r, f] = cut.spectra[r, f] * np.float32(weight[f])
    space: Floats = np.fft.irfft(parted, size, 2)  # type: ignore[assignment]  # numba: 32 bits
    scale = size / cut.size  # grid points per pixel
    seen = int(cut.length * scale)
    lowest = math.floor(cut.ground.min() * PLACES / pixels)
    highest = math.floor((cut.ground.max() + cut.length) * PLACES / pixels)
    parts = np.zeros((highest - lowest + 1, 5))
    for block in range(len(cut.first) - 1):
        own = model.along[:, cut.line[cut.first[block] : cut.first[block + 1]]]
        sums = _summed(space, cut.first[block], seen, own)
        for p in range(len(parts)):
            begin = ((p + lowest) * pixels / PLACES - cut.ground[block]) * scale
            i = max(0, math.ceil(begin))
            j = max(i, min(seen, math.ceil(begin + pixels / PLACES * scale)))
            for which in range(5):
                parts[p, which] += sums[which, i:j].sum()
    # The inverse transform weights every frequency by 2 / size.
    parts *= 0.5 * size
    return parts


@kernel
def _summed(space: Floats, first: int, seen: int, along: Doubles) -> Floats:
    """Return the products of lines for `_places`, summed over the lines of a block, shape (5, g).

    Args:
        space: whitened lines, slopes, weighted slopes and weighted lines, shape (4, t, size).
        first: row of the block's first line.
        seen: number of grid points g that the lines cover.
        along: derivatives of the paths with respect to d and a, shape (2, m).
    """
    half = np.float32(0.5)
    sums = np.zeros((5, seen), np.float32)
    by_d, by_a, shared, whole, shift = sums
    for k in range(along.shape[1]):
        white, slopes = space[0, first + k], space[1, first + k]
        energy, texture = space[2, first + k], space[3, first + k]
        d, a = np.float32(along[0, k] - along[0].mean()), np.float32(along[1, k] - along[1].mean())
        for i in range(seen):
            product = white[i] * slopes[i]
            by_d[i] += d * product
            by_a[i] += a * product
        if k > 0:
            before, older = space[2, first + k - 1], space[3, first + k - 1]
            for i in range(seen):
                shared[i] += energy[i] * before[i]
                whole[i] += half * (energy[i] * energy[i] + before[i] * before[i])
            for i in range(seen):
                shift[i] += half * (before[i] * texture[i] - energy[i] * older[i])
    return sums
