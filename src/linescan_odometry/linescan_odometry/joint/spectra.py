"""Spectra of lines, and the covariance along the lines of a texture that loses its coherence."""

import math

import numpy as np
import scipy  # loads scipy.fft at its first use, so not in processes that only read configurations
from numpy.typing import NDArray

from linescan_odometry.measurements import Lines
from omni_platform.kernels import kernel, njit

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Spectrum = NDArray[np.complex64]

HIGHEST = 0.3  # cycles per pixel: beyond, the optics pass little and what they pass is aliased
_FIRST_BAND, _BAND_GROWTH = 0.002, 1.45  # cycles per pixel; ratio: bands of equal relative width
_TAPER = 16  # a raised cosine over the 16th part of a line at either end limits leakage
_LEAST_TAPER = 0.2  # smallest taper by which a pattern is divided at the ends of a line
_SMOOTHED = 4  # bins to either side, over which a power spectrum is averaged
_COHERENCE_LAG = 6  # line spacing over which the loss of coherence is observed

_fast = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})


@_fast
def window(length: int) -> Floats:
    """Return a taper with cosine flanks, shape (length,)."""
    taper = np.ones(length, np.float32)
    flank = max(1, length // _TAPER)
    for i in range(flank):
        value = np.float32(0.5 - 0.5 * math.cos(math.pi * (i + 0.5) / flank))
        taper[i] = value
        taper[length - 1 - i] = value
    return taper


@_fast
def bands(size: int) -> NDArray[np.int64]:
    """Return the edges of frequency bands in bins of a transform of `size` px, lowest first."""
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
def transform_size(length: int) -> int:
    """Return the next even length that has no prime factors except 2, 3 and 5."""
    size = length + length % 2
    while True:
        rest = size
        for factor in (2, 3, 5):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return size
        size += 2


@_fast
def smoothed(values: Doubles) -> Doubles:
    """Return the running mean of a spectrum."""
    count = len(values)
    total = np.zeros(count + 1)
    for i in range(count):
        total[i + 1] = total[i] + values[i]
    mean = np.empty(count)
    for i in range(count):
        first, last = max(0, i - _SMOOTHED), min(count, i + _SMOOTHED + 1)
        mean[i] = (total[last] - total[first]) / (2 * _SMOOTHED + 1)
    return mean


def log_table(depth: int) -> Floats:
    """Return the logarithm of every gray level of a depth [bit]; level 0 counts as level 1."""
    return np.log(np.maximum(np.arange(1 << depth), 1)).astype(np.float32)


@kernel
def spectra_of(lines: Lines, table: Floats, taper: Floats, size: int) -> Spectrum:
    """Return the spectra of the logarithm of lines, in which gains are offsets.

    Args:
        lines: gray levels, shape (m, n).
        table: logarithm of each gray level.
        taper: factor of each pixel, shape (n,).
        size: length to which the tapered lines are padded with zeros [px].

    Returns:
        Spectra up to `HIGHEST`, shape (m, F).
    """
    padded = np.zeros((len(lines), size), np.float32)
    for k in range(len(lines)):
        row, own = padded[k], lines[k]
        total = 0.0
        for i in range(lines.shape[1]):
            row[i] = table[own[i]]
            total += row[i]
        mean = np.float32(total / lines.shape[1])
        for i in range(lines.shape[1]):
            row[i] = (row[i] - mean) * taper[i]
    spectra: Spectrum = scipy.fft.rfft(padded, size, 1)[:, : int(HIGHEST * size)].copy()
    return spectra


@kernel
def without(lines: Lines, table: Floats, pattern: Spectrum, taper: Floats, size: int) -> Floats:
    """Return the logarithm of lines less a pattern, shape (m, n).

    Args:
        lines: gray levels, shape (m, n).
        table: logarithm of each gray level.
        pattern: spectrum of the tapered logarithm of the pattern, shape (F,).
        taper: factor of each pixel, shape (n,).
        size: size of the transform [px].
    """
    whole = np.zeros(size // 2 + 1, np.complex64)
    whole[: len(pattern)] = pattern
    fixed = scipy.fft.irfft(whole, size)
    rest = np.empty(lines.shape, np.float32)
    for i in range(lines.shape[1]):
        fixed[i] /= max(taper[i], _LEAST_TAPER)
    for k in range(len(lines)):
        for i in range(lines.shape[1]):
            rest[k, i] = table[lines[k, i]] - np.float32(fixed[i])
    return rest


@_fast
def rotate(spectrum: Spectrum, step: float, start: float, turned: Spectrum) -> None:
    """Write one spectrum times ``exp(-2 pi i (start + f step))`` to `turned`; f in bins."""
    angle = -2.0 * math.pi * step
    factor = complex(math.cos(angle), math.sin(angle))
    angle = -2.0 * math.pi * start
    phase = complex(math.cos(angle), math.sin(angle))
    for f in range(len(spectrum)):
        turned[f] = spectrum[f] * np.complex64(phase)
        phase *= factor


@_fast
def phases(paths: Doubles, size: int, count: int) -> Spectrum:
    """Return ``exp(-2 pi i f X_k)`` for the first bins of a transform, shape (m, count).

    Args:
        paths: displacement X_k of every line [px], shape (m,).
        size: size of the transform [px].
        count: number of bins.
    """
    turned = np.empty((len(paths), count), np.complex64)
    ones = np.ones(count, np.complex64)
    for k in range(len(paths)):
        rotate(ones, paths[k] / size, 0.0, turned[k])
    return turned


@_fast
def covariance(
    aligned: Spectrum, first: NDArray[np.int64], edges: NDArray[np.int64], least_noise: Doubles
) -> tuple[Doubles, Doubles]:
    """Estimate the model of each band by the method of moments.

    Args:
        aligned: spectra in the ground frame, blocks of lines one after the other, shape (t, F).
        first: row of the first line of each block and, last, t, shape (blocks + 1,).
        edges: edges of the bands [bins], shape (B + 1,).
        least_noise: smallest noise power of each band; if negative, a share of the band's power.

    Returns:
        Texture power S, coherence rho of neighboring lines and noise power N, shape (3, B); the
        power of each band and its covariance at a lag of one line, shape (2, B).
    """
    count = len(edges) - 1
    real = aligned.view(np.float32)
    sums, number = np.zeros((3, 2 * edges[-1]), np.float32), np.zeros(3)
    longest = 0
    for block in range(len(first) - 1):
        longest = max(longest, first[block + 1] - first[block])
    far = min(longest - 1, _COHERENCE_LAG)
    for block in range(len(first) - 1):
        for which in range(3):
            lag = far if which == 2 else which
            number[which] += max(0, first[block + 1] - first[block] - lag)
            for k in range(first[block] + lag, first[block + 1]):
                new, old, total = real[k], real[k - lag], sums[which]
                for f in range(len(total)):
                    total[f] += new[f] * old[f]
    model, moments = np.empty((3, count)), np.empty((2, count))
    for b in range(count):
        mean = np.zeros(3)
        for which in range(3):
            for f in range(2 * edges[b], 2 * edges[b + 1]):
                mean[which] += sums[which, f]
            mean[which] /= max(number[which], 1.0) * (edges[b + 1] - edges[b])
        power = max(mean[0], 1e-9)
        near = min(max(mean[1], 1e-6 * power), 0.9999 * power)
        rho = 1.0
        if far > 1:
            rho = (min(max(mean[2], 1e-6 * power) / near, 1.0)) ** (1.0 / (far - 1))
        rho = min(max(rho, near / power, 0.01), 0.99999)
        texture = min(near / rho, power)
        floor = -least_noise[b] * power if least_noise[b] < 0.0 else least_noise[b]
        model[0, b], model[1, b], model[2, b] = texture, rho, max(power - texture, floor)
        moments[0, b], moments[1, b] = power, near
    return model, moments


@_fast
def _pivots(band: Doubles, inverse: Floats) -> tuple[float, float]:
    """Write the inverse pivots of ``1 + N A^-1`` of one band.

    Args:
        band: S, rho, N.
        inverse: receives the inverse pivots, shape (m,).

    Returns:
        Off-diagonal element of ``1 + N A^-1``, and the logarithm of the determinant of T.
    """
    texture, rho, noise = band[0], band[1], band[2]
    m = len(inverse)
    ratio = noise / (texture * (1.0 - rho * rho))
    off = -ratio * rho
    logarithm = m * math.log(texture) + (m - 1) * math.log(1.0 - rho * rho)
    pivot = 1.0
    for k in range(m):
        ends = (k == 0) + (k == m - 1)
        diagonal = 1.0 + ratio * (1.0 + rho * rho if ends == 0 else 1.0)
        if ends == 2:
            diagonal = 1.0 + noise / texture
        pivot = diagonal - (off * off / pivot if k > 0 else 0.0)
        inverse[k] = 1.0 / pivot
        logarithm += math.log(pivot)
    return off, logarithm


@_fast
def whiten(
    spectra: Spectrum, weight: Doubles, edges: NDArray[np.int64], model: Doubles, white: Spectrum
) -> float:
    """Apply T^-1 along the lines of one block, in a time proportional to their number.

    The inverse of the autoregressive part A is tridiagonal, and
    ``T^-1 = (1 - (1 + N A^-1)^-1) / N``.

    Args:
        spectra: spectra of the lines, shape (m, F).
        weight: factor of each line, shape (m,).
        edges: edges of the bands [bins], shape (B + 1,).
        model: S, rho, N of each band, see `covariance`.
        white: receives T^-1 of the weighted spectra, shape (m, F).

    Returns:
        The sum over all frequencies of the logarithm of the determinant of T.
    """
    m = len(spectra)
    determinant = 0.0
    inverse = np.empty(m, np.float32)
    lines, out = spectra.view(np.float32), white.view(np.float32)  # T is real
    for b in range(len(edges) - 1):
        i, j = 2 * edges[b], 2 * edges[b + 1]
        off, logarithm = _pivots(model[:, b], inverse)
        determinant += (edges[b + 1] - edges[b]) * logarithm
        step, scale = np.float32(off), np.float32(1.0 / model[2, b])
        for k in range(m):
            row, own, factor = out[k, i:j], lines[k, i:j], np.float32(weight[k])
            for f in range(j - i):
                row[f] = factor * own[f]
            if k > 0:
                last, ahead = out[k - 1, i:j], step * inverse[k - 1]
                for f in range(j - i):
                    row[f] -= ahead * last[f]
        for k in range(m - 1, -1, -1):
            row, part = out[k, i:j], inverse[k]
            if k < m - 1:
                after = out[k + 1, i:j]
                for f in range(j - i):
                    row[f] -= step * after[f]
            for f in range(j - i):
                row[f] *= part
        for k in range(m):
            row, own, factor = out[k, i:j], lines[k, i:j], np.float32(weight[k])
            for f in range(j - i):
                row[f] = scale * (factor * own[f] - row[f])
    return determinant
