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
from linescan_odometry.joint.covariance import covariance, pivots, whiten
from linescan_odometry.joint.spectra import Doubles, Floats, Spectrum
from linescan_odometry.matching.transforms import transform_size
from omni_core.kernels import kernel, linked

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
        length: length of the cut lines [px].
        size: length of the Fourier transform [px].
    """

    spectra: Spectrum
    line: NDArray[np.int64]
    first: NDArray[np.int64]
    ground: Doubles
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
    largest = max(np.abs(np.diff(paths)).max(), 1e-6)
    per = max(2, min(m, 1 + int(limit / largest)))
    blocks = -(-(m - 1) // (per - 1))
    first, ground = np.zeros(blocks + 1, np.int64), np.zeros(blocks)
    rows = m - 1 + blocks
    line, begin, fraction = np.zeros(rows, np.int64), np.zeros(rows, np.int64), np.zeros(rows)
    for block in range(blocks):
        start, end = round((m - 1) * block / blocks), round((m - 1) * (block + 1) / blocks)
        i, j = start + block, end + block + 1
        path = paths[start : end + 1] - paths[start]
        shift = np.rint(path)
        line[i:j] = np.arange(start, end + 1)
        begin[i:j] = (shift.max() - shift).astype(np.int64)
        fraction[i:j] = path - shift
        first[block + 1] = j
        ground[block] = paths[start] + shift.max()
        length = max(0, min(length, n - begin[i:j].max()))
    part = np.zeros((rows, max(length, 1)), np.float32)
    for r in range(rows):
        part[r, :length] = lines[line[r], begin[r] : begin[r] + length]
    size = transform_size(max(length, 16))
    cut = spectra.spectra_of(part, window(part.shape[1]), size)
    cut *= phases(fraction, size, cut.shape[1])
    return Cut(cut, line, first, ground, length, size)


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


@kernel
def _integrate(cut: Cut, white: Spectrum, model: _Model, power: Doubles, turn: Spectrum) -> Doubles:
    """Integrate the pattern out of the likelihood; return the change of the slopes, shape (2,).

    With the pattern, the covariance of the lines is ``T + V u u'``, where V is the variance of the
    pattern and u_k the factor by which line k is shifted into the ground frame. The slopes are
    those of the lines minus the posterior mean of the pattern, ``B = V u' T^-1 z / (1 + V q)`` with
    ``q = u' T^-1 u``, plus the result, which is due to the posterior variance ``V / (1 + V q)``.
    Without it, the ground texture that the mean contains would bias slow displacements.

    Args:
        cut: cut lines; the posterior mean of the pattern is subtracted from them in place.
        white: product of T^-1 and the lines, changed in the same way.
        model: covariance of the lines.
        power: variance V of the pattern at each frequency, shape (F,).
        turn: factor u of each line, shape (t, F).
    """
    own = whiten(turn, cut.first, model.edges, model.bands)
    count = len(power)
    shown, precision = np.zeros(count, np.complex64), np.zeros(count, np.float32)
    for k in range(len(turn)):
        u, w, by = turn[k], white[k], own[k]
        for f in range(count):
            shown[f] += np.conj(u[f]) * w[f]
            precision[f] += u[f].real * by[f].real + u[f].imag * by[f].imag
    variance = (power / (1.0 + power * precision)).astype(np.float32)
    pattern = variance * shown
    cut.spectra[:] -= pattern * turn
    white[:] -= pattern * own
    change = np.empty(2)
    for which in range(2):
        weight = model.along[which, cut.line].astype(np.float32)
        change[which] = (model.rate * variance * turned(turn, own, weight)).sum()
    return change


@kernel
def _shared(cut: Cut, model: _Model, power: Doubles, paths: Doubles) -> Doubles:
    """Return the loss of information on d and a due to an unknown fixed pattern, shape (2, 2).

    With ``w = T^-1 u``, ``c = V / (1 + V q)``, and ``y = (K T - T K) w``, the loss in one element
    is ``f^2 (c Re(y' T^-1 y) - 2 c^2 Im(w' K u) Im(w' K u))``. Each band is represented by its
    middle frequency.

    Args:
        cut: cut lines.
        model: covariance of the lines.
        power: variance V of the pattern at each frequency, shape (F,).
        paths: displacement of each line [px], shape (m,).
    """
    edges, (texture, rho, noise) = model.edges, model.bands
    loss = np.zeros((2, 2))
    for block in range(len(cut.first) - 1):
        line = cut.line[cut.first[block] : cut.first[block + 1]]
        m = len(line)
        first, each = np.array([0, m]), np.arange(2)
        for b in range(len(rho)):
            i, j = edges[b], edges[b + 1]
            band, variance = model.bands[:, b : b + 1].copy(), power[i:j].mean()
            angle = -0.5 * (model.rate[i] + model.rate[j - 1]) * paths[line]
            u = (np.cos(angle) + 1j * np.sin(angle)).astype(np.complex64).reshape(-1, 1)
            w = whiten(u, first, each, band)
            c = variance / (1.0 + variance * float((np.conj(u) * w).real.sum()))
            y, turned_by = np.empty((2, m), np.complex64), np.empty(2)
            for which in range(2):
                along = model.along[which, line].astype(np.float32).reshape(-1, 1)
                moved = (along * w)[:, 0]
                y[which] = (along * u)[:, 0] - np.float32(noise[b]) * moved
                before = after = np.complex64(0.0)  # sums over the lines to both sides of a line
                for k in range(m):
                    before = moved[k] + np.float32(rho[b]) * before
                    y[which, k] -= np.float32(texture[b]) * before
                for k in range(m - 1, -1, -1):
                    y[which, k] -= np.float32(texture[b]) * after
                    after = np.float32(rho[b]) * (moved[k] + after)
                turned_by[which] = float((np.conj(w) * along * u).imag.sum())
            for one in range(2):
                white = whiten(y[one].copy().reshape(-1, 1), first, each, band)[:, 0]
                for other in range(2):
                    both = c * float((np.conj(y[other]) * white).real.sum())
                    both -= 2.0 * c * c * turned_by[one] * turned_by[other]
                    loss[one, other] += both * (model.rate[i:j] ** 2).sum()
    return loss


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
    along[0] = np.arange(m) - 0.5 * (m - 1)
    along[1] = 0.5 * along[0] ** 2
    paths = motion[0] * along[0] + motion[1] * along[1]
    cut = _cut(lines, paths, limit)
    edges = bands(cut.size)
    rate = 2.0 * math.pi * np.arange(cut.spectra.shape[1]) / cut.size
    power = fixed[np.arange(len(rate)) * len(fixed) // len(rate)] * cut.length / n
    covariances, moments = covariance(cut.spectra, cut.first, edges, power)
    model = _Model(edges, covariances, rate, along)
    white = whiten(cut.spectra, cut.first, edges, covariances)
    weights = along[:, cut.line].astype(np.float32)
    expected, information = np.zeros(2), _information(cut, model)
    if power.max() > 0.0:
        turn = phases(paths[cut.line], cut.size, len(rate))
        expected = _integrate(cut, white, model, power, turn)
        information -= _shared(cut, model, power, paths)
    slopes = expected + np.array([(rate * turned(cut.spectra, white, by)).sum() for by in weights])
    slopes[1] -= motion[1] / spread**2
    information[1, 1] += 1.0 / spread**2
    determinant = information[0, 0] * information[1, 1] - information[0, 1] ** 2
    if cut.length == 0 or information[0, 0] <= 0.0 or determinant <= 0.0:
        determinant = math.nan
    (d_d, d_a), (_, a_a) = information
    inverse = np.array([[a_a, -d_a], [-d_a, d_d]]) / determinant
    by = (inverse * slopes).sum(axis=1)
    by[0] = min(max(by[0], -1.0), 1.0)  # px; the step between displacements in the slant stack
    return Expansion(cut, model, white, moments, by, inverse)
