"""Covariance of the lines, and second-order expansion of the log-likelihood of a displacement.

The lines of a batch are divided into blocks, groups of consecutive lines that overlap; neighboring
blocks have one line in common. The lines of a block are cut to the ground that all of them show, so
that no texture enters or leaves. The spectra of the cut lines are then computed.

The package docstring defines the model: displacement d per line, its change a, displacement X_k of
line k, and covariance T of the lines with texture power S, coherence rho and noise power N. In
shapes, m is the number of lines of a batch, t the sum of the numbers of lines of all blocks, F the
number of spatial frequencies, and B the number of frequency bands.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.joint import spectra
from linescan_odometry.joint.candidates import bands, phases
from linescan_odometry.joint.spectra import Doubles, Floats, Spectrum
from linescan_odometry.matching.transforms import transform_size
from omni_core.kernels import kernel, linked

LEAST_NOISE = 0.2  # smallest ratio of noise to power in a band, so that no band dominates
_COHERENCE_LAG = 6  # line spacing at which the loss of coherence is measured
_TAPER = 16  # each end of a line is tapered by a raised cosine over 1/16 of its length
_LEAST_TAPER = 0.2  # smallest taper by which a pattern is divided near the ends of a line


class _Model(NamedTuple):
    """Covariance model of the lines at each frequency.

    Attributes:
        edges: edges of the frequency bands [bins], shape (B + 1,).
        bands: texture power S, coherence rho and noise power N of each band, shape (3, B).
        rate: angular frequency of each bin [rad per px], shape (F,).
        along: derivatives of the displacement of each line with respect to d and a, shape (2, m).
    """

    edges: NDArray[np.int64]
    bands: Doubles
    rate: Doubles
    along: Doubles


class Cut(NamedTuple):
    """Lines of a batch, cut to the ground that all lines of a block show.

    Attributes:
        spectra: spectra in the ground frame, shape (t, F).
        line: index of the line in each row, shape (t,).
        first: row of each block's first line, then the number of rows t, shape (blocks + 1,).
        ground: ground position at which each block begins [px], shape (blocks,).
        pixel: pixel at which each block begins, mean over its lines, shape (blocks,).
        length: length of the cut lines [px].
        size: length of the Fourier transform [px].
    """

    spectra: Spectrum
    line: NDArray[np.int64]
    first: NDArray[np.int64]
    ground: Doubles
    pixel: Doubles
    length: int
    size: int


class Expansion(NamedTuple):
    """Second-order expansion of the log-likelihood near a displacement and its change.

    Attributes:
        cut: cut lines.
        model: covariance model of the lines.
        white: spectra of the lines multiplied by the inverse covariance, shape (t, F).
        moments: power of each band, and covariance of neighboring lines in it, shape (2, B).
        step: Newton step in d and a [px], not finite without information, shape (2,).
        inverse: inverse of the Fisher information on d and a, shape (2, 2); not finite if the
            information is singular.
    """

    cut: Cut
    model: _Model
    white: Spectrum
    moments: Doubles
    step: Doubles
    inverse: Doubles


@linked
@kernel
def observe(
    transformed: Spectrum, removed: Spectrum, paths: Doubles, size: int
) -> spectra.FixedPattern:
    """Return the pattern estimated from one batch with known displacements.

    Args:
        transformed: spectra of the logarithm of whole lines, shape (m, F).
        removed: pattern to subtract before the covariance is estimated, shape (F,).
        paths: displacement of each line [px], shape (m,).
        size: length of the Fourier transform [px].
    """
    m, count = transformed.shape
    turn, edges = phases(paths, size, count), bands(size)
    aligned, first = (transformed - removed) * turn, np.array([0, m])
    model, _ = covariance(aligned, first, edges, np.zeros(count))
    white = whiten(turn, first, edges, model)
    information, precision = np.zeros(count, np.complex64), np.zeros(count, np.float32)
    for k in range(m):
        row, own, seen = white[k], turn[k], transformed[k]
        for f in range(count):
            information[f] += np.conj(row[f]) * own[f] * seen[f]
            precision[f] += row[f].real * own[f].real + row[f].imag * own[f].imag
    return spectra.FixedPattern(information, precision.astype(np.float64))


@spectra.fast
def covariance(
    aligned: Spectrum, first: NDArray[np.int64], edges: NDArray[np.int64], fixed: Doubles
) -> tuple[Doubles, Doubles]:
    """Return the covariance model of each band, estimated by the method of moments.

    Args:
        aligned: spectra in the ground frame, blocks of lines one after the other, shape (t, F).
        first: row of each block's first line, then the number of rows t, shape (blocks + 1,).
        edges: edges of the bands [bins], shape (B + 1,).
        fixed: power of the fixed pattern in the lines, which is not counted as texture, shape (F,).

    Returns:
        Texture power S, coherence rho of neighboring lines and noise power N, shape (3, B); the
        power of each band and the covariance of neighboring lines in it, shape (2, B).
    """
    count = len(edges) - 1
    far = min((first[1:] - first[:-1]).max() - 1, _COHERENCE_LAG)
    sums, number = _products(aligned.view(np.float32), first, far, 2 * edges[-1])
    model, moments = np.empty((3, count)), np.empty((2, count))
    mean = np.empty(3)
    for b in range(count):
        for which in range(3):
            mean[which] = 0.0
            for f in range(2 * edges[b], 2 * edges[b + 1]):
                mean[which] += sums[which, f]
            mean[which] /= max(number[which], 1.0) * (edges[b + 1] - edges[b])
        power, pattern = max(mean[0], 1e-9), fixed[edges[b] : edges[b + 1]].mean()
        # Over few frequencies, the power of a pattern may exceed its expectation by chance.
        pattern *= 1.0 + spectra.SIGNIFICANT / math.sqrt(edges[b + 1] - edges[b])
        near = min(max(mean[1] - pattern, 1e-6 * power), 0.9999 * power)
        rho, whole = 1.0, max(power - pattern, near)
        if far > 1:
            rho = (min(max(mean[2] - pattern, 1e-6 * power) / near, 1.0)) ** (1.0 / (far - 1))
        rho = min(max(rho, near / whole, 0.01), 0.99999)
        texture = min(near / rho, whole)
        model[0, b], model[1, b] = texture, rho
        model[2, b] = max(power - texture, LEAST_NOISE * power)
        moments[0, b], moments[1, b] = power, mean[1] - pattern
    return model, moments


@spectra.fast
def _products(
    real: Floats, first: NDArray[np.int64], far: int, size: int
) -> tuple[Floats, Doubles]:
    """Return sums of the products of two lines in the same block, at three line spacings.

    Args:
        real: real and imaginary parts of the spectra in the ground frame, shape (t, 2 F).
        first: row of the first line of each block, followed by the number of rows.
        far: largest of the spacings 0, 1 and `far` [lines].
        size: number of columns of `real` that are used.

    Returns:
        Sums, shape (3, size), and number of products in each sum, shape (3,).
    """
    sums, number = np.zeros((3, size), np.float32), np.zeros(3)
    for block in range(len(first) - 1):
        for which in range(3):
            lag = far if which == 2 else which
            number[which] += max(0, first[block + 1] - first[block] - lag)
            for k in range(first[block] + lag, first[block + 1]):
                new, old, total = real[k], real[k - lag], sums[which]
                for f in range(len(total)):
                    total[f] += new[f] * old[f]
    return sums, number


@spectra.fast
def whiten(
    spectra: Spectrum, first: NDArray[np.int64], edges: NDArray[np.int64], model: Doubles
) -> Spectrum:
    """Return the product of T^-1 and the lines of each block, shape (t, F); 0 outside all bands.

    The cost is proportional to the number of lines. The covariance of the lines is ``T = A + N``:
    an autoregressive part A, and white noise of power N. The inverse of A is tridiagonal, and
    ``T^-1 = (1 - (1 + N A^-1)^-1) / N``.

    Args:
        spectra: spectra of the lines, blocks of lines one after the other, shape (t, F).
        first: row of each block's first line, then the number of rows t, shape (blocks + 1,).
        edges: edges of the bands [bins], shape (B + 1,).
        model: texture power S, coherence rho and noise power N of each band, shape (3, B).
    """
    white = np.zeros_like(spectra)
    for block in range(len(first) - 1):
        start, end = first[block], first[block + 1]
        lines = spectra[start:end].view(np.float32)  # T is real
        out = white[start:end].view(np.float32)
        m = end - start
        inverse = np.empty(m, np.float32)
        for b in range(len(edges) - 1):
            i, j = 2 * edges[b], 2 * edges[b + 1]
            off, scale = np.float32(pivots(model[:, b], inverse)), np.float32(1.0 / model[2, b])
            for f in range(i, j):
                out[0, f] = lines[0, f]
            for k in range(1, m):
                row, own, last = out[k, i:j], lines[k, i:j], out[k - 1, i:j]
                ahead = off * inverse[k - 1]
                for f in range(j - i):
                    row[f] = own[f] - ahead * last[f]
            row = out[m - 1, i:j]
            row *= inverse[m - 1]
            for k in range(m - 2, -1, -1):
                row, part, after = out[k, i:j], inverse[k], out[k + 1, i:j]
                for f in range(j - i):
                    row[f] = (row[f] - off * after[f]) * part
            for k in range(m):
                row, own = out[k, i:j], lines[k, i:j]
                for f in range(j - i):
                    row[f] = scale * (own[f] - row[f])
    return white


@spectra.fast
def pivots(band: Doubles, inverse: Floats | Doubles) -> float:
    """Write to `inverse` the inverse pivots of the matrix ``1 + N A^-1`` of one frequency band.

    The matrix is tridiagonal. Its pivots are those of Gaussian elimination. A is the autoregressive
    part of the covariance, ``A_kj = S rho^|k - j|``.

    Args:
        band: texture power S, coherence rho and noise power N.
        inverse: output, the inverse pivots, shape (m,); at least two.

    Returns:
        Off-diagonal element of the matrix.
    """
    texture, rho, noise = band[0], band[1], band[2]
    m = len(inverse)
    ratio = noise / (texture * (1.0 - rho * rho))
    off: float = -ratio * rho
    inverse[0] = 1.0 / (1.0 + ratio)
    for k in range(1, m):
        diagonal = 1.0 + ratio * (1.0 + rho * rho if k < m - 1 else 1.0)
        inverse[k] = 1.0 / (diagonal - off * off * inverse[k - 1])
    return off


@linked
@kernel
def without(logs: Floats, pattern: Spectrum, taper: Floats, size: int) -> Floats:
    """Return the logarithm of lines after subtraction of a fixed pattern, shape (m, n).

    Args:
        logs: logarithm of the gray levels, shape (m, n).
        pattern: spectrum of the tapered logarithm of the pattern, shape (F,).
        taper: factor of each pixel in `pattern`, shape (n,).
        size: length of the Fourier transform [px].
    """
    whole = np.zeros(size // 2 + 1, np.complex64)
    for f in range(len(pattern)):
        whole[f] = pattern[f]
    fixed = np.fft.irfft(whole, size)[: logs.shape[1]] / np.maximum(taper, _LEAST_TAPER)
    rest: Floats = logs - fixed.astype(np.float32)
    return rest


@kernel
def _cut(lines: Floats, paths: Doubles, limit: int) -> Cut:
    """Return the lines, grouped into blocks and cut to the ground that the lines of a block share.

    Args:
        lines: logarithm of the gray levels, minus the fixed pattern, shape (m, n).
        paths: displacement of each line [px], shape (m,).
        limit: limit on the shift between two compared lines [px].
    """
    m, n = lines.shape
    length = n
    largest = max(np.abs(paths[1:] - paths[:-1]).max(), 1e-6)
    per = max(2, min(m, 1 + int(limit / largest)))
    blocks = -(-(m - 1) // (per - 1))
    first, (ground, pixel) = np.zeros(blocks + 1, np.int64), np.zeros((2, blocks))
    rows = m - 1 + blocks
    line, begin, fraction = np.zeros(rows, np.int64), np.zeros(rows, np.int64), np.zeros(rows)
    for block in range(blocks):
        start, end = round((m - 1) * block / blocks), round((m - 1) * (block + 1) / blocks)
        i, j = start + block, end + block + 1
        path = paths[start : end + 1] - paths[start]
        shift = np.rint(path)
        farthest = shift.max()
        for k in range(len(path)):
            line[i + k] = start + k
            begin[i + k] = int(farthest - shift[k])
            fraction[i + k] = path[k] - shift[k]
        first[block + 1] = j
        ground[block] = paths[start] + farthest
        pixel[block] = farthest - path.mean()
        length = max(0, min(length, n - begin[i:j].max()))
    part = np.zeros((rows, max(length, 1)), np.float32)
    for r in range(rows):
        row, whole = part[r], lines[line[r], begin[r] :]
        for i in range(length):
            row[i] = whole[i]
    size = transform_size(max(length, 16))
    cut = spectra.spectra_of(part, window(part.shape[1]), size)
    cut *= phases(fraction, size, cut.shape[1])
    return Cut(cut, line, first, ground, pixel, length, size)


@spectra.fast
def window(length: int) -> Floats:
    """Return a taper: a factor for each pixel, with cosine flanks, shape (length,)."""
    taper = np.ones(length, np.float32)
    flank = max(1, length // _TAPER)
    for i in range(flank):
        taper[i] = taper[length - 1 - i] = 0.5 - 0.5 * math.cos(math.pi * (i + 0.5) / flank)
    return taper


@kernel
def turned(lines: Spectrum, products: Spectrum, weight: Floats) -> Floats:
    """Return the sum of ``Im(conj(z) w)`` over the lines, shape (F,).

    Args:
        lines: spectra z, shape (t, F).
        products: products w of a matrix and z, shape (t, F).
        weight: weight of each line in the sum, shape (t,).
    """
    total = np.zeros(lines.shape[1], np.float32)
    for r in range(len(lines)):
        z, w, by = lines[r], products[r], weight[r]
        for f in range(len(total)):
            total[f] += by * (w[f].imag * z[f].real - w[f].real * z[f].imag)
    return total


@kernel
def _information(cut: Cut, model: _Model) -> Doubles:
    """Return the Fisher information on d and a, shape (2, 2), summed over the frequency bands.

    Let ``B = K T - T K``, where K is the diagonal matrix of the derivatives of the paths. The
    information is ``-f^2 tr(T^-1 B T^-1 B)``. The negative trace equals the sum of
    ``(T^-1)_kj T_kj (K_k - K_j)^2`` over all lines k and j, where ``K_k`` is the derivative of the
    path of line k.

    Args:
        cut: cut lines.
        model: covariance of the lines.
    """
    edges, (texture, rho, noise) = model.edges, model.bands
    share, off = texture / noise, np.empty(len(rho))
    for b in range(len(rho)):
        share[b] *= (model.rate[edges[b] : edges[b + 1]] ** 2).sum()
    total = np.zeros((2, 2))
    for block in range(len(cut.first) - 1):
        i, j = cut.first[block], cut.first[block + 1]
        inverse = np.empty((j - i, len(rho)))
        for b in range(len(rho)):
            off[b] = pivots(model.bands[:, b], inverse[:, b])
        along = model.along[:, cut.line[i:j]]
        d_d = d_a = a_a = 0.0
        diagonal, element = np.zeros(len(off)), np.empty(len(off))
        for k in range(len(inverse) - 1, -1, -1):
            # The elements of (1 + N A^-1)^-1, one row after the other.
            for b in range(len(off)):
                diagonal[b] = inverse[k, b] + (off[b] * inverse[k, b]) ** 2 * diagonal[b]
                element[b] = share[b] * diagonal[b]
            for h in range(k - 1, -1, -1):
                common = 0.0
                for b in range(len(off)):
                    element[b] *= -off[b] * rho[b] * inverse[h, b]
                    common += element[b]
                by_d, by_a = along[0, k] - along[0, h], along[1, k] - along[1, h]
                d_d += common * by_d * by_d
                d_a += common * by_d * by_a
                a_a += common * by_a * by_a
        total += np.array([[d_d, d_a], [d_a, a_a]])
    return total


@linked
@kernel
def expand(lines: Floats, fixed: Doubles, motion: Doubles, limit: int, spread: float) -> Expansion:
    """Return the expansion of the log-likelihood at a displacement and its change.

    Args:
        lines: logarithm of the gray levels, minus the fixed pattern, shape (m, n).
        fixed: power of the fixed pattern that the lines still contain, at the frequencies of whole
            lines, shape (F,).
        motion: displacement per line in the middle of the batch [px] and its change from line to
            line [px], shape (2,).
        limit: limit on the shift between two compared lines [px].
        spread: prior standard deviation of the change [px].
    """
    m, n = lines.shape
    along = np.empty((2, m))
    for k in range(m):
        along[0, k] = k - 0.5 * (m - 1)
        along[1, k] = 0.5 * along[0, k] ** 2
    paths = motion[0] * along[0] + motion[1] * along[1]
    cut = _cut(lines, paths, limit)
    edges = bands(cut.size)
    rate = 2.0 * math.pi * np.arange(cut.spectra.shape[1]) / cut.size
    power = fixed[np.arange(len(rate)) * len(fixed) // len(rate)] * cut.length / n
    covariances, moments = covariance(cut.spectra, cut.first, edges, power)
    model = _Model(edges, covariances, rate, along)
    white = whiten(cut.spectra, cut.first, edges, covariances)
    weights = along[:, cut.line].astype(np.float32)
    slopes = np.array([(rate * turned(cut.spectra, white, by)).sum() for by in weights])
    slopes[1] -= motion[1] / spread**2
    information = _information(cut, model)
    information[1, 1] += 1.0 / spread**2
    determinant = information[0, 0] * information[1, 1] - information[0, 1] ** 2
    if cut.length == 0 or information[0, 0] <= 0.0 or determinant <= 0.0:
        determinant = math.nan
    (d_d, d_a), (_, a_a) = information
    inverse = np.array([[a_a, -d_a], [-d_a, d_d]]) / determinant
    by = inverse[:, 0] * slopes[0] + inverse[:, 1] * slopes[1]
    by[0] = min(max(by[0], -1.0), 1.0)  # px; the step between displacements in the slant stack
    return Expansion(cut, model, white, moments, by, inverse)
