"""Covariance of the lines of each frequency band, and products of its inverse with the lines.

The package docstring defines the model: texture power S, coherence rho and noise power N. In
shapes, t is the sum of the numbers of lines of all blocks, F the number of spatial frequencies, and
B the number of frequency bands.
"""

import math

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.joint import spectra
from linescan_odometry.joint.spectra import Doubles, Floats, Spectrum

LEAST_NOISE = 0.2  # smallest ratio of noise to power in a band, so that no band dominates
_COHERENCE_LAG = 6  # line spacing at which the loss of coherence is measured


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
    far = min(np.diff(first).max() - 1, _COHERENCE_LAG)
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
        pattern *= 1.0 + spectra.SIGNIFICANT / math.sqrt(edges[b + 1] - edges[b])
        near = min(max(mean[1] - pattern, 1e-6 * power), 0.9999 * power)
        rho, whole = 1.0, max(power - pattern, near)
        if far > 1:
            rho = (min(max(mean[2] - pattern, 1e-6 * power) / near, 1.0)) ** (1.0 / (far - 1))
        rho = min(max(rho, near / whole, 0.01), 0.99999)
        texture = min(near / rho, whole)
        model[0, b], model[1, b] = texture, rho
        noise = max(whole - texture, mean[0] - mean[1] - texture * (1.0 - rho))
        model[2, b] = max(noise, LEAST_NOISE * whole)
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
            out[0, i:j] = lines[0, i:j]
            for k in range(1, m):
                row, own, last = out[k, i:j], lines[k, i:j], out[k - 1, i:j]
                ahead = off * inverse[k - 1]
                for f in range(j - i):
                    row[f] = own[f] - ahead * last[f]
            out[m - 1, i:j] *= inverse[m - 1]
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
