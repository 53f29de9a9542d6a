"""Robust variance of a displacement, and number of the ground features that determine it.

The variance is the sandwich estimate ``J^-1 B J^-1`` over segments of the ground. J is the observed
curvature of the log-likelihood. It is smaller than the expected curvature where the texture loses
its coherence faster than in the model: in oblique motion and in turns. B is the covariance of the
derivative of the log-likelihood, estimated by the method of Newey and West (1987): the errors of
segments up to `_CORRELATED` apart may be correlated, because texture that is longer than a segment
is part of several segments. The errors within a frequency band may also be correlated: in
motion across the axis, oblique texture seems to drift along the axis, and textures of different
sizes drift differently. By the formula of Cameron, Gelbach and Miller (2011), B is the covariance
with correlations between segments, plus the one with correlations within bands, minus the one
without correlations.
The sandwich is valid even if the noise is not white and the model is not exact. Displacements that
are nearly as likely as the maximum increase the variance further.
"""

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint import spectra
from linescan_odometry.joint.candidates import APART, Correlation, Layout, coherent, farthest
from linescan_odometry.joint.likelihood import LEAST_NOISE, Expansion, turned, whiten, window
from linescan_odometry.joint.spectra import Doubles, Floats, Spectrum
from linescan_odometry.matching.transforms import transform_size
from omni_core.kernels import kernel, linked

PLACES = 24  # number of ground segments in a line
_UNEQUAL = 0.07  # largest standard deviation of the gains of a camera's pixels [1]
_MEDIAN_SQUARE = 0.455  # median of the square of a standard normal variable
_CORRELATED = 2  # segments; largest distance at which the errors of two segments are correlated


class Scaling(NamedTuple):
    """Change of the scale of a view, which follows from displacements that grow along the line.

    Attributes:
        change: change of the scale from line to line, relative to the scale [1].
        variance: variance of this change [1]; infinite if it is unknown.
        place: distance from the middle of the line at which the displacement was measured [px].
    """

    change: float
    variance: float
    place: float


UNSCALED = Scaling(0.0, math.inf, 0.0)


class Fit(NamedTuple):
    """Properties of a displacement at a maximum of the likelihood.

    Attributes:
        variance: robust variance of the displacement, plus the square of `difference` [px^2].
        white: variance of the displacement according to the model with white noise [px^2].
        features: effective number of independent features that move with the displacement.
        coherence: coherence between neighboring lines, weighted by power [1].
        contrast: energy of the gradients that neighboring lines have in common, relative to the
            energy of the gradients of the noise [1].
        difference: significant part of the difference between two displacements per line, one
            estimated from neighboring lines and one from all lines [px]; at least 0.
        scaling: change of the scale of the view.
    """

    variance: float
    white: float
    features: float
    coherence: float
    contrast: float
    difference: float
    scaling: Scaling


UNFIT = Fit(math.inf, math.inf, 0.0, 0.0, 0.0, 0.0, UNSCALED)


@kernel
def noise_of(lines: Floats) -> float:
    """Return the median of the pixels' noise variances, estimated from lines of shape (m, n).

    The difference of two lines contains no fixed pattern. Its third differences along the line
    contain hardly any ground texture either, because the optics blur the texture.
    """
    m, n = lines.shape
    square = np.zeros(n - 3, np.float32)
    for k in range(1, m):
        new, old = lines[k], lines[k - 1]
        for i in range(n - 3):
            outer = new[i] - old[i] - new[i + 3] + old[i + 3]
            inner = new[i + 2] - old[i + 2] - new[i + 1] + old[i + 1]
            value = outer + np.float32(3.0) * inner
            square[i] += value * value
    # The coefficients 1, 3, 3 and 1 of a third difference have the sum of squares 20, and the
    # difference of two lines has twice the noise variance of one line.
    return float(np.median(square) / (2.0 * 20.0 * (m - 1)))


@kernel
def unequal_pixels(lines: Floats, noise: float) -> float:
    """Return the variance of the gains of neighboring pixels, from logarithms of shape (m, n).

    The gains of neighboring pixels are independent of each other. Third differences of the mean of
    all lines contain hardly any ground texture, because the optics blur it. The argument `noise`
    is the variance of the noise of a pixel.
    """
    still = spectra.mean_of(lines)
    third = still[3:] - still[:-3] - np.float32(3.0) * (still[2:-1] - still[1:-2])
    # The coefficients 1, 3, 3 and 1 have the sum of squares 20.
    variance = float(np.median(third * third)) / (20.0 * _MEDIAN_SQUARE)
    return min(max(variance - noise / len(lines), 0.0), _UNEQUAL**2)


@linked
@kernel
def assess(here: Expansion, pixels: int, noise: float) -> Fit:
    """Return the properties listed in `Fit` for a displacement at a maximum of the likelihood.

    Args:
        here: expansion of the log-likelihood near its maximum, with a finite inverse.
        pixels: number of pixels n of a line.
        noise: variance of the noise of a pixel, from `noise_of`.
    """
    cut, edges, moments = here.cut, here.model.edges, here.moments
    weight, information = np.zeros(cut.spectra.shape[1]), np.zeros(len(edges) - 1)
    gradient = np.zeros(len(edges) - 1)  # sum of the squared frequencies of each band
    for b in range(len(edges) - 1):
        gamma = min(max(moments[1, b] / moments[0, b], 1e-6), 1.0 - LEAST_NOISE)
        weight[edges[b] : edges[b + 1]] = math.sqrt(gamma / ((1.0 - gamma * gamma) * moments[0, b]))
        gradient[b] = (here.model.rate[edges[b] : edges[b + 1]] ** 2).sum()
        information[b] = gamma * gamma / (1.0 - gamma * gamma) * gradient[b]
    noise *= (window(cut.length) ** 2).sum()
    contrast = (moments[1] * gradient).sum() / max(noise * gradient.sum(), 1e-12)
    moved, curvature = _moved(here)
    parts = _places(here, moved, weight, pixels)
    energy = np.maximum(parts[:, 1], 0.0)
    total = max(energy.sum(), 1e-12)
    # The observed curvature of noisy lines varies by chance and may even be negative. The factor by
    # which it enlarges the standard deviation is therefore limited to 1 to `SIGNIFICANT`.
    curvature = min(max(curvature, 1.0 / spectra.SIGNIFICANT), 1.0)
    white = here.inverse[0, 0]
    bands = _between_bands(here, moved, information / information.sum())
    variance = _variance(parts[:, 0], energy / total) + max(bands - white, 0.0)
    variance /= curvature**2
    # With weights of amplitude times coherence, a bright edge dominates less than with energies.
    amplitude = energy**1.5 / np.maximum(parts[:, 2], 1e-12)
    features = amplitude.sum() ** 2 / max((amplitude * amplitude).sum(), 1e-12)
    # With oblique edges or a second motion, neighboring and distant lines shift differently.
    offset = parts[:, 3].sum() / total
    scatter = (parts[:, 3] - offset * parts[:, 1]) / total
    excess = max(offset**2 - spectra.SIGNIFICANT**2 * (scatter * scatter).sum(), 0.0)
    variance += excess
    coherence = moments[1].sum() / max(moments[0].sum(), 1e-9)
    scaling = _scaling(parts, energy / total, 0.5 * pixels)
    return Fit(variance, white, features, coherence, contrast, math.sqrt(excess), scaling)


@kernel
def _scaling(parts: Doubles, share: Doubles, middle: float) -> Scaling:
    """Return the change of the scale of the view, by regression of displacements on their places.

    Args:
        parts: properties of each ground segment from `_places`, shape (p, 7).
        share: share of each segment in the coherent energy [1], shape (p,).
        middle: middle of the line [px].
    """
    energy = max(parts[:, 1].sum(), 1e-12)
    place = parts[:, 4].sum() / energy
    weight = parts[:, 1] / energy
    lever = parts[:, 4] / energy - place * weight
    square = parts[:, 5] / energy - 2.0 * place * parts[:, 4] / energy + place**2 * weight
    spread, concentration = square.sum(), (share * share).sum()
    if not (spread > 0.0 and 0.0 < concentration < 0.5):
        return UNSCALED
    own = parts[:, 6] - place * parts[:, 0] - lever * parts[:, 0].sum()
    change = own.sum() / spread
    left = own - square * change
    variance = (left * left).sum() / spread**2 / (1.0 - 2.0 * concentration)
    return Scaling(change, variance, place - middle)


@kernel
def _variance(errors: Doubles, share: Doubles) -> float:
    """Return the variance of the sum of the errors of all segments [px^2].

    It is infinite if the coherent energy is 0, or is concentrated in effectively two segments or
    fewer.

    Args:
        errors: contribution of each segment to the error [px], shape (p,).
        share: share of each segment in the coherent energy [1], shape (p,).
    """
    concentration = (share * share).sum()  # inverse of the effective number of segments
    if not 0.0 < concentration < 0.5:
        return math.inf
    # The error of the whole reduces each deviation by the segment's share (MacKinnon, White 1985).
    own = (errors - share * errors.sum()) / (1.0 - share)
    scatter = (own * own).sum()
    for lag in range(1, _CORRELATED + 1):
        weight = 1.0 - lag / (_CORRELATED + 1.0)  # Bartlett's, so that the sum is not negative
        scatter += 2.0 * weight * (own[lag:] * own[:-lag]).sum()
    # Student's factor, with the degrees of freedom of a sum with Bartlett's weights. It is limited
    # like that of the curvature.
    freedom = 1.5 / ((_CORRELATED + 1.0) * concentration)
    return float(scatter / max(1.0 - 2.0 / freedom, spectra.SIGNIFICANT**-2))


@kernel
def _between_bands(here: Expansion, moved: Spectrum, share: Doubles) -> float:
    """Return the variance of the displacement if only errors within a band are correlated [px^2].

    Args:
        here: expansion of the log-likelihood near its maximum.
        moved: product ``M z`` from `_moved`, shape (t, F).
        share: share of each frequency band in the information [1], shape (B,).
    """
    rate, edges = here.model.rate, here.model.edges
    sums = turned(here.cut.spectra, moved, np.ones(len(moved), np.float32))
    errors = np.empty(len(share))
    for b in range(len(share)):
        i, j = edges[b], edges[b + 1]
        errors[b] = (rate[i:j] * sums[i:j]).sum()
    own = errors - share * errors.sum()
    # HC2 of MacKinnon, White (1985); 0 if there is only one band.
    return float((own * own / np.maximum(1.0 - share, 1e-9)).sum())


@kernel
def _moved(here: Expansion) -> tuple[Spectrum, float]:
    """Return the product ``M z``, shape (t, F), and the relative curvature [1].

    z are the spectra of the cut lines, and T is their covariance. Let D be the diagonal matrix of
    the derivatives of the paths, weighted by the row of the inverse information that belongs to d.
    With ``M = (D T^-1 - T^-1 D) / 2``, the Newton step in d is the sum over frequencies of
    ``Re((2 pi i f z)' M z)``. A constant in D moves all lines together, and does not change M. The
    derivative of the step with respect to d is the negative of the relative curvature: the observed
    curvature of the log-likelihood, divided by the expected one.
    """
    cut, model = here.cut, here.model
    derivatives = here.inverse[0, 0] * model.along[0] + here.inverse[0, 1] * model.along[1]
    half = (0.5 * derivatives[cut.line]).astype(np.float32)
    moved = whiten(_scaled(cut.spectra, half), cut.first, model.edges, model.bands)
    moved = _scaled(here.white, half) - moved
    curvature = 0.0
    for r in range(len(moved)):
        total, z, w = 0.0, cut.spectra[r], moved[r]
        for f in range(len(model.rate)):
            total += model.rate[f] ** 2 * (z[f].real * w[f].real + z[f].imag * w[f].imag)
        curvature -= 2.0 * model.along[0, cut.line[r]] * total
    return moved, curvature


@kernel
def _scaled(lines: Spectrum, factors: Floats) -> Spectrum:
    """Return lines, shape (t, F), multiplied by one real factor each, shape (t,)."""
    scaled = np.empty_like(lines)
    for r in range(len(lines)):
        # As real numbers, because complex factors would double the number of operations.
        row, own, factor = scaled[r].view(np.float32), lines[r].view(np.float32), factors[r]
        for i in range(len(row)):
            row[i] = factor * own[i]
    return scaled


@kernel
def _places(here: Expansion, moved: Spectrum, weight: Doubles, pixels: int) -> Doubles:
    """Return seven properties of each of the p ground segments, shape (p, 7).

    Column 0 is the contribution to the Newton step in the displacement d per line [px]. Columns 1
    and 2 are the coherent and the total energy. Column 3 is the derivative of the log-likelihood
    with respect to d, computed from neighboring lines alone. Columns 4 and 5 are the coherent
    energy times the pixel at which it is seen, and times the square of this pixel. Column 6 is the
    contribution of column 0 times the pixel.

    Each property is a sum of products of lines over the grid points in a segment. The grid is as
    coarse as the highest frequency allows. The energy is the information
    ``f^2 gamma^2 / (1 - gamma^2)`` of a coherence gamma. Its coherent part is computed from
    products of neighboring lines, in which only the ground is correlated.

    Args:
        here: expansion of the log-likelihood near its maximum.
        moved: product ``M z`` from `_moved`, shape (t, F).
        weight: weight of each frequency in the energies, shape (F,).
        pixels: number of pixels n of a line.
    """
    cut, model = here.cut, here.model
    rows, count = cut.spectra.shape
    size = transform_size(2 * count)
    parted = np.zeros((4, rows, size // 2 + 1), np.complex64)
    turn = (1j * model.rate).astype(np.complex64)
    for r in range(rows):
        for f in range(1, count):
            parted[0, r, f] = moved[r, f]
            parted[1, r, f] = turn[f] * cut.spectra[r, f]
            parted[2, r, f] = parted[1, r, f] * np.float32(weight[f])
            parted[3, r, f] = cut.spectra[r, f] * np.float32(weight[f])
    space: Floats = np.fft.irfft(parted, size, 2)  # type: ignore[assignment]  # numba: 32 bits
    scale = size / cut.size  # grid points per pixel
    seen = int(cut.length * scale)
    lowest = math.floor(cut.ground.min() * PLACES / pixels)
    highest = math.floor((cut.ground.max() + cut.length) * PLACES / pixels)
    parts = np.zeros((highest - lowest + 1, 7))
    for block in range(len(cut.first) - 1):
        sums = _summed(space, cut.first[block], cut.first[block + 1], seen)
        for p in range(len(parts)):
            begin = ((p + lowest) * pixels / PLACES - cut.ground[block]) * scale
            i = max(0, math.ceil(begin))
            j = max(i, min(seen, math.ceil(begin + pixels / PLACES * scale)))
            for which in range(4):
                parts[p, which] += sums[which, i:j].sum()
            for g in range(i, j):
                pixel = cut.pixel[block] + g / scale
                parts[p, 4] += sums[1, g] * pixel
                parts[p, 5] += sums[1, g] * pixel**2
                parts[p, 6] += sums[0, g] * pixel
    # The inverse transform weights every frequency by 2 / size.
    parts *= 0.5 * size
    return parts


@kernel
def _summed(space: Floats, first: int, end: int, seen: int) -> Floats:
    """Return the four properties of `_places` at each grid point of a block, shape (4, g).

    Args:
        space: products M z, slopes, weighted slopes and weighted lines, shape (4, t, size).
        first: row of the block's first line.
        end: row after the block's last line.
        seen: number of grid points g that the lines cover.
    """
    half = np.float32(0.5)
    sums = np.zeros((4, seen), np.float32)
    by_d, shared, whole, shift = sums[0], sums[1], sums[2], sums[3]
    for k in range(first, end):
        moved, slopes, energy, texture = space[0, k], space[1, k], space[2, k], space[3, k]
        for i in range(seen):
            by_d[i] += moved[i] * slopes[i]
        if k > first:
            before, older = space[2, k - 1], space[3, k - 1]
            for i in range(seen):
                shared[i] += energy[i] * before[i]
                whole[i] += half * (energy[i] * energy[i] + before[i] * before[i])
            for i in range(seen):
                shift[i] += half * (before[i] * texture[i] - energy[i] * older[i])
    return sums


@kernel
def scatter(
    rest: Correlation, layout: Layout, displacement: float, limits: tuple[float, float]
) -> float:
    """Return the variance [px^2] of a displacement due to rivals, which are similarly likely.

    The rivals are zero displacement, and displacements that differ from the given one by 1 px to
    `APART` px. In each direction, the search for rivals ends at the first displacement that is too
    unlikely. Rivals occur on smooth ground. There, zero displacement is nearly as likely as slow
    motion, and one peak of the likelihood is several pixels wide and has many small maxima. The
    curvature at the largest maximum then does not give the variance.

    Args:
        rest: correlations between the lines.
        layout: sizes of the batch.
        displacement: displacement per line [px].
        limits: two numbers. The first is the loss of log-likelihood at which a rival is excluded
            [nats]. The second is the factor on this loss in the weight of a rival [1]; it is below
            1 because neighboring frequencies are not independent.
    """
    excluded, share = limits
    last = farthest(displacement, layout)
    own = [coherent(rest, layout, displacement, which) for which in range(last + 1)]
    away = np.arange(1.0, APART + 1.0)
    total, moment = 1.0, 0.0
    for rivals in (np.zeros(1), displacement - away, displacement + away):
        for rival in rivals:
            loss, which = 0.0, last
            while which >= 0 and loss < excluded:
                other = coherent(rest, layout, rival, which)
                loss, which = max(loss, own[which] - other), which - 1
            if loss >= excluded:
                break
            weight = math.exp(-share * loss)
            total += weight
            moment += weight * (rival - displacement) ** 2
    return moment / total
