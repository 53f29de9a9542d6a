"""Spectra of lines, and covariance between lines whose texture loses coherence from line to line.

The package docstring defines the model: displacement X_k of line k, and covariance T of the lines
with texture power S, coherence rho and noise power N. A batch is divided into blocks: groups of
consecutive lines that overlap (`likelihood.py`). In shapes, m is the number of lines of a batch, n
the number of pixels per line, t the sum of the numbers of lines of all blocks, F the number of
frequencies, and B the number of frequency bands.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_platform.kernels import kernel, linked, njit
from omni_platform.signals import Lines

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Spectrum = NDArray[np.complex64]

HIGHEST = 0.3  # cycles per pixel; the optics attenuate higher frequencies, which are also aliased
_FIRST_BAND, _BAND_GROWTH = 0.002, 1.45  # cycles per pixel; ratio of band edges
LEAST_NOISE = 0.2  # smallest ratio of noise to power in a band, so that no band dominates
_TAPER = 16  # each end of a line is tapered by a raised cosine over 1/16 of its length
_LEAST_TAPER = 0.2  # smallest taper by which a pattern is divided near the ends of a line
_SMOOTHED = 4  # bins on each side over which a power spectrum is averaged
SIGNIFICANT = 3.0  # standard deviations; larger deviations are not attributed to chance
_COHERENCE_LAG = 6  # line spacing at which the loss of coherence is measured

_fast = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
summing = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"})
"""Decorator for kernels in which the compiler may reorder the terms of a sum, for speed."""


@summing
def sum_of(values: Floats) -> float:
    """Return the sum of the elements of `values`."""
    result = np.float32(0.0)
    for i in range(len(values)):
        result += values[i]
    return float(result)


@_fast
def window(length: int) -> Floats:
    """Return a taper: a factor for each pixel, with cosine flanks, shape (length,)."""
    taper = np.ones(length, np.float32)
    flank = max(1, length // _TAPER)
    for i in range(flank):
        value = np.float32(0.5 - 0.5 * math.cos(math.pi * (i + 0.5) / flank))
        taper[i] = value
        taper[length - 1 - i] = value
    return taper


@_fast
def bands(size: int) -> NDArray[np.int64]:
    """Return the edges of B frequency bands [bins of a transform of `size` px], shape (B + 1,)."""
    use = int(HIGHEST * size)
    edges = np.empty(64, np.int64)
    edges[0], count = 1, 1
    edge = _FIRST_BAND * size
    while edge < use - 4:
        if round(edge) > edges[count - 1]:
            edges[count] = round(edge)
            count += 1
        edge *= _BAND_GROWTH
    edges[count] = use
    return edges[: count + 1]


@_fast
def smoothed(values: Doubles) -> Doubles:
    """Return the values of a spectrum, averaged over neighboring frequencies, shape (F,)."""
    count = len(values)
    total = np.zeros(count + 1)
    for i in range(count):
        total[i + 1] = total[i] + values[i]
    mean = np.empty(count)
    for i in range(count):
        first, last = max(0, i - _SMOOTHED), min(count, i + _SMOOTHED + 1)
        mean[i] = (total[last] - total[first]) / (2 * _SMOOTHED + 1)
    return mean


def log_table() -> Floats:
    """Return the logarithm of each gray level, shape (2^16,); level 0 counts as level 1."""
    return np.log(np.maximum(np.arange(1 << 16), 1)).astype(np.float32)


@linked
@kernel
def logarithms(lines: Lines, table: Floats) -> Floats:
    """Return the logarithm of the gray levels of lines, shape (m, n).

    The logarithm converts the unknown gain of a pixel to an offset.

    Args:
        lines: gray levels, shape (m, n).
        table: logarithm of each gray level.
    """
    logs = np.empty(lines.shape, np.float32)
    for k in range(lines.shape[0]):
        for i in range(lines.shape[1]):
            logs[k, i] = table[lines[k, i]]
    return logs


@linked
@kernel
def spectra_of(logs: Floats, taper: Floats, size: int) -> Spectrum:
    """Return the spectra of the logarithm of lines.

    Args:
        logs: logarithm of the gray levels, shape (m, n).
        taper: factor by which each pixel is multiplied before the transform, shape (n,).
        size: length to which the tapered lines are padded with zeros [px].

    Returns:
        Spectra at the F frequencies up to `HIGHEST`, shape (m, F).
    """
    padded = np.zeros((len(logs), size), np.float32)
    for k in range(len(logs)):
        row, own = padded[k], logs[k]
        mean = np.float32(sum_of(own) / len(own))
        for i in range(len(own)):
            row[i] = (own[i] - mean) * taper[i]
    spectra: Any = np.fft.rfft(padded, size, 1)
    result: Spectrum = spectra[:, : int(HIGHEST * size)].copy()
    return result


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
    whole[: len(pattern)] = pattern
    fixed = np.fft.irfft(whole, size)[: logs.shape[1]] / np.maximum(taper, _LEAST_TAPER)
    rest: Floats = logs - fixed.astype(np.float32)
    return rest


@_fast
def phases(paths: Doubles, size: int, count: int) -> Spectrum:
    """Return ``exp(-2 pi i f X_k)`` at the lowest frequencies f of a transform, shape (m, count).

    Args:
        paths: displacement X_k of each line [px], shape (m,).
        size: size of the transform [px].
        count: number of bins.
    """
    turned = np.empty((len(paths), count), np.complex64)
    for k in range(len(paths)):
        angle = -2.0 * math.pi * paths[k] / size
        factor = complex(math.cos(angle), math.sin(angle))
        row, known = turned[k], 1
        row[0] = 1.0
        while known < count:  # each pass doubles the number of bins
            ahead, after = np.complex64(factor), row[known:]
            for f in range(min(known, len(after))):
                after[f] = row[f] * ahead
            known *= 2
            factor *= factor
    return turned


@_fast
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


@_fast
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
    longest = 0
    for block in range(len(first) - 1):
        longest = max(longest, first[block + 1] - first[block])
    far = min(longest - 1, _COHERENCE_LAG)
    sums, number = _products(aligned.view(np.float32), first, far, 2 * edges[-1])
    model, moments = np.empty((3, count)), np.empty((2, count))
    for b in range(count):
        mean = np.zeros(3)
        for which in range(3):
            for f in range(2 * edges[b], 2 * edges[b + 1]):
                mean[which] += sums[which, f]
            mean[which] /= max(number[which], 1.0) * (edges[b + 1] - edges[b])
        power, pattern = max(mean[0], 1e-9), fixed[edges[b] : edges[b + 1]].mean()
        # Over few frequencies, the power of a pattern may exceed its expectation by chance.
        pattern *= 1.0 + SIGNIFICANT / math.sqrt(edges[b + 1] - edges[b])
        near = min(max(mean[1] - pattern, 1e-6 * power), 0.9999 * power)
        rho, whole = 1.0, max(power - pattern, near)
        if far > 1:
            rho = (min(max(mean[2] - pattern, 1e-6 * power) / near, 1.0)) ** (1.0 / (far - 1))
        rho = min(max(rho, near / whole, 0.01), 0.99999)
        texture = min(near / rho, whole)
        model[0, b], model[1, b] = texture, rho
        model[2, b] = max(power - texture, LEAST_NOISE * power)
        moments[0, b], moments[1, b] = power, near
    return model, moments


@_fast
def independent(square: Floats, distances: NDArray[np.int64], lines: int) -> Floats:
    """Return the effective number of independent pairs of lines at D line spacings, shape (D, F).

    Texture that remains in view contributes the same product of two lines to several pairs. By
    Bartlett's formula (1946), N pairs count as ``N / (1 + 2 sum_j (1 - j / N) gamma_j^2)``, where
    gamma_j is the coherence of lines at a spacing j, interpolated between the given spacings.

    Args:
        square: square of the coherence at each spacing, shape (D, F).
        distances: the line spacings [lines], shape (D,).
        lines: number of lines m.
    """
    last = len(distances) - 1
    number = np.ones(square.shape, np.float32)
    for which in range(len(distances)):
        pairs = lines - distances[which]
        share = np.zeros(len(distances) + 1)  # weights at spacing 0 and at `distances`
        after = 0
        for j in range(1, pairs):
            while after < last and distances[after] < j:
                after += 1
            before = distances[after - 1] if after > 0 else 0
            part = min((j - before) / max(distances[after] - before, 1), 1.0)
            share[after] += 2.0 * (1.0 - j / pairs) * (1.0 - part)
            share[after + 1] += 2.0 * (1.0 - j / pairs) * part
        for f in range(square.shape[1]):
            total = 1.0 + share[0]
            for d in range(len(distances)):
                total += share[d + 1] * square[d, f]
            number[which, f] = max(pairs, 1) / total
    return number


@_fast
def pivots(band: Doubles, inverse: Floats | Doubles) -> float:
    """Write to `inverse` the inverse pivots of the matrix ``1 + N A^-1`` of one frequency band.

    The matrix is tridiagonal. Its pivots are those of Gaussian elimination. A is the autoregressive
    part of the covariance, ``A_kj = S rho^|k - j|``.

    Args:
        band: texture power S, coherence rho and noise power N.
        inverse: output, the inverse pivots, shape (m,).

    Returns:
        Off-diagonal element of the matrix.
    """
    texture, rho, noise = band[0], band[1], band[2]
    m = len(inverse)
    ratio = noise / (texture * (1.0 - rho * rho))
    off: float = -ratio * rho
    pivot = 1.0
    for k in range(m):
        ends = (k == 0) + (k == m - 1)
        diagonal = 1.0 + ratio * (1.0 + rho * rho if ends == 0 else 1.0)
        if ends == 2:
            diagonal = 1.0 + noise / texture
        pivot = diagonal - (off * off / pivot if k > 0 else 0.0)
        inverse[k] = 1.0 / pivot
    return off


@_fast
def whiten(spectra: Spectrum, edges: NDArray[np.int64], model: Doubles, white: Spectrum) -> None:
    """Multiply the lines of one block by T^-1, and write the product to `white`.

    The cost is proportional to the number of lines. The covariance of the lines is ``T = A + N``:
    an autoregressive part A, and white noise of power N. The inverse of A is tridiagonal, and
    ``T^-1 = (1 - (1 + N A^-1)^-1) / N``.

    Args:
        spectra: spectra of the lines, shape (m, F).
        edges: edges of the bands [bins], shape (B + 1,).
        model: texture power S, coherence rho and noise power N of each band, shape (3, B).
        white: output, T^-1 times the spectra, shape (m, F).
    """
    m = len(spectra)
    inverse = np.empty(m, np.float32)
    lines, out = spectra.view(np.float32), white.view(np.float32)  # T is real
    for b in range(len(edges) - 1):
        i, j = 2 * edges[b], 2 * edges[b + 1]
        off, scale = np.float32(pivots(model[:, b], inverse)), np.float32(1.0 / model[2, b])
        out[0, i:j] = lines[0, i:j]
        for k in range(1, m):
            row, own, last = out[k, i:j], lines[k, i:j], out[k - 1, i:j]
            ahead = off * inverse[k - 1]
            for f in range(j - i):
                row[f] = own[f] - ahead * last[f]
        for k in range(m - 1, -1, -1):
            row, part = out[k, i:j], inverse[k]
            if k < m - 1:
                after = out[k + 1, i:j]
                for f in range(j - i):
                    row[f] = (row[f] - off * after[f]) * part
            else:
                for f in range(j - i):
                    row[f] *= part
        for k in range(m):
            row, own = out[k, i:j], lines[k, i:j]
            for f in range(j - i):
                row[f] = scale * (own[f] - row[f])
