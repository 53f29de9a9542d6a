"""Decision between the candidates for the displacement.

The likelihood of each candidate is computed from the correlations of the lines after the fixed
pattern, or the mean of all lines, has been subtracted.
"""

import math

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.joint import candidates, spectra
from linescan_odometry.joint.candidates import Correlation, Layout, farthest, spacings
from linescan_odometry.joint.spectra import Doubles, Floats, Spectrum
from omni_platform.kernels import kernel
from omni_platform.signals import Lines

# Highest frequency at which candidates are compared [cycles per pixel].
_COMPARED = 0.5 * spectra.HIGHEST
_FIRST_BAND, _BAND_GROWTH = 0.002, 1.45  # cycles per pixel; ratio of band edges


@kernel
def against_noise(rest: Correlation, layout: Layout) -> Correlation:
    """Return the correlations, with all pairs of lines counted as independent.

    Pairs of lines that contain only noise are independent.
    """
    pairs = np.maximum(layout.lines - spacings(layout.lines), 1).astype(np.float32)
    return Correlation(rest.lagged, rest.power, np.ones_like(rest.number) * pairs.reshape(-1, 1))


@kernel
def colored(lines: Lines, taper: Floats, layout: Layout) -> float:
    """Return the log-likelihood ratio of colored versus white differences of lines [nats].

    The differences of neighboring lines contain no fixed pattern. At rest, they contain only noise,
    which is white. If the ground moves, they also contain its texture, which is colored because the
    optics attenuate high frequencies. The log-likelihood ratio follows from the spectral flatness:
    the geometric mean of a spectrum divided by its arithmetic mean.

    Args:
        lines: gray levels, shape (m, n), without interpolated pixels, because interpolation colors
            the noise. Their logarithm would amplify the noise of dark pixels.
        taper: factor of each pixel before the transform, shape (n,).
        layout: sizes of the batch.
    """
    levels = lines.astype(np.float32)
    differences = levels[1:] - levels[:-1]
    transformed = np.abs(spectra.spectra_of(differences, taper, layout.size)) ** 2
    # The differences are a moving average of order 1: N of them count as 2 N / 3 independent ones.
    number = (taper**2).sum() / layout.size * (layout.lines - 1) / 1.5
    edges, total, logarithm = bands(layout.size), 0.0, 0.0
    for b in range(len(edges) - 1):
        i, j = edges[b], edges[b + 1]
        power = max(transformed[:, i:j].sum(), 1e-9)
        total += power
        logarithm += (j - i) * math.log(power / (j - i))
    count = edges[-1] - edges[0]
    # For white noise, the estimated power of each band except one adds half a nat on average.
    ratio: float = number * (count * math.log(total / count) - logarithm) - 0.5 * (len(edges) - 2)
    return ratio


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
    value = rest.lagged[which, : int(_COMPARED * layout.size)]
    turn, gain = phases(shift, layout.size, len(value))[0], np.empty(len(value), np.float32)
    for f in range(len(gain)):
        gain[f] = value[f].real * turn[f].real - value[f].imag * turn[f].imag
    overlap = max(1.0 - abs(shift[0]) / layout.pixels, 1e-3)
    return _ratio(rest, layout, gain, overlap, which)


@kernel
def _ratio(rest: Correlation, layout: Layout, gain: Floats, overlap: float, which: int) -> float:
    """Return the log-likelihood ratio of coherent versus incoherent lines [nats].

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        gain: power that the lines have in common, at the frequencies up to `_COMPARED`.
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
def rate(rest: Correlation, layout: Layout, found: Doubles) -> Doubles:
    """Return the log-likelihood ratio of each candidate versus noise [nats], shape (c,).

    The result is the largest ratio at any line spacing up to `farthest`, and at least 0.

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        found: displacements per line of the candidates [px], shape (c,).
    """
    evidence, rest = np.zeros(len(found)), against_noise(rest, layout)
    for i in range(len(found)):
        for which in range(farthest(found[i], layout) + 1):
            evidence[i] = max(evidence[i], coherent(rest, layout, found[i], which))
    return evidence


@kernel
def turning(rest: Correlation, layout: Layout) -> float:
    """Return the log-likelihood ratio of any motion along the axis versus none [nats].

    Motion along the axis turns the phases of the correlations between lines; motion across the axis
    only reduces the correlations. In the first hypothesis, the phase at each frequency is free. The
    result is the largest ratio at any line spacing.

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
    """
    largest, count = 0.0, int(_COMPARED * layout.size)
    power = rest.power[:count] ** 2
    for which in range(candidates.SPACINGS):
        # For noise alone, the squared coherence of N pairs is 1 / N on average.
        noise = np.float32(1.0 / max(layout.lines - spacings(layout.lines)[which], 2))
        square = np.abs(rest.lagged[which, :count]) ** 2 - noise * power
        gain = np.sqrt(np.maximum(square / (1.0 - noise), 0.0)).astype(np.float32)
        free = _ratio(rest, layout, gain, 1.0, which)
        largest = max(largest, free - coherent(rest, layout, 0.0, which))
    return largest


@kernel
def decide(
    rest: Correlation,
    layout: Layout,
    found: Doubles,
    evidence: Doubles,
    limits: tuple[float, float],
) -> tuple[int, bool]:
    """Return the index of the most likely candidate, and whether the choice is ambiguous.

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        found: candidates [px], shape (c,).
        evidence: log-likelihood ratio of each candidate from `rate` [nats], shape (c,).
        limits: two numbers. The first is the minimum log-likelihood of an accepted displacement
            [nats]. The second is a ratio of log-likelihoods [1]: the choice is ambiguous if the
            second-largest one, divided by the largest one, exceeds this ratio.
    """
    likely, ratio = limits
    order = np.argsort(-evidence)
    best = order[0]
    for i in order[1:]:
        own, other = _contest(rest, layout, found[best], found[i], likely)
        if other > own:
            best = i
    rivals = evidence[np.abs(found - found[best]) >= candidates.APART]
    return best, bool((rivals > ratio * evidence[best]).any())


@kernel
def _contest(
    rest: Correlation, layout: Layout, one: float, other: float, likely: float
) -> tuple[float, float]:
    """Return the log-likelihoods of two displacements [nats].

    Both are computed at the largest line spacing at which one of the two displacements is
    likely, because neighboring lines do not resolve slow displacements.

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        one: first displacement per line [px].
        other: second displacement per line [px].
        likely: smallest log-likelihood of an accepted displacement [nats].
    """
    which = min(farthest(one, layout), farthest(other, layout))
    while True:
        first = coherent(rest, layout, one, which)
        second = coherent(rest, layout, other, which)
        if which == 0 or max(first, second) > likely:
            return first, second
        which -= 1
