"""Displacement of the lines of one camera, batch by batch."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from linescan_odometry.joint.candidates import (
    Layout,
    Products,
    band_pass,
    coherent,
    correlate,
    farthest,
    find,
    lags,
    rate,
)
from linescan_odometry.joint.fit import Fit, fit
from linescan_odometry.joint.fixed_pattern import FixedPattern, observe, shrink
from linescan_odometry.joint.spectra import (
    HIGHEST,
    Doubles,
    Spectrum,
    log_table,
    spectra_of,
    transform_size,
    window,
    without,
)
from linescan_odometry.matching.transforms import load_transforms
from linescan_odometry.measurements import Lines

_MEMORY = 50.0  # batches, over which what is known of the pattern fades
_NEW_GROUND = 0.3  # of a line, that the camera moves between two observations of the pattern
_NOISE = 12.0  # nats, that noise alone seldom shows
_LIKELY = 25.0  # nats, of them for the displacement
_RATIO = 0.5  # runner-up's log-likelihood over the best one's
_FEWEST = 8.0  # independent features of what moves: an edge of light has up to seven
_FEWEST_STATIC = 2.5  # independent features of a static scene, for the variance to exist
_STATIC = 2.0  # px within a batch
_RESOLVED = 4.0  # px per line, from which two candidates are two peaks
_FEWEST_LINES = 8
_STEPS = 2


class Estimate(NamedTuple):
    """What a batch of lines shows.

    Attributes:
        value: mean displacement per line [px].
        variance: of it [px^2].
        reason: why it is not valid, empty if it is.
        coherence: of neighboring lines [1].
    """

    value: float
    variance: float
    reason: str
    coherence: float = 0.0


class _Choice(NamedTuple):
    """A candidate.

    Attributes:
        displacement: per line [px].
        moves: whether anything changes in the view.
        reason: why it is not valid, empty if it is.
    """

    displacement: float
    moves: bool
    reason: str


class JointEstimator:
    """Estimates displacements, and what is fixed in the view of the camera."""

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
            acceleration: its usual change from line to line (standard deviation) [px].
        """
        load_transforms()
        self._limit, self._spread = limit, acceleration
        self._size = int(transform_size(2 * pixels))
        self._bins = int(HIGHEST * self._size)
        self._taper = window(pixels)
        self._tables = {1: log_table(8), 2: log_table(16)}
        self._weight = band_pass(self._size, self._bins)
        self._pattern = FixedPattern(np.zeros(self._bins, np.complex64), np.zeros(self._bins))
        self._way = 0.0

    def estimate(self, lines: Lines, last: float = math.nan) -> Estimate:
        """Estimate the displacement of a batch.

        Args:
            lines: oldest first, shape (m, pixels).
            last: displacement of the batch before, NaN for none [px].
        """
        m, n = lines.shape
        size = self._size
        layout = Layout(m, n, size, self._limit)
        spectra = spectra_of(lines, self._tables[lines.itemsize], self._taper, size)
        products = correlate(spectra)
        known = shrink(*self._pattern)
        kappa = np.arange(m) - 0.5 * (m - 1)
        found = find(products, layout, known, self._weight, last)
        if not len(found):
            return Estimate(0.0, math.inf, "no peak of the correlation")
        c, moved, reason = self._choose(products, layout, known, found)
        pattern = known
        if moved:  # else the ground is as fixed as the pattern
            information, precision = observe(spectra, c * kappa, size)
            pattern = shrink(
                self._pattern.information + information, self._pattern.precision + precision
            )
        found_fit = self._fit(lines, pattern, c, 0.0, last=False)
        if found_fit.found and moved:
            paths = found_fit.displacement * kappa + found_fit.change * 0.5 * kappa**2
            information, precision = observe(spectra, paths, size)
            pattern = shrink(
                self._pattern.information + information, self._pattern.precision + precision
            )
        if found_fit.found:
            found_fit = self._fit(
                lines, pattern, found_fit.displacement, found_fit.change, last=True
            )
        if not found_fit.found:
            return Estimate(c, math.inf, "no maximum of the likelihood")
        fewest = _FEWEST if moved else _FEWEST_STATIC
        if not reason and found_fit.features < fewest:
            reason = f"dominated by {found_fit.features:.1f} features"
        if not reason and moved:
            reason = self._contradiction(products, layout, found_fit.displacement, c)
        if not reason and moved:
            self._learn(found_fit.displacement * (m - 1), information, precision, n)
        return Estimate(
            found_fit.displacement,
            found_fit.variance,
            reason,
            found_fit.coherence,
        )

    def _choose(
        self, products: Products, layout: Layout, known: Spectrum, found: Doubles
    ) -> _Choice:
        """Return the candidate that explains the lines best.

        What is fixed in the view is in the mean of the batch; what is left of a static scene is
        noise. So any motion that shows in it rules out rest.
        """
        removed = products.mean if layout.lines >= _FEWEST_LINES else known
        told = rate(products, layout, removed, found)
        best = int(np.argmax(told))
        static = np.flatnonzero(abs(found) * (layout.lines - 1) < _STATIC)
        if told[best] < _NOISE and len(static):
            c = float(found[static[0]])
            own = coherent(products, layout, known, c, 1.0, 0)
            return _Choice(c, False, "" if own > _LIKELY else "low texture")
        if told[best] < _LIKELY:
            return _Choice(float(found[best]), True, "low texture")
        # Neighboring lines do not part slow displacements, lines farther apart do.
        near = (abs(found - found[best]) < _RESOLVED) & (told > _RATIO * told[best])
        far = min(farthest(c, layout) for c in found[near])
        spread = 0.5 / lags(layout.lines)[far]
        apart = [
            coherent(products, layout, removed, c, spread, far) if own else 0.0
            for c, own in zip(found, near, strict=True)
        ]
        if max(apart) > _LIKELY:
            best = int(np.argmax(apart))
        other = abs(found - found[best]) >= _RESOLVED
        rival = float(np.max(told, where=other, initial=0.0))
        ambiguous = rival > _RATIO * told[best]
        return _Choice(float(found[best]), True, "ambiguous" if ambiguous else "")

    def _contradiction(self, products: Products, layout: Layout, value: float, c: float) -> str:
        """Return why lines without what is fixed in them do not show a displacement, if so.

        Args:
            products: of the batch.
            layout: sizes of the batch.
            value: the displacement [px].
            c: the candidate that it was refined from [px].
        """
        if layout.lines < _FEWEST_LINES:
            return ""
        far = min(farthest(value, layout), farthest(c, layout))
        spread = 0.5 / lags(layout.lines)[far]
        own, other = (coherent(products, layout, products.mean, d, spread, far) for d in (value, c))
        return "a fixed pattern prevails" if own < _RATIO * other - _NOISE else ""

    def _fit(self, lines: Lines, pattern: Spectrum, d: float, a: float, *, last: bool) -> Fit:
        rest = without(lines, pattern, self._taper, self._size)
        found: Fit = fit(rest, d, a, self._spread, _STEPS, last)
        return found

    def _learn(self, way: float, information: Spectrum, precision: Doubles, pixels: int) -> None:
        """Take what a batch says of the pattern, from new ground only."""
        self._way += abs(way)
        if self._way < _NEW_GROUND * pixels:
            return
        self._way = 0.0
        kept = np.float32(1.0 - 1.0 / _MEMORY)
        before = self._pattern
        self._pattern = FixedPattern(
            before.information * kept + information, before.precision * kept + precision
        )
