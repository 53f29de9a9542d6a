"""Candidates for the displacement, and the choice between them.

The candidates are peaks of a slant stack (wideband velocity spectrum). For each displacement per
line, the whitened correlations of lines at several spacings are summed at the shifts that this
displacement causes. A sensor array sums its channels in the same way for each direction of arrival.

The likelihood of each candidate is computed from the correlations of the lines after the fixed
pattern, or the mean of all lines, has been subtracted.

In shapes, m is the number of lines, n the number of pixels per line, F the number of spatial
frequencies, B the number of frequency bands, and c the number of candidates.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.joint import spectra
from linescan_odometry.joint.spectra import Doubles, Floats, Spectrum
from omni_core.kernels import kernel, linked

_PEAKS = 2  # number of candidates from each stack
APART = 8  # px per line; smallest distance between two peaks
_COARSEST = 100.0  # px; size of the largest texture details that pass the filter of the stack
SPACINGS = 4  # number of line spacings that are correlated
# Highest frequency at which candidates are compared [cycles per pixel].
COMPARED = 0.5 * spectra.HIGHEST
LIKELY = 25.0  # nats; smallest log-likelihood of a valid displacement
# Ratio of the second-best log-likelihood to the best one; above it, the peak is ambiguous.
RATIO = 0.5
_FIRST_BAND, _BAND_GROWTH = 0.002, 1.45  # cycles per pixel; ratio of band edges


@kernel
def spacings(lines: int) -> NDArray[np.int64]:
    """Return the four line spacings at which a batch is correlated, 1 to lines / 3, shape (4,).

    They are rounded down, because `farthest` excludes spacings above a third of the lines.
    """
    powers = [(lines / 3.0) ** (which / (SPACINGS - 1.0)) for which in range(SPACINGS)]
    return np.array([max(1, math.floor(power)) for power in powers])


class Layout(NamedTuple):
    """Dimensions of a batch of lines and of its Fourier transform.

    Attributes:
        lines: number of lines m.
        pixels: pixels per line n.
        size: length of the Fourier transform [px].
        limit: limit on the shift between two compared lines [px].
    """

    lines: int
    pixels: int
    size: int
    limit: int


class Correlation(NamedTuple):
    """Correlations between the lines of a batch at four line spacings and all frequencies.

    Attributes:
        lagged: mean cross spectrum of the pairs of lines at each spacing, shape (4, F).
        power: mean power spectrum of the lines, shape (F,).
        number: effective number of independent pairs at each spacing, shape (4, F).
    """

    lagged: Spectrum
    power: Floats
    number: Floats


def band_pass(size: int, count: int) -> Floats:
    """Return the weight of the first `count` frequencies in the slant stack [1], shape (count,)."""
    f = np.arange(count) / size
    band = np.cos(0.5 * np.pi * f / spectra.HIGHEST) ** 2
    weight: Doubles = -np.expm1(-((_COARSEST * f) ** 2)) * band
    return weight.astype(np.float32)


@linked
@kernel
def correlate(lines: Spectrum, fixed: Spectrum) -> Correlation:
    """Return the correlations between the lines of a batch after subtraction of a fixed pattern.

    Args:
        lines: spectra of the lines, shape (m, F).
        fixed: spectrum of the fixed pattern or of the mean of all lines, shape (F,).
    """
    m, count = lines.shape
    distances, rest = spacings(m), lines - fixed
    lagged, power = np.zeros((SPACINGS, count), np.complex64), spectra.power_of(rest)
    shared = np.zeros((SPACINGS, count), np.float32)
    power *= np.float32(1.0 / m)
    for which in range(SPACINGS):
        products, lag = lagged[which], distances[which]
        for k in range(lag, m):
            new, old = rest[k], rest[k - lag]
            for f in range(count):
                products[f] += new[f] * np.conj(old[f])
        # For noise alone, the squared coherence of N pairs is 1 / N on average.
        noise = 1.0 / (m - lag)
        products *= np.float32(noise)
        for f in range(count):
            energy = products[f].real ** 2 + products[f].imag ** 2
            coherence = energy / max(power[f] * power[f], 1e-18)
            shared[which, f] = min(max((coherence - noise) / max(1.0 - noise, 1e-9), 0.0), 1.0)
    return Correlation(lagged, power, independent(shared, distances, m))


@spectra.fast
def independent(square: Floats, distances: NDArray[np.int64], lines: int) -> Floats:
    """Return the effective number of independent pairs of lines at D line spacings, shape (D, F).

    Texture that remains in view contributes the same product of two lines to several pairs. By
    Bartlett's formula (1946), N pairs count as ``N / (1 + 2 sum_j (1 - j / N) gamma_j^2)``, where
    gamma_j is the coherence of lines at the largest given spacing up to j.

    Args:
        square: square of the coherence at each spacing, shape (D, F).
        distances: the line spacings [lines], shape (D,).
        lines: number of lines m.
    """
    number = np.ones(square.shape, np.float32)
    for which in range(len(distances)):
        pairs = lines - distances[which]
        share = np.zeros(len(distances))
        for j in range(1, pairs):
            share[np.searchsorted(distances, j, "right") - 1] += 2.0 * (1.0 - j / pairs)
        for f in range(square.shape[1]):
            total = 1.0
            for d in range(len(distances)):
                total += share[d] * square[d, f]
            number[which, f] = max(pairs, 1) / total
    return number


@linked
@kernel
def find(
    correlations: tuple[Correlation, Correlation], layout: Layout, weight: Floats, last: float
) -> Doubles:
    """Return candidates for the displacement per line [px]: `last` and the peaks, shape (c,).

    Args:
        correlations: correlations after subtraction of the present estimate of the fixed pattern,
            and after subtraction of the mean of all lines, in which no fixed pattern remains.
        layout: sizes of the batch.
        weight: weight of each frequency, from `band_pass`, shape (F,).
        last: displacement per line in the previous batch [px]; NaN without a previous batch.
    """
    size, limit = layout.size, layout.limit
    distances = spacings(layout.lines)
    found = np.empty(1 + 2 * _PEAKS)
    number = 0
    if np.isfinite(last):
        found[0], number = last, 1
    for own in correlations:
        whitening = weight / np.maximum(spectra.smoothed(own.power), 1e-9)
        whitened = np.zeros((SPACINGS, size // 2 + 1), np.complex64)
        for which in range(SPACINGS):
            for f in range(len(weight)):
                whitened[which, f] = own.lagged[which, f] * np.float32(whitening[f])
        correlation: Floats = np.fft.irfft(whitened, size, 1)  # type: ignore[assignment]  # 32 bits
        stack = np.full(2 * limit + 1, -np.inf)
        for d in range(-limit, limit + 1):
            value, terms = 0.0, 0
            for which in range(SPACINGS):
                lag = distances[which]
                if abs(lag * d) < limit or lag == 1:
                    value += correlation[which, -lag * d]
                    terms += 1
            stack[d + limit] = value / np.sqrt(terms)
        for _ in range(_PEAKS):
            best = int(np.argmax(stack)) - limit
            if stack[best + limit] == -np.inf:
                break
            found[number] = _refined(correlation, best, layout)
            number += 1
            stack[max(0, best + limit - APART) : best + limit + APART + 1] = -np.inf
    return found[:number]


@kernel
def farthest(displacement: float, layout: Layout) -> int:
    """Return the index in `spacings` of the largest spacing at which lines still overlap enough.

    The argument `displacement` is the displacement per line [px].
    """
    distances = spacings(layout.lines)
    for which in range(SPACINGS - 1, 0, -1):
        lag = distances[which]
        if 3 * lag <= layout.lines and abs(lag * displacement) < layout.limit:
            return which
    return 0


@kernel
def _refined(correlation: Floats, peak: int, layout: Layout) -> float:
    """Return the displacement per line near an integer `peak`, to a fraction of a pixel [px].

    It is the maximum of the sum of the correlations, shape (4, size), over all spacings at which
    lines overlap enough. The largest of these spacings resolves the displacement best. If the
    camera moves across its axis, lines at this spacing may show different ground; smaller spacings
    then determine the maximum.
    """
    distances, last = spacings(layout.lines), farthest(peak, layout)
    fine = distances[last]  # grid points per pixel
    total = np.zeros(2 * fine + 3)
    for which in range(last + 1):
        for i in range(len(total)):
            x = -(peak + (i - fine - 1) / fine) * distances[which]
            below = math.floor(x)
            share = x - below
            total[i] += (1.0 - share) * correlation[which, below]
            total[i] += share * correlation[which, below + 1]
    best = 1 + int(np.argmax(total[1:-1]))
    left, right = total[best - 1], total[best + 1]
    bend = left - 2.0 * total[best] + right
    fraction = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(peak + (best - fine - 1 + min(max(fraction, -0.5), 0.5)) / fine)


@kernel
def rate(rest: Correlation, layout: Layout, found: Doubles) -> Doubles:
    """Return the log-likelihood ratio of each candidate versus noise [nats], shape (c,).

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        found: displacements per line of the candidates [px], shape (c,).
    """
    evidence, rest = np.empty(len(found)), against_noise(rest, layout)
    for i in range(len(found)):
        evidence[i] = _pooled(rest, layout, found[i])
    return evidence


@kernel
def _pooled(rest: Correlation, layout: Layout, displacement: float) -> float:
    """Return the log-likelihood ratio of a displacement versus noise, from several spacings [nats].

    Under noise alone, pairs of lines at different spacings are independent. Texture that leaves the
    view between distant lines would only add noise, so the result is the largest ratio of the line
    spacings up to any spacing, at most `farthest`, and at least 0.

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        displacement: displacement per line [px].
    """
    edges, count = bands(layout.size), int(COMPARED * layout.size)
    edges, distances = edges[edges <= count], spacings(layout.lines)
    gains, powers, numbers = np.zeros((3, len(edges) - 1))
    largest = 0.0
    for which in range(farthest(displacement, layout) + 1):
        shift = np.full(1, distances[which] * displacement)
        value, turn = rest.lagged[which, :count], phases(shift, layout.size, count)[0]
        overlap = max(1.0 - abs(shift[0]) / layout.pixels, 1e-3)
        pairs = layout.lines - distances[which]
        total = 0.0
        for b in range(len(edges) - 1):
            for f in range(edges[b], edges[b + 1]):
                gains[b] += pairs * (value[f].real * turn[f].real - value[f].imag * turn[f].imag)
                powers[b] += pairs * overlap * rest.power[f]
                numbers[b] += overlap**2 * rest.number[which, f]
            coherence = min(max(gains[b] / max(powers[b], 1e-9), 0.0), 0.999)
            total -= 0.5 * numbers[b] * layout.pixels / layout.size * math.log1p(-(coherence**2))
        largest = max(largest, total)
    return largest


@kernel
def against_noise(rest: Correlation, layout: Layout) -> Correlation:
    """Return the correlations, with all pairs of lines counted as independent.

    Pairs of lines that contain only noise are independent.
    """
    pairs = np.maximum(layout.lines - spacings(layout.lines), 1).astype(np.float32)
    return Correlation(rest.lagged, rest.power, np.ones_like(rest.number) * pairs.reshape(-1, 1))


@kernel
def coherent(rest: Correlation, layout: Layout, displacement: float, which: int) -> float:
    """Return the log-likelihood ratio of a displacement versus incoherent lines [nats].

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        displacement: displacement per line [px].
        which: index of the line spacing in `spacings`.
    """
    shift = np.full(1, spacings(layout.lines)[which] * displacement)
    value = rest.lagged[which, : int(COMPARED * layout.size)]
    turn, gain = phases(shift, layout.size, len(value))[0], np.empty(len(value), np.float32)
    for f in range(len(gain)):
        gain[f] = value[f].real * turn[f].real - value[f].imag * turn[f].imag
    overlap = max(1.0 - abs(shift[0]) / layout.pixels, 1e-3)
    return ratio(rest, layout, gain, overlap, which)


@kernel
def ratio(rest: Correlation, layout: Layout, gain: Floats, overlap: float, which: int) -> float:
    """Return the log-likelihood ratio of coherent versus incoherent lines [nats].

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        gain: power that the lines have in common, at the frequencies up to `COMPARED`.
        overlap: share of the lines that shows the same ground [1].
        which: index of the line spacing in `spacings`.
    """
    edges, total = bands(layout.size), 0.0
    edges = edges[edges <= len(gain)]
    for b in range(len(edges) - 1):
        i, j = edges[b], edges[b + 1]
        own = max(overlap * spectra.sum_of(rest.power[i:j]), 1e-9)
        coherence = min(max(spectra.sum_of(gain[i:j]) / own, 0.0), 0.999)
        # The part without overlap adds noise, which the division by the overlap amplifies.
        number = overlap**2 * spectra.sum_of(rest.number[which, i:j]) * layout.pixels / layout.size
        total -= 0.5 * number * math.log1p(-coherence * coherence)
    return total


@spectra.fast
def bands(size: int) -> NDArray[np.int64]:
    """Return the edges of B frequency bands [bins of a transform of `size` px], shape (B + 1,)."""
    use = int(spectra.HIGHEST * size)
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


@spectra.fast
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


@kernel
def decide(rest: Correlation, layout: Layout, found: Doubles, evidence: Doubles) -> int:
    """Return the index of the most likely candidate.

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        found: candidates [px], shape (c,).
        evidence: log-likelihood ratio of each candidate from `rate` [nats], shape (c,).
    """
    order = np.argsort(-evidence)
    best = order[0]
    for i in order[1:]:
        if _contest(rest, layout, found[best], found[i]):
            best = i
    return int(best)


@kernel
def ambiguous(found: Doubles, evidence: Doubles, best: int) -> bool:
    """Return whether the log-likelihood of a rival exceeds `RATIO` times that of the best one.

    Args:
        found: candidates [px], shape (c,).
        evidence: log-likelihood ratio of each candidate from `rate` [nats], shape (c,).
        best: index of the best candidate.
    """
    rivals = evidence[np.abs(found - found[best]) >= APART]
    return bool((rivals > RATIO * evidence[best]).any())


@kernel
def _contest(rest: Correlation, layout: Layout, one: float, other: float) -> bool:
    """Return whether the second of two displacements is more likely than the first.

    Their log-likelihoods are computed at the largest line spacing at which one of the two
    displacements is likely, because neighboring lines do not resolve slow displacements.

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        one: first displacement per line [px].
        other: second displacement per line [px].
    """
    for which in range(min(farthest(one, layout), farthest(other, layout)), -1, -1):
        first = coherent(rest, layout, one, which)
        second = coherent(rest, layout, other, which)
        if max(first, second) > LIKELY:
            break
    return second > first
