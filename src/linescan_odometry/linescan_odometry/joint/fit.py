"""Displacement and its change by Newton steps on the log-likelihood, with a robust variance.

The lines are cut where they show the same piece of ground, so that no texture enters or leaves, and
transformed anew. The variance is the sandwich ``J^-1 (sum U U') J^-1`` over places of the ground:
U are the slopes of the log-likelihood of each place, J its curvature. It holds without the noise
being white or the model exact, as long as places err independently.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy  # whose fft is loaded by its first use: not where configurations are read
from numpy.typing import NDArray

from linescan_odometry.joint.candidates import REACH
from linescan_odometry.joint.fixed_pattern import LEAST_NOISE
from linescan_odometry.joint.spectra import (
    HIGHEST,
    Doubles,
    Floats,
    Spectrum,
    bands,
    covariance,
    rotate,
    transform_size,
    whiten,
    window,
)
from omni_platform.kernels import kernel

PLACES = 24  # of the ground in a line, that err independently
_SHORTEST = 8  # a part of a line that all lines of a block show, the 8th at least
_LARGEST_STEP = 1.0, 0.1  # px per line, px per line^2


class Fit(NamedTuple):
    """A maximum of the likelihood.

    Attributes:
        found: whether there is one.
        displacement: per line, in the middle of the batch [px].
        change: of it from line to line [px].
        variance: of the displacement [px^2].
        features: effective number of independent places that the displacement rests on.
        coherence: of neighboring lines, weighted by power [1].
    """

    found: bool
    displacement: float
    change: float
    variance: float
    features: float
    coherence: float


class _Cut(NamedTuple):
    """Lines cut to what they show of the same ground, block by block.

    Attributes:
        spectra: in the ground frame, shape (t, F).
        line: number of the line in each row, shape (t,).
        first: row of the first line of each block, and t, shape (blocks + 1,).
        ground: where each block begins on the ground [px], shape (blocks,).
        length: of the part [px].
        size: of the transform [px].
    """

    spectra: Spectrum
    line: NDArray[np.int64]
    first: NDArray[np.int64]
    ground: Doubles
    length: int
    size: int


@kernel
def _cut(lines: Floats, paths: Doubles) -> _Cut:
    """Cut lines into blocks of the same ground, neighboring blocks with a line in common."""
    m, n = lines.shape
    largest = 1e-6
    for k in range(m - 1):
        largest = max(largest, abs(paths[k + 1] - paths[k]))
    per = max(2, min(m, 1 + int(REACH * n / largest)))
    blocks = -(-(m - 1) // (per - 1))
    first, ground = np.zeros(blocks + 1, np.int64), np.zeros(blocks)
    line = np.zeros(m - 1 + blocks, np.int64)
    lowest, highest = np.zeros(blocks, np.int64), np.zeros(blocks, np.int64)
    row, length = 0, n
    for block in range(blocks):
        start, end = round((m - 1) * block / blocks), round((m - 1) * (block + 1) / blocks)
        for k in range(start, end + 1):
            line[row] = k
            row += 1
            shift = round(paths[k] - paths[start])
            lowest[block], highest[block] = min(lowest[block], shift), max(highest[block], shift)
        first[block + 1] = row
        ground[block] = paths[start] + highest[block]
        length = min(length, n - highest[block] + lowest[block])
    size = transform_size(max(length, 16))
    part = np.zeros((row, size), np.float32)
    if length >= n // _SHORTEST:
        taper = window(length)
        for block in range(blocks):
            start = paths[line[first[block]]]
            for r in range(first[block], first[block + 1]):
                begin = highest[block] - round(paths[line[r]] - start)
                own, out = lines[line[r], begin : begin + length], part[r, :length]
                mean = own.mean()
                for i in range(length):
                    out[i] = (own[i] - mean) * taper[i]
    else:
        length = 0
    spectra = scipy.fft.rfft(part, size, 1)[:, : int(HIGHEST * size)].copy()
    for block in range(blocks):
        start = paths[line[first[block]]]
        for r in range(first[block], first[block + 1]):
            way = paths[line[r]] - start
            rotate(spectra[r], (way - round(way)) / size, 0.0, spectra[r])
    return _Cut(spectra, line, first, ground, length, size)


@kernel
def _derivatives(
    cut: _Cut, edges: NDArray[np.int64], model: Doubles, kappa: Doubles, half: Doubles
) -> tuple[Spectrum, Doubles]:
    """Return T^-1 of the lines, shape (t, F), and derivatives of the log-likelihood, shape (5,).

    The derivatives are the slopes by d and a, and the negative second ones by dd, da and aa. As T
    is the same at every frequency of a band, ``T^-1 (kappa z)`` gives all of them.
    """
    rows, count = cut.spectra.shape
    white = np.zeros((3, rows, count), np.complex64)
    for block in range(len(cut.first) - 1):
        i, j = cut.first[block], cut.first[block + 1]
        own = cut.line[i:j]
        whiten(cut.spectra[i:j], np.ones(j - i), edges, model, white[0, i:j])
        whiten(cut.spectra[i:j], kappa[own], edges, model, white[1, i:j])
        whiten(cut.spectra[i:j], half[own], edges, model, white[2, i:j])
    sums = np.zeros((5, count), np.float32)
    for r in range(rows):
        p, q = np.float32(kappa[cut.line[r]]), np.float32(half[cut.line[r]])
        z, w, by_p, by_q = cut.spectra[r], white[0, r], white[1, r], white[2, r]
        for f in range(edges[0], count):
            c, d = z[f].real, z[f].imag
            turn = w[f].imag * c - w[f].real * d
            fall = w[f].real * c + w[f].imag * d
            along_p = by_p[f].real * c + by_p[f].imag * d
            along_q = by_q[f].real * c + by_q[f].imag * d
            sums[0, f] += p * turn
            sums[1, f] += q * turn
            sums[2, f] += p * along_p - p * p * fall
            sums[3, f] += q * along_p - p * q * fall
            sums[4, f] += q * along_q - q * q * fall
    derivatives = np.zeros(5)
    for f in range(edges[0], count):
        turn_rate = 2.0 * math.pi * f / cut.size
        for which in range(5):
            power = turn_rate if which < 2 else turn_rate * turn_rate
            derivatives[which] += power * sums[which, f]
    return white[0], derivatives


@kernel
def fit(
    lines: Floats, displacement: float, change: float, spread: float, steps: int, last: bool
) -> Fit:
    """Take Newton steps from a displacement and its change.

    Args:
        lines: without the pattern, shape (m, n).
        displacement: per line [px].
        change: of it from line to line [px].
        spread: its prior standard deviation [px].
        steps: how many.
        last: whether variance and features are wanted.
    """
    m, n = lines.shape
    nothing = Fit(False, displacement, change, math.inf, 0.0, 0.0)
    kappa = np.arange(m) - 0.5 * (m - 1)
    half = 0.5 * kappa**2
    for step in range(steps + 1):
        cut = _cut(lines, displacement * kappa + change * half)
        if cut.length == 0:
            return nothing
        edges = bands(cut.size)
        model, moments = covariance(
            cut.spectra, cut.first, edges, np.full(len(edges) - 1, -LEAST_NOISE)
        )
        white, derivatives = _derivatives(cut, edges, model, kappa, half)
        u_d, u_a = derivatives[0], derivatives[1] - change / spread**2
        j_dd, j_da, j_aa = derivatives[2], derivatives[3], derivatives[4] + 1.0 / spread**2
        determinant = j_dd * j_aa - j_da * j_da
        if not (j_dd > 0.0 and determinant > 0.0):
            return nothing
        if step < steps:
            by_d = (j_aa * u_d - j_da * u_a) / determinant
            by_a = (j_dd * u_a - j_da * u_d) / determinant
            displacement += min(max(by_d, -_LARGEST_STEP[0]), _LARGEST_STEP[0])
            change += min(max(by_a, -_LARGEST_STEP[1]), _LARGEST_STEP[1])
    if not last:
        return Fit(True, displacement, change, math.inf, 0.0, 0.0)
    weight = np.zeros(cut.spectra.shape[1])
    for b in range(len(edges) - 1):
        gamma = min(moments[1, b] / moments[0, b], 1.0 - LEAST_NOISE)
        weight[edges[b] : edges[b + 1]] = math.sqrt(gamma / ((1.0 - gamma * gamma) * moments[0, b]))
    parts = _places(cut, white, weight, kappa, half, n)
    variance, features = _sandwich(parts, j_aa / determinant, -j_da / determinant)
    coherence = moments[1].sum() / max(moments[0].sum(), 1e-9)
    return Fit(features > 0.0, displacement, change, variance, features, coherence)


@kernel
def _sandwich(parts: Doubles, g_d: float, g_a: float) -> tuple[float, float]:
    """Return the variance of the displacement [px^2], and the effective number of features.

    Args:
        parts: slopes by d and a and coherent energy of each place, shape (p, 3).
        g_d: first row of J^-1, by d.
        g_a: the same by a.
    """
    energy = np.maximum(parts[:, 2], 0.0)
    total = energy.sum()
    if total <= 0.0:
        return math.inf, 0.0
    share = energy / total
    slope = g_d * parts[:, 0] + g_a * parts[:, 1]
    own = slope - share * slope.sum()
    features = 1.0 / (share * share).sum()
    # Student's factor: the scatter is estimated from as many places.
    student = features / (features - 2.0) if features > 2.0 else math.inf
    return student * (own * own).sum(), features


@kernel
def _places(
    cut: _Cut,
    white: Spectrum,
    weight: Doubles,
    kappa: Doubles,
    half: Doubles,
    pixels: int,
) -> Doubles:
    """Return slopes by d and a and the coherent energy of each place of the ground, shape (p, 3).

    The products of lines are summed in space, on a grid as coarse as the highest frequency allows.
    The energy is the information ``f^2 gamma^2 / (1 - gamma^2)`` of a coherence gamma, by products
    of neighboring lines, in which what does not move with the ground has no part.
    """
    rows, count = cut.spectra.shape
    size = transform_size(2 * count)
    parted = np.zeros((3, rows, size // 2 + 1), np.complex64)
    for r in range(rows):
        for f in range(1, count):
            turn = np.complex64(2j * math.pi * f / cut.size)
            parted[0, r, f] = white[r, f]
            parted[1, r, f] = turn * cut.spectra[r, f]
            parted[2, r, f] = parted[1, r, f] * np.float32(weight[f])
    in_space = scipy.fft.irfft(parted[0], size, 1)
    slopes = scipy.fft.irfft(parted[1], size, 1)
    energy = scipy.fft.irfft(parted[2], size, 1)
    scale = size / cut.size  # of a px
    seen = int(cut.length * scale)
    lowest = math.floor(cut.ground.min() * PLACES / pixels)
    highest = math.floor((cut.ground.max() + cut.length) * PLACES / pixels)
    parts = np.zeros((highest - lowest + 1, 3))
    for block in range(len(cut.first) - 1):
        place = np.empty(seen, np.int64)
        for i in range(seen):
            place[i] = math.floor((cut.ground[block] + i / scale) * PLACES / pixels) - lowest
        for r in range(cut.first[block], cut.first[block + 1]):
            p, q = kappa[cut.line[r]], half[cut.line[r]]
            for i in range(seen):
                product = in_space[r, i] * slopes[r, i]
                parts[place[i], 0] += p * product
                parts[place[i], 1] += q * product
                if r > cut.first[block]:
                    parts[place[i], 2] += energy[r, i] * energy[r - 1, i]
    # A real transform counts every frequency twice over its size.
    parts *= 0.5 * size
    return parts
