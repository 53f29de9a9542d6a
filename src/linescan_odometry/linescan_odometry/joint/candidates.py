"""Candidates for the displacement: peaks of a slant stack, the wideband velocity spectrum.

Whitened correlations at several line spacings are added along straight lines of constant
displacement, as an array of sensors adds its channels along a direction of arrival.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy  # loads scipy.fft at its first use, so not in processes that only read configurations
from numpy.typing import NDArray

from linescan_odometry.joint.spectra import Doubles, Floats, Spectrum, bands, smoothed
from omni_platform.kernels import kernel

REACH = 0.5  # largest shift between two compared lines, as a share of a line
_PEAKS = 2  # candidates from each stack
_APART = 8  # px per line; smallest distance of two peaks of a stack
_SAME = 0.15  # px per line; candidates closer than this count as one
_DETAIL = 6.0, 100.0  # px; smallest and largest structures that pass the filter of the stack
COMPARED = 0.15  # cycles per pixel, up to which candidates are compared
_OVERSAMPLED = 0.5  # independent frequencies per bin, of lines padded to twice their length
_LAGS = 4  # number of line spacings that are correlated
_STACKED = 3  # line spacings that are stacked; the largest one only refines a peak


@kernel
def lags(lines: int) -> NDArray[np.int64]:
    """Return the line spacings that are correlated, from 1 to a third of m, shape (4,)."""
    distance = np.empty(_LAGS, np.int64)
    for which in range(_LAGS):
        distance[which] = max(1, round((lines / 3.0) ** (which / (_LAGS - 1.0))))
    return distance


class Layout(NamedTuple):
    """Sizes of a batch.

    Attributes:
        lines: number of lines m.
        pixels: pixels per line n.
        size: size of the transform [px].
        limit: largest displacement per line [px].
    """

    lines: int
    pixels: int
    size: int
    limit: int


class Products(NamedTuple):
    """Correlations along the lines of a batch, for all frequencies.

    Attributes:
        lagged: mean products of the spectra of two lines, for each of `lags`, shape (4, F).
        newer: mean spectrum of the newer lines of these pairs, shape (4, F).
        older: mean spectrum of the older lines of these pairs, shape (4, F).
        mean: mean spectrum of all lines, shape (F,).
        power: mean power of the lines, shape (F,).
    """

    lagged: Spectrum
    newer: Spectrum
    older: Spectrum
    mean: Spectrum
    power: Doubles


def band_pass(size: int, count: int) -> Floats:
    """Return the weight of each frequency in the stack, shape (count,)."""
    f = np.arange(count) / size
    weight = -np.expm1(-((_DETAIL[1] * f) ** 2)) * np.exp(-((_DETAIL[0] * f) ** 2))
    return weight.astype(np.float32)


@kernel
def correlate(spectra: Spectrum) -> Products:
    """Return the correlations along the lines of a batch.

    Args:
        spectra: spectra of the lines, shape (m, F).
    """
    m, count = spectra.shape
    distances = lags(m)
    lagged, newer, older = (
        np.zeros((_LAGS, count), np.complex64),
        np.zeros((_LAGS, count), np.complex64),
        np.zeros((_LAGS, count), np.complex64),
    )
    total, power = np.zeros(count, np.complex64), np.zeros(count, np.float32)
    for k in range(m):
        row = spectra[k]
        for f in range(count):
            total[f] += row[f]
            power[f] += row[f].real * row[f].real + row[f].imag * row[f].imag
    for which in range(_LAGS):
        lag = distances[which]
        if lag >= m:
            continue
        products, ahead, behind = lagged[which], newer[which], older[which]
        ahead[:], behind[:] = total, total
        for k in range(lag):
            ahead -= spectra[k]
            behind -= spectra[m - 1 - k]
        for k in range(lag, m):
            new, old = spectra[k], spectra[k - lag]
            for f in range(count):
                products[f] += new[f] * np.conj(old[f])
        scale = np.float32(1.0 / (m - lag))
        products *= scale
        ahead *= scale
        behind *= scale
    one = np.float32(1.0 / m)
    return Products(lagged, newer, older, total * one, (power * one).astype(np.float64))


@kernel
def find(
    products: Products, layout: Layout, pattern: Spectrum, weight: Floats, last: float
) -> Doubles:
    """Return candidates for the displacement per line [px], shape (c,).

    Args:
        products: see `correlate`.
        layout: sizes of the batch.
        pattern: spectrum of the fixed pattern as estimated so far, shape (F,).
        weight: weight of each frequency, see `band_pass`, shape (F,).
        last: displacement of the batch before, NaN for none [px].
    """
    lines, pixels, size, limit = layout
    count = len(pattern)
    distances = lags(lines)
    found = np.empty(1 + 2 * _PEAKS)
    number = 0
    if np.isfinite(last):
        found[0], number = last, 1
    # Lines less the mean of all lines contain no fixed pattern at all.
    for removed in (pattern, products.mean):
        rest = smoothed(
            products.power
            - 2.0 * (removed * np.conj(products.mean)).real
            + (removed * np.conj(removed)).real
        )
        correlation = np.zeros((_LAGS, size), np.float32)
        for which in range(_LAGS):
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
            correlation[which] = scipy.fft.irfft(whitened, size)
        stack = np.full(2 * limit + 1, -np.inf)
        for d in range(-limit, limit + 1):
            value, terms = 0.0, 0
            for which in range(_STACKED):
                lag = distances[which]
                if (lag < lines and abs(lag * d) < REACH * pixels) or lag == 1:
                    value += correlation[which, -lag * d % size]
                    terms += 1
            stack[d + limit] = value / np.sqrt(terms)
        for _ in range(_PEAKS):
            best = int(np.argmax(stack)) - limit
            if stack[best + limit] == -np.inf:
                break
            fine = _refined(correlation, best, layout)
            new = True
            for other in found[:number]:
                new = new and abs(fine - other) > _SAME
            if new:
                found[number] = fine
                number += 1
            stack[max(0, best + limit - _APART) : best + limit + _APART + 1] = -np.inf
    return found[:number]


@kernel
def farthest(displacement: float, layout: Layout) -> int:
    """Return the index of the largest of `lags` at which enough lines overlap sufficiently."""
    distances = lags(layout.lines)
    for which in range(_LAGS - 1, 0, -1):
        lag = distances[which]
        if 3 * lag <= layout.lines and abs(lag * displacement) < REACH * layout.pixels:
            return which
    return 0


@kernel
def _refined(correlation: Floats, peak: int, layout: Layout) -> float:
    """Return a peak to a fraction of a pixel, by the largest line spacing with enough overlap."""
    size = layout.size
    which = farthest(peak, layout)
    lag = lags(layout.lines)[which]
    best, top = lag * peak, -np.inf
    for x in range(lag * (peak - 1), lag * (peak + 1) + 1):
        value = float(correlation[which, -x % size])
        if value > top:
            best, top = x, value
    left = float(correlation[which, -(best - 1) % size])
    right = float(correlation[which, -(best + 1) % size])
    bend = left - 2.0 * top + right
    fraction = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    peak_place: float = (best + min(max(fraction, -0.5), 0.5)) / lag
    return peak_place


@kernel
def coherent(
    products: Products,
    layout: Layout,
    removed: Spectrum,
    displacement: float,
    spread: float,
    which: int,
) -> float:
    """Return the log-likelihood of a motion over that of incoherent lines [nats].

    Args:
        products: see `correlate`.
        layout: sizes of the batch.
        removed: spectrum that is fixed in the view, shape (F,).
        displacement: displacement per line [px].
        spread: width of the range of displacements of which the best one counts [px].
        which: index of the line spacing in `lags`.
    """
    size = layout.size
    edges = bands(size)
    edges = edges[edges <= COMPARED * size]
    first, count = edges[0], edges[-1]
    lag = lags(layout.lines)[which]
    real, imaginary, power = np.empty(count), np.empty(count), np.empty(count)
    for f in range(first, count):
        fixed = removed[f]
        value = (
            products.lagged[which, f]
            - products.newer[which, f] * np.conj(fixed)
            - fixed * np.conj(products.older[which, f])
            + fixed * np.conj(fixed)
        )
        real[f], imaginary[f] = value.real, value.imag
        power[f] = (
            products.power[f]
            - 2.0 * (fixed * np.conj(products.mean[f])).real
            + (fixed * np.conj(fixed)).real
        )
    best = 0.0
    for step in range(-1, 2):
        d = lag * (displacement + 0.5 * step * spread)
        overlap = max(1.0 - abs(d) / layout.pixels, 1e-3)
        factor = np.exp(-2j * np.pi * d / size)
        turn = factor**first
        total = 0.0
        for b in range(len(edges) - 1):
            gain, own = 0.0, 0.0
            for f in range(edges[b], edges[b + 1]):
                gain += real[f] * turn.real - imaginary[f] * turn.imag
                own += power[f]
                turn *= factor
            coherence = min(max(gain / max(overlap * own, 1e-9), 0.0), 0.999)
            freedom = 0.5 * _OVERSAMPLED * layout.lines * overlap * (edges[b + 1] - edges[b])
            total -= freedom * math.log1p(-coherence * coherence)
        best = max(best, total)
    return best


@kernel
def rate(products: Products, layout: Layout, removed: Spectrum, found: Doubles) -> Doubles:
    """Return the log-likelihood of each candidate at its best line spacing [nats], shape (c,).

    Args:
        products: see `correlate`.
        layout: sizes of the batch.
        removed: spectrum that is fixed in the view, shape (F,).
        found: candidates [px], shape (c,).
    """
    evidence = np.zeros(len(found))
    for i in range(len(found)):
        last = farthest(found[i], layout)
        spread = 0.5 / lags(layout.lines)[last]
        for which in range(last + 1):
            own = coherent(products, layout, removed, found[i], spread, which)
            evidence[i] = max(evidence[i], own)
    return evidence


@kernel
def contest(
    products: Products,
    layout: Layout,
    removed: Spectrum,
    one: float,
    other: float,
    likely: float,
) -> tuple[float, float, float]:
    """Return the log-likelihoods of two displacements and of their mean [nats].

    They are compared by the lines that are farthest apart and show any of both: neighboring lines
    do not resolve slow displacements.

    Args:
        products: see `correlate`.
        layout: sizes of the batch.
        removed: spectrum that is fixed in the view, shape (F,).
        one: displacement per line [px].
        other: displacement per line [px].
        likely: log-likelihood that shows one [nats].
    """
    which = min(farthest(one, layout), farthest(other, layout))
    while True:
        spread = 0.5 / lags(layout.lines)[which]
        first = coherent(products, layout, removed, one, spread, which)
        second = coherent(products, layout, removed, other, spread, which)
        if which == 0 or max(first, second) > likely:
            between = coherent(products, layout, removed, 0.5 * (one + other), 0.0, which)
            return first, second, between
        which -= 1
