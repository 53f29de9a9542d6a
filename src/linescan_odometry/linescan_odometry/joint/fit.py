"""Displacement and its change by Newton steps on the log-likelihood, with a robust variance.

The lines are cut to the piece of ground that they share, so that no texture enters or leaves, and
transformed again. The variance is the sandwich ``J^-1 (sum U U') J^-1`` over places of the ground:
U are the slopes of the log-likelihood of each place, and J is the curvature. This variance is valid
even if the noise is not white and the model is not exact, as long as the errors of the places are
independent.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy  # loads scipy.fft at its first use, so not in processes that only read configurations
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
    phases,
    rotate,
    transform_size,
    whiten,
    window,
)
from omni_platform.kernels import kernel

PLACES = 24  # pieces of ground in a line whose errors are independent
_SHORTEST = 8  # the lines of a block share at least the 8th part of a line
_STEPS = 2
_LOCKING = 0.05  # px, systematic error of neighboring lines, by aliasing and a fixed pattern
_LARGEST_STEP = 1.0, 0.1  # px per line, px per line^2


class Fit(NamedTuple):
    """A maximum of the likelihood.

    Attributes:
        found: whether there is one.
        displacement: displacement per line, in the middle of the batch [px].
        change: change of the displacement from line to line [px].
        variance: variance of the displacement [px^2].
        features: effective number of independent features that move with the displacement.
        coherence: coherence of neighboring lines, weighted by power [1].
        details: effective number of independent values of the texture in a line.
        contrast: energy of the gradients that neighboring lines share over that of the noise [1].
        chi_square: squared difference between the displacement by neighboring lines alone and this
            one, over its variance [1]: large where two motions overlap.
    """

    found: bool
    displacement: float
    change: float
    variance: float
    features: float
    coherence: float
    details: float
    contrast: float
    chi_square: float


class Precision(NamedTuple):
    """Precision of the fixed pattern (logarithm of gains) at the frequencies of whole lines.

    Attributes:
        before: inverse variance from earlier batches, shape (F,).
        batch: inverse variance from this batch, shape (F,).
    """

    before: Doubles
    batch: Doubles


class _Block(NamedTuple):
    """One block of lines.

    Attributes:
        spectra: z; `_marginalize` subtracts the pattern, shape (m, F).
        turn: ``u_k = exp(-2 pi i f X_k)``, shape (m, F).
        kappa: derivatives of the paths of the lines by d, shape (m,).
        half: derivatives of the paths of the lines by a, shape (m,).
    """

    spectra: Spectrum
    turn: Spectrum
    kappa: Doubles
    half: Doubles


class _Model(NamedTuple):
    """Covariance of the lines, at each frequency.

    Attributes:
        edges: edges of the bands [bins], shape (B + 1,).
        bands: S, rho, N of each band, shape (3, B).
        precision: inverse variance of the pattern, shape (F,).
        rate: angular frequency of each bin [rad per px], shape (F,).
    """

    edges: NDArray[np.int64]
    bands: Doubles
    precision: Doubles
    rate: Doubles


class _Cut(NamedTuple):
    """Lines cut to the ground that they have in common, block by block.

    Attributes:
        spectra: spectra in the ground frame, shape (t, F).
        line: number of the line in each row, shape (t,).
        first: row of the first line of each block and, last, t, shape (blocks + 1,).
        ground: position on the ground at which each block begins [px], shape (blocks,).
        length: length of the cut lines [px].
        size: size of the transform [px].
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
            offset = paths[line[r]] - start
            rotate(spectra[r], (offset - round(offset)) / size, 0.0, spectra[r])
    return _Cut(spectra, line, first, ground, length, size)


@kernel
def _projected(weight: Doubles, turn: Spectrum, white: Spectrum) -> Spectrum:
    """Return ``sum_k weight_k conj(u_k) v_k`` at every frequency, shape (F,)."""
    total = np.zeros(turn.shape[1], np.complex64)
    for k in range(len(turn)):
        u, v, factor = turn[k], white[k], np.float32(weight[k])
        for f in range(len(total)):
            total[f] += factor * np.conj(u[f]) * v[f]
    return total


@kernel
def _marginalize(block: _Block, model: _Model, white: Spectrum, slopes: Doubles) -> None:
    """Marginalize the fixed pattern out of the log-likelihood of one block.

    A pattern of variance V adds ``V u u'`` to T, with ``u_k = exp(-2 pi i f X_k)`` in the ground
    frame. With ``c = 1 / V + u' T^-1 u``, the log-likelihood decreases by ``log c / 2``, and
    ``u (u' T^-1 z) / c`` is subtracted from the lines.

    Args:
        block: the lines.
        model: covariance of the lines.
        white: receives ``T^-1 z`` without the pattern, shape (m, F).
        slopes: slopes of the log-likelihood by d and a, to which those of the term with c are
            added, shape (2,).
    """
    spectra, turn, kappa, half = block
    edges, bands_of, precision, rate = model
    ones = np.ones(len(spectra))
    fixed = np.zeros(spectra.shape, np.complex64)
    whiten(turn, ones, edges, bands_of, fixed)
    whiten(spectra, ones, edges, bands_of, white)
    c = precision + _projected(ones, turn, fixed).real
    slope_d = _projected(kappa, turn, fixed).imag
    slope_a = _projected(half, turn, fixed).imag
    pattern = _projected(ones, turn, white)
    for f in range(edges[0], len(c)):
        pattern[f] /= np.float32(c[f])
        slopes[0] += rate[f] / c[f] * slope_d[f]
        slopes[1] += rate[f] / c[f] * slope_a[f]
    for k in range(len(spectra)):
        for f in range(edges[0], len(c)):
            white[k, f] -= fixed[k, f] * pattern[f]
            spectra[k, f] -= turn[k, f] * pattern[f]


@kernel
def _slopes(
    cut: _Cut, model: _Model, kappa: Doubles, half: Doubles, paths: Doubles
) -> tuple[Spectrum, Doubles]:
    """Return T^-1 of the lines, shape (t, F), and slopes of the log-likelihood by d and a.

    The part of the pattern that is not known yet is subtracted from the lines, see `_marginalize`.
    """
    rows, count = cut.spectra.shape
    white = np.zeros((rows, count), np.complex64)
    slopes = np.zeros(2)
    for block in range(len(cut.first) - 1):
        i, j = cut.first[block], cut.first[block + 1]
        own = cut.line[i:j]
        turn = phases(paths[own] - paths[own[0]], cut.size, count)
        lines = _Block(cut.spectra[i:j], turn, kappa[own], half[own])
        _marginalize(lines, model, white[i:j], slopes)
    first = model.edges[0]
    sums = np.zeros((2, count), np.float32)
    for r in range(rows):
        p, q = np.float32(kappa[cut.line[r]]), np.float32(half[cut.line[r]])
        z, w = cut.spectra[r], white[r]
        for f in range(first, count):
            turn = w[f].imag * z[f].real - w[f].real * z[f].imag
            sums[0, f] += p * turn
            sums[1, f] += q * turn
    for f in range(first, count):
        slopes[0] += model.rate[f] * sums[0, f]
        slopes[1] += model.rate[f] * sums[1, f]
    return white, slopes


@kernel
def _information(
    cut: _Cut, model: _Model, kappa: Doubles, half: Doubles, paths: Doubles
) -> Doubles:
    """Return the Fisher information on d and a: of dd, da and aa, shape (3,).

    With ``B = K T - T K``, K the diagonal matrix of the derivatives of the paths, it is ``-(2 pi
    f)^2 tr(C^-1 B C^-1 B)`` at every frequency, and ``C^-1 = T^-1 - q q' / c`` with ``q = T^-1 u``
    of the marginalized pattern. It is taken at the middle of each band.
    """
    total = np.zeros(3)
    for block in range(len(cut.first) - 1):
        own = cut.line[cut.first[block] : cut.first[block + 1]]
        m = len(own)
        path = paths[own] - paths[own[0]]
        number = np.arange(m).astype(np.float64)
        lag = np.abs(number.reshape(m, 1) - number)
        by_d = kappa[own].reshape(m, 1) - kappa[own]
        by_a = half[own].reshape(m, 1) - half[own]
        unit, white = np.zeros((m, m), np.complex64), np.zeros((m, m), np.complex64)
        for k in range(m):
            unit[k, k] = 1.0
        ones, all_columns = np.ones(m), np.array([0, m])
        for b in range(len(model.edges) - 1):
            first, last = model.edges[b], model.edges[b + 1]
            whiten(unit, ones, all_columns, model.bands[:, b : b + 1].copy(), white)
            inverse = white.real.astype(np.float64)
            texture = model.bands[0, b] * model.bands[1, b] ** lag
            middle = (first + last - 1) // 2
            u = np.exp(-1j * model.rate[middle] * path)
            q = (inverse * u).sum(1)
            c = model.precision[middle] + (np.conj(u) * q).real.sum()
            along_d, along_a = (by_d * texture * q).sum(1), (by_a * texture * q).sum(1)
            white_d, white_a = (inverse * along_d).sum(1), (inverse * along_a).sum(1)
            slope_d = (np.conj(q) * along_d).imag.sum() / c
            slope_a = (np.conj(q) * along_a).imag.sum() / c
            # tr(T^-1 B T^-1 B) = sum over k and j of T^-1 T (K_k - K_j)^2.
            product = inverse * texture
            squares = 0.5 * (model.rate[first:last] ** 2).sum()
            total[0] += squares * (
                slope_d**2 - (product * by_d * by_d).sum()
                - 2.0 * (np.conj(along_d) * white_d).real.sum() / c
            )  # fmt: skip
            total[1] += squares * (
                slope_d * slope_a - (product * by_d * by_a).sum()
                - 2.0 * (np.conj(along_d) * white_a).real.sum() / c
            )  # fmt: skip
            total[2] += squares * (
                slope_a**2 - (product * by_a * by_a).sum()
                - 2.0 * (np.conj(along_a) * white_a).real.sum() / c
            )  # fmt: skip
    return total


@kernel
def _on_grid(precision: Precision, cut: _Cut, pixels: int) -> Doubles:
    """Return the precision of the pattern without one block, at the frequencies of the cut.

    Args:
        precision: precision of the pattern; each block of this batch contributes an equal part.
        cut: the cut lines, which have less than n pixels.
        pixels: n of a line.
    """
    before, batch = precision
    known = np.zeros(cut.spectra.shape[1])
    others = 1.0 - 1.0 / (len(cut.first) - 1)
    scale = pixels / cut.length
    for f in range(len(known)):
        i = min(f * len(before) // len(known), len(before) - 1)
        known[f] = scale * (before[i] + others * batch[i])
    return known


@kernel
def _shared(cut: _Cut) -> float:
    """Return the energy of the gradients that neighboring lines share, in units of `_gain`."""
    total, number = 0.0, 0
    for block in range(len(cut.first) - 1):
        for r in range(cut.first[block] + 1, cut.first[block + 1]):
            new, old = cut.spectra[r], cut.spectra[r - 1]
            number += 1
            for f in range(1, len(new)):
                total += f * f * (new[f].real * old[f].real + new[f].imag * old[f].imag)
    return total / number


@kernel
def _gain(cut: _Cut) -> float:
    """Return the energy of the gradients of white noise of variance 1."""
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
    """Return the variance of the noise of a pixel, the median over the line.

    Differences of lines contain no fixed pattern, their third differences along the line hardly any
    ground: the optics blur it.
    """
    m, n = lines.shape
    square = np.zeros(n - 3)
    for k in range(1, m):
        new, old = lines[k], lines[k - 1]
        for i in range(n - 3):
            outer = new[i] - old[i] - new[i + 3] + old[i + 3]
            inner = new[i + 2] - old[i + 2] - new[i + 1] + old[i + 1]
            value = outer + np.float32(3.0) * inner
            square[i] += value * value
    # The squares of 1, 3, 3 and 1 add up to 20, and a difference has the noise of two lines.
    noise: float = np.median(square) / (2.0 * 20.0 * (m - 1))
    return noise


@kernel
def fit(
    lines: Floats,
    precision: Precision,
    displacement: float,
    change: float,
    spread: float,
    last: bool,
) -> Fit:
    """Take Newton steps from a displacement and its change.

    Args:
        lines: logarithm of lines less the pattern, shape (m, n).
        precision: precision of the pattern.
        displacement: displacement per line [px].
        change: change of the displacement from line to line [px].
        spread: prior standard deviation of the change [px].
        last: whether to compute variance and features too.
    """
    m, n = lines.shape
    nothing = Fit(False, displacement, change, math.inf, 0.0, 0.0, 0.0, 0.0, 0.0)
    kappa = np.arange(m) - 0.5 * (m - 1)
    half = 0.5 * kappa**2
    for step in range(_STEPS + 1):
        paths = displacement * kappa + change * half
        cut = _cut(lines, paths)
        if cut.length == 0:
            return nothing
        edges = bands(cut.size)
        covariances, moments = covariance(
            cut.spectra, cut.first, edges, np.full(len(edges) - 1, -LEAST_NOISE)
        )
        rate = 2.0 * math.pi * np.arange(cut.spectra.shape[1]) / cut.size
        model = _Model(edges, covariances, _on_grid(precision, cut, n), rate)
        if last and step == _STEPS:
            contrast = _shared(cut) / max(_noise(lines) * _gain(cut), 1e-12)
        white, slopes = _slopes(cut, model, kappa, half, paths)
        u_d, u_a = slopes[0], slopes[1] - change / spread**2
        if step == 0:
            j_dd, j_da, j_aa = _information(cut, model, kappa, half, paths)
            j_aa += 1.0 / spread**2
        determinant = j_dd * j_aa - j_da * j_da
        if not (j_dd > 0.0 and determinant > 0.0):
            return nothing
        if step < _STEPS:
            by_d = (j_aa * u_d - j_da * u_a) / determinant
            by_a = (j_dd * u_a - j_da * u_d) / determinant
            displacement += min(max(by_d, -_LARGEST_STEP[0]), _LARGEST_STEP[0])
            change += min(max(by_a, -_LARGEST_STEP[1]), _LARGEST_STEP[1])
    if not last:
        return Fit(True, displacement, change, math.inf, 0.0, 0.0, 0.0, 0.0, 0.0)
    weight = np.zeros(cut.spectra.shape[1])
    total, square = 0.0, 1e-30
    for b in range(len(edges) - 1):
        number = edges[b + 1] - edges[b]
        power = moments[1, b] * (edges[b] + edges[b + 1])
        total += number * power
        square += number * power * power
        gamma = min(moments[1, b] / moments[0, b], 1.0 - LEAST_NOISE)
        weight[edges[b] : edges[b + 1]] = math.sqrt(gamma / ((1.0 - gamma * gamma) * moments[0, b]))
    parts = _places(cut, white, weight, kappa, half, n)
    variance = _sandwich(parts, j_aa / determinant, -j_da / determinant)
    # Weighted by amplitude and coherence, so that a bright edge counts like a faint one.
    energy = np.maximum(parts[:, 2], 0.0)
    amplitude = energy**1.5 / np.maximum(parts[:, 3], 1e-12)
    features = amplitude.sum() ** 2 / max((amplitude * amplitude).sum(), 1e-12)
    offset = parts[:, 4].sum() / max(parts[:, 2].sum(), 1e-12)
    scatter = parts[:, 4] - offset * parts[:, 2]
    spread = (scatter * scatter).sum() / max(parts[:, 2].sum(), 1e-12) ** 2
    chi_square = offset * offset / (spread + _LOCKING**2)
    coherence = moments[1].sum() / max(moments[0].sum(), 1e-9)
    details = 2.0 * total * total / square * n / cut.length
    return Fit(
        True, displacement, change, variance, features, coherence, details, contrast,
        chi_square,
    )  # fmt: skip


@kernel
def _sandwich(parts: Doubles, g_d: float, g_a: float) -> float:
    """Return the variance of the displacement [px^2], infinite if two places have all energy.

    Args:
        parts: result of `_places`, shape (p, 5).
        g_d: element of J^-1 in the row and the column of d.
        g_a: element of J^-1 in the row of d and the column of a.
    """
    energy = np.maximum(parts[:, 2], 0.0)
    total = energy.sum()
    if total <= 0.0:
        return math.inf
    share = energy / total
    slope = g_d * parts[:, 0] + g_a * parts[:, 1]
    own = slope - share * slope.sum()
    effective = 1.0 / (share * share).sum()
    # Student's factor, because the scatter is estimated from `effective` places only.
    student = effective / (effective - 2.0) if effective > 2.0 else math.inf
    variance: float = student * (own * own).sum()
    return variance


@kernel
def _places(
    cut: _Cut,
    white: Spectrum,
    weight: Doubles,
    kappa: Doubles,
    half: Doubles,
    pixels: int,
) -> Doubles:
    """Return properties of each place, shape (p, 5).

    These are the slopes of the log-likelihood by d and a, the coherent and the total energy, and
    the slope by d of the likelihood of neighboring lines alone.

    The products of lines are summed in space, on a grid as coarse as the highest frequency allows.
    The energy is the information ``f^2 gamma^2 / (1 - gamma^2)`` of a coherence gamma. Its coherent
    part is computed from products of neighboring lines, to which only the ground contributes. The
    derivatives of the paths are taken from their mean over a block: a constant adds no slope to the
    whole line, but one to each place.
    """
    rows, count = cut.spectra.shape
    size = transform_size(2 * count)
    parted = np.zeros((4, rows, size // 2 + 1), np.complex64)
    for r in range(rows):
        for f in range(1, count):
            turn = np.complex64(2j * math.pi * f / cut.size)
            parted[0, r, f] = white[r, f]
            parted[1, r, f] = turn * cut.spectra[r, f]
            parted[2, r, f] = parted[1, r, f] * np.float32(weight[f])
            parted[3, r, f] = cut.spectra[r, f] * np.float32(weight[f])
    in_space = scipy.fft.irfft(parted[0], size, 1)
    slopes = scipy.fft.irfft(parted[1], size, 1)
    energy = scipy.fft.irfft(parted[2], size, 1)
    texture = scipy.fft.irfft(parted[3], size, 1)
    scale = size / cut.size  # grid points per px
    seen = int(cut.length * scale)
    lowest = math.floor(cut.ground.min() * PLACES / pixels)
    highest = math.floor((cut.ground.max() + cut.length) * PLACES / pixels)
    parts = np.zeros((highest - lowest + 1, 5))
    for block in range(len(cut.first) - 1):
        place = np.empty(seen, np.int64)
        for i in range(seen):
            place[i] = math.floor((cut.ground[block] + i / scale) * PLACES / pixels) - lowest
        own = cut.line[cut.first[block] : cut.first[block + 1]]
        mean_d, mean_a = kappa[own].mean(), half[own].mean()
        for r in range(cut.first[block], cut.first[block + 1]):
            p, q = kappa[cut.line[r]] - mean_d, half[cut.line[r]] - mean_a
            for i in range(seen):
                product = in_space[r, i] * slopes[r, i]
                parts[place[i], 0] += p * product
                parts[place[i], 1] += q * product
                if r > cut.first[block]:
                    parts[place[i], 2] += energy[r, i] * energy[r - 1, i]
                    parts[place[i], 3] += 0.5 * (
                        energy[r, i] * energy[r, i] + energy[r - 1, i] * energy[r - 1, i]
                    )
                    parts[place[i], 4] += 0.5 * (
                        energy[r - 1, i] * texture[r, i] - energy[r, i] * texture[r - 1, i]
                    )
    # The inverse transform weights every frequency by 2 / size.
    parts *= 0.5 * size
    return parts
