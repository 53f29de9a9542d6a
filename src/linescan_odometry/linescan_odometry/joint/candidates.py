"""Candidates for the displacement: peaks of a slant stack (wideband velocity spectrum).

For each displacement per line, the whitened correlations of lines at several spacings are summed at
the shifts that this displacement causes. A sensor array sums its channels in the same way for each
direction of arrival.

In shapes, m is the number of lines, n the number of pixels per line, F the number of spatial
frequencies, and c the number of candidates.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.joint import spectra
from linescan_odometry.joint.spectra import Doubles, Floats, Spectrum
from omni_platform.kernels import kernel, linked

_PEAKS = 2  # number of candidates from each stack
APART = 8  # px per line; smallest distance between two peaks
_COARSEST = 100.0  # px; size of the largest texture details that pass the filter of the stack
SPACINGS = 4  # number of line spacings that are correlated


@kernel
def spacings(lines: int) -> NDArray[np.int64]:
    """Return the four line spacings at which a batch is correlated, 1 to lines / 3, shape (4,)."""
    distance = np.empty(SPACINGS, np.int64)
    for which in range(SPACINGS):
        distance[which] = max(1, round((lines / 3.0) ** (which / (SPACINGS - 1.0))))
    return distance


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
    lagged, power = np.zeros((SPACINGS, count), np.complex64), np.zeros(count, np.float32)
    shared = np.zeros((SPACINGS, count), np.float32)
    for k in range(m):
        new = rest[k]
        for f in range(count):
            power[f] += new[f].real * new[f].real + new[f].imag * new[f].imag
    power *= np.float32(1.0 / m)
    for which in range(SPACINGS):
        products, lag = lagged[which], distances[which]
        for k in range(lag, m):
            new, old = rest[k], rest[k - lag]
            for f in range(count):
                products[f] += new[f] * np.conj(old[f])
        # For noise alone, the squared coherence of N pairs is 1 / N on average.
        noise = 1.0 / max(m - lag, 1)
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
    lines, _, size, limit = layout
    distances = spacings(lines)
    found = np.empty(1 + 2 * _PEAKS)
    number = 0
    if np.isfinite(last):
        found[0], number = last, 1
    for own in correlations:
        whitening = weight / np.maximum(spectra.smoothed(own.power), 1e-9)
        correlation = np.zeros((SPACINGS, size), np.float32)
        for which in range(SPACINGS):
            whitened = np.zeros(size // 2 + 1, np.complex64)
            for f in range(len(weight)):
                whitened[f] = own.lagged[which, f] * np.float32(whitening[f])
            correlation[which] = np.fft.irfft(whitened, size)
        stack = np.full(2 * limit + 1, -np.inf)
        for d in range(-limit, limit + 1):
            value, terms = 0.0, 0
            for which in range(SPACINGS):
                lag = distances[which]
                if (lag < lines and abs(lag * d) < limit) or lag == 1:
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
    peak_place: float = peak + (best - fine - 1 + min(max(fraction, -0.5), 0.5)) / fine
    return peak_place
