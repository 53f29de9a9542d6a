"""Displacement of the lines of one camera, batch by batch."""

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint.candidates import (
    Layout,
    Products,
    band_pass,
    coherent,
    contest,
    correlate,
    farthest,
    find,
    lags,
    rate,
)
from linescan_odometry.joint.fit import Fit, Precision, fit
from linescan_odometry.joint.fixed_pattern import FixedPattern, observe, posterior, prior, shrink
from linescan_odometry.joint.spectra import (
    HIGHEST,
    Doubles,
    Floats,
    Spectrum,
    log_table,
    spectra_of,
    transform_size,
    window,
    without,
)
from linescan_odometry.matching.transforms import load_transforms
from linescan_odometry.measurements import Lines

_MEMORY = 50.0  # batches; memory of the estimate of the pattern
_NOISE = 12.0  # nats; log-likelihood that noise alone seldom reaches
_LIKELY = 25.0  # nats; smallest log-likelihood of a valid displacement
_RATIO = 0.5  # second-best log-likelihood over the best one; above it the peak is ambiguous
_RESOLVED = 4.0  # px per line; candidates this far apart are separate peaks
_FEWEST = 7.5  # independent moving features: the edge of a shadow has up to seven
_CHI_SQUARE = 25.0  # of near against far lines: 5 standard deviations
_LEAST_CONTRAST = 0.03  # gradients over noise: fainter ones over wood may have another motion
_STATIC = 2.0  # px within a batch; a candidate below counts as at rest
_SHIFTED = 8.0  # px within a batch, from which ground and pattern differ
_FEWEST_LINES = 8


class Estimate(NamedTuple):
    """Estimate from a batch of lines.

    Attributes:
        value: mean displacement per line [px].
        variance: variance of the displacement [px^2].
        reason: why the displacement is not valid, empty if it is.
        coherence: coherence of neighboring lines [1].
        details: effective number of independent values of the texture in a line.
    """

    value: float
    variance: float
    reason: str
    rest: Floats | Lines
    coherence: float = 0.0
    details: float = math.inf


class _Choice(NamedTuple):
    """The candidate that explains the lines best.

    Attributes:
        displacement: displacement per line [px].
        moves: whether the view changes.
        reason: why the displacement is not valid, empty if it is.
    """

    displacement: float
    moves: bool
    reason: str


class JointEstimator:
    """Estimates displacements and the fixed pattern of a camera.

    Attributes:
        pattern: fixed pattern of the camera as estimated so far.
    """

    def __init__(
        self,
        pixels: int,
        limit: int,
        acceleration: float,
    ) -> None:
        """Prepare the working memory.

        Args:
            pixels: n of a line.
            limit: largest displacement per line [px].
            acceleration: standard deviation of the displacement's change from line to line [px].
        """
        load_transforms()
        self._limit, self._spread = limit, acceleration
        self._size = int(transform_size(2 * pixels))
        self._bins = int(HIGHEST * self._size)
        self._taper = window(pixels)
        self._tables = {1: log_table(8), 2: log_table(16)}
        self._weight = band_pass(self._size, self._bins)
        self.pattern = FixedPattern(np.zeros(self._bins, np.complex64), np.zeros(self._bins))

    def estimate(self, lines: Lines, last: float = math.nan) -> Estimate:
        """Estimate the displacement of a batch.

        Args:
            lines: oldest first, shape (m, pixels).
            last: displacement of the batch before, NaN for none [px].
        """
        m, n = lines.shape
        size = self._size
        layout = Layout(m, n, size, self._limit)
        table = self._tables[lines.itemsize]
        spectra = spectra_of(lines, table, self._taper, size)
        products = correlate(spectra)
        known = shrink(*self.pattern)
        kappa = np.arange(m) - 0.5 * (m - 1)
        found = find(products, layout, known, self._weight, last)
        if not len(found):
            return Estimate(0.0, math.inf, "no peak of the correlation", lines)
        choice = self._choose(products, layout, known, found)
        d, a, moves, reason = choice.displacement, 0.0, choice.moves, choice.reason
        # At rest, and with few lines, ground and pattern cannot be separated: the pattern is taken
        # as known.
        parted = moves and m >= _FEWEST_LINES
        pattern, before, batch = known, np.full(self._bins, math.inf), np.zeros(self._bins)
        information, removed = known, products.mean
        for final in (False, True):
            if parted:
                paths = d * kappa + a * 0.5 * kappa**2
                information, batch = observe(spectra, removed, paths, size)
                together = self.pattern.information + information
                before = self.pattern.precision + prior(together, self.pattern.precision + batch)
                pattern = posterior(together, before + batch)
            rest = without(lines, table, pattern, self._taper, size)
            precision = Precision(before, batch)
            best: Fit = fit(rest, precision, d, a, self._spread, final)
            if not best.found:
                return Estimate(choice.displacement, math.inf, "no maximum of the likelihood", rest)
            d, a, removed = best.displacement, best.change, pattern
        variance = best.variance
        few = moves and best.features < _FEWEST
        if not reason and (few or not math.isfinite(variance)):
            reason = f"dominated by {best.features:.1f} features"
        if not reason and moves and best.chi_square > _CHI_SQUARE:
            reason = "two motions"
        # After a smaller shift the pattern still contains the ground, and `rest` lacks it.
        if not reason and abs(d) * (m - 1) > _SHIFTED and best.contrast < _LEAST_CONTRAST:
            reason = "low texture"
        if not reason and parted:
            self._learn(information, batch)
            variance += self._static_probability(products, layout, d) * max(d * d - variance, 0.0)
        return Estimate(d, variance, reason, rest, best.coherence, best.details)

    def _choose(
        self, products: Products, layout: Layout, known: Spectrum, found: Doubles
    ) -> _Choice:
        """Return the candidate that explains the lines best.

        The mean of the batch contains everything that is fixed in the view. Without this mean, the
        lines of a static scene are noise, so a motion that explains them rules out rest.
        """
        removed = products.mean if layout.lines >= _FEWEST_LINES else known
        evidence = rate(products, layout, removed, found)
        best = int(np.argmax(evidence))
        static = np.flatnonzero(abs(found) * (layout.lines - 1) < _STATIC)
        if evidence[best] < _NOISE and len(static):
            c = float(found[static[0]])
            own = coherent(products, layout, known, c, 1.0, 0)
            return _Choice(c, False, "" if own > _LIKELY else "low texture")
        if evidence[best] < _LIKELY:
            return _Choice(float(found[best]), True, "low texture")
        for i in np.argsort(-evidence)[1:]:
            own, other, _ = contest(products, layout, removed, found[best], found[i], _LIKELY)
            if other > own:
                best = int(i)
        # Beyond the overlap noise has such rivals, which a single distance between lines can miss.
        apart = abs(found - found[best]) >= _RESOLVED
        ambiguous = float(np.max(evidence, where=apart, initial=0.0)) > _RATIO * evidence[best]
        for rival in np.delete(found, best):
            if ambiguous:
                break
            own, other, between = contest(products, layout, removed, found[best], rival, _LIKELY)
            # Where the displacement between them is as likely, both are one peak.
            ambiguous = other > _RATIO * own and between < _RATIO * other
        return _Choice(float(found[best]), True, "ambiguous" if ambiguous else "")

    def _static_probability(self, products: Products, layout: Layout, value: float) -> float:
        """Return the probability that nothing moves where a slow displacement is estimated.

        Over a smooth ground motion and rest are nearly equally likely.
        """
        gap = 0.0
        far = farthest(value, layout)
        spread = 0.5 / lags(layout.lines)[far]
        for lag in range(far + 1):
            own, static = (
                coherent(products, layout, products.mean, d, spread, lag) for d in (value, 0.0)
            )
            gap = max(gap, own - static)
        odds = math.exp(-_RATIO * gap)
        return odds / (1.0 + odds)

    def _learn(self, information: Spectrum, precision: Doubles) -> None:
        """Update the pattern by a batch; the weight of earlier batches decays."""
        kept = np.float32(1.0 - 1.0 / _MEMORY)
        before = self.pattern
        self.pattern = FixedPattern(
            before.information * kept + information, before.precision * kept + precision
        )
