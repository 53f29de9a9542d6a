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


class Products(NamedTuple):
    """Correlations between the lines of a batch at four line spacings and all frequencies.

    Attributes:
        lagged: mean cross spectrum of the pairs of lines at each spacing, shape (4, F).
        newer: mean spectrum of the newer lines of the pairs at each spacing, shape (4, F).
        older: mean spectrum of the older lines of the pairs at each spacing, shape (4, F).
        mean: mean spectrum of all lines, shape (F,).
        power: mean power spectrum of the lines of the pairs at each spacing, shape (4, F).
    """

    lagged: Spectrum
    newer: Spectrum
    older: Spectrum
    mean: Spectrum
    power: Floats


def band_pass(size: int, count: int) -> Floats:
    """Return the weight of the first `count` frequencies in the slant stack [1], shape (count,)."""
    f = np.arange(count) / size
    band = np.cos(0.5 * np.pi * f / spectra.HIGHEST) ** 2
    weight: Doubles = -np.expm1(-((_COARSEST * f) ** 2)) * band
    return weight.astype(np.float32)


@linked
@kernel
def correlate(lines: Spectrum) -> Products:
    """Return the correlations between the lines of a batch.

    Args:
        lines: spectra of the lines, shape (m, F).
    """
    m, count = lines.shape
    distances = spacings(m)
    lagged, newer, older = np.zeros((3, SPACINGS, count), np.complex64)
    square = lines.real**2 + lines.imag**2
    total, whole = lines.sum(axis=0), square.sum(axis=0)
    power = np.zeros((SPACINGS, count), np.float32)
    for which in range(SPACINGS):
        lag = distances[which]
        if lag >= m:
            continue
        products, ahead, behind, own = lagged[which], newer[which], older[which], power[which]
        ahead[:], behind[:], own[:] = total, total, whole
        for k in range(lag):
            first, last = lines[k], lines[m - 1 - k]
            both = square[k] + square[m - 1 - k]
            for f in range(count):
                ahead[f] -= first[f]
                behind[f] -= last[f]
                own[f] -= np.float32(0.5) * both[f]
        for k in range(lag, m):
            new, old = lines[k], lines[k - lag]
            for f in range(count):
                products[f] += new[f] * np.conj(old[f])
        scale = np.float32(1.0 / (m - lag))
        products *= scale
        ahead *= scale
        behind *= scale
        own *= scale
    return Products(lagged, newer, older, total * np.float32(1.0 / m), power)


@linked
@kernel
def find(
    products: Products, layout: Layout, pattern: Spectrum, weight: Floats, last: float
) -> Doubles:
    """Return candidates for the displacement per line [px]: `last` and the peaks, shape (c,).

    Args:
        products: correlations from `correlate`.
        layout: sizes of the batch.
        pattern: spectrum of the present estimate of the fixed pattern, shape (F,).
        weight: weight of each frequency, from `band_pass`, shape (F,).
        last: displacement per line in the previous batch [px]; NaN without a previous batch.
    """
    lines, _, size, limit = layout
    count = len(pattern)
    distances = spacings(lines)
    found = np.empty(1 + 2 * _PEAKS)
    number = 0
    if np.isfinite(last):
        found[0], number = last, 1
    # After the mean of all lines has been subtracted, no fixed pattern remains.
    for removed in (pattern, products.mean):
        rest = spectra.smoothed(
            products.power[0]
            - 2.0 * (removed * np.conj(products.mean)).real
            + (removed * np.conj(removed)).real
        )
        correlation = np.zeros((SPACINGS, size), np.float32)
        for which in range(SPACINGS):
            if distances[which] >= lines:
                continue
            whitened = np.zeros(size // 2 + 1, np.complex64)
            ahead, behind = products.newer[which], products.older[which]
            for f in range(1, count):
                value = (
                    products.lagged[which, f]
                    - ahead[f] * np.conj(removed[f])
                    - removed[f] * np.conj(behind[f])
                    + removed[f] * np.conj(removed[f])
                )
                whitened[f] = value * (weight[f] / np.float32(max(rest[f], 1e-9)))
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
