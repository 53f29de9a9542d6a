"""One displacement for all lines of a batch, by whitened correlation of their spectra.

Moving across its axis, a camera sees slanted edges shift along it: the strongest edges of a view,
matched as they are, pull by more than all fine detail together can outweigh. Here every frequency
counts by what it can tell. With ``S`` the sum of the cross-spectra of consecutive lines, ``P`` that
of their power and d the displacement per line,

    S(f) = gamma(f) P(f) exp(2 pi i f d),

where the coherence gamma is lowered by noise and by the ground that enters and leaves the view. The
likelihood of d has its maximum where ``sum_f W f Im(S exp(-2 pi i f d))`` vanishes, with
``W = gamma^2 / (1 - gamma^2) / |S|`` (Hannan and Thomson 1973). Single frequencies cannot outweigh
the others, as 1 - gamma^2 counts as 0.3 at least. The first d is the peak of the whitened
correlation (Knapp and Carter 1976) over the whole range. What single pairs of lines do not show,
all pairs together do.

What stands still in the view (dirt, unlike pixels) has the same cross-spectrum however far two
lines are apart: that of the first and the last third of a batch, which is taken off until the
flat field knows it. Where the view has hardly moved on in between, that would take off the ground
as well: then the displacement lies halfway between those with and without, and the variance knows.
What lasts while the view moves on, a joint or a grain, may run askew: it is taken off likewise, and
how far the rest moves otherwise is the doubt of a match across it.

The phases that are left scatter from band to band:
``V = sum_b (sum_(f in b) W f Im S)^2 / (sum_f W f^2 Re S)^2``. Pulls that several bands share do
not show in this; how many there are goes with the ground that enters the view. Fitted on ten
grounds, each judged by a fit on the others, is the factor ``9.5 (1 - gamma_1)^0.5 (1 - gamma_6)``
of the mean coherences of lines 1 and 6 apart.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from linescan_odometry.measurements import Lines

Spectra = NDArray[np.complex64]

_TAPER = 16  # part of a line that fades in and out
_APART = 6  # lines, over which the ground that enters shows
_FEWEST_LINES = 2 * _APART
_SMOOTHED = 9  # frequencies of twice the line
_BAND = 4
_FEWEST_FREEDOMS = 4.0
_BLOCKS = 32  # of a line
_INCOHERENT = 0.3
_HIGHEST = 0.45  # of the sampling rate
_COARSEST, _FINEST = 100.0, 6.0  # px of the structures that the first search goes by
_STEPS = 6
_CONVERGED, _NEARLY = 1e-4, 0.02  # px
_LONGEST_STEP = 2.0  # px
_LEAST_FACTOR, _FACTOR = 1.3, 9.5
_LONE = 0.75  # of the highest peak, that no other one exceeds
_SHOULDER = 8  # px
_REACH = 0.4  # of a line, by which lines have shifted that are compared
_MOVED_ON = 200.0  # px, between these, beyond which nothing can stand still and seem to move
_RENEWED = 0.5  # of the coherence, that the first and the last third have at most


class Whitened(NamedTuple):
    """What all lines of a batch show together.

    Attributes:
        displacement: per line [px].
        variance: of it [px^2].
        coherence: of consecutive lines, mean over the frequencies by their weight [1].
        lone: whether no other displacement comes near.
        lasting: coherence of lines far apart over that of consecutive ones [1].
        apart: number of lines between these.
        doubt: variance of the displacement if what lasts is grain, from what does not [px^2].
        places: over how many places of a line the slopes are spread that were matched.
    """

    displacement: float
    variance: float
    coherence: float
    lone: bool
    lasting: float
    apart: int
    doubt: float
    places: float


class WhitenedMatcher:
    """Matches the lines of one camera by their spectra."""

    def __init__(self, pixels: int, limit: int) -> None:
        """Prepare for lines of n pixels.

        Args:
            pixels: n.
            limit: largest displacement that is looked for [px].
        """
        self._size = scipy.fft.next_fast_len(2 * pixels, real=True)
        self._limit = limit
        self._block = max(1, pixels // _BLOCKS)
        edge = max(1, pixels // _TAPER)
        self._window = np.ones(pixels, np.float32)
        self._window[:edge] = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
        self._window[-edge:] = self._window[:edge][::-1]
        self._overlap = np.correlate(self._window, self._window, "full")[pixels - 1 :]
        share = np.arange(self._size // 2 + 1) / self._size
        self._frequency = 2.0 * np.pi * share
        self._band = -np.expm1(-((_COARSEST * share) ** 2)) * np.exp(-((_FINEST * share) ** 2))
        self._used = (share > 0.0) & (share < _HIGHEST)

    def match(self, lines: Lines, *, settled: bool) -> Whitened | None:
        """Return the displacement of a batch, None where it does not show.

        Args:
            lines: m + 1 lines, oldest first, shape (m + 1, n).
            settled: whether it is known what stands still in the view.
        """
        if len(lines) < _FEWEST_LINES:
            return None
        seen = lines.astype(np.float32)
        seen -= seen.mean(axis=1, keepdims=True)
        seen *= self._window
        spectra = scipy.fft.rfft(seen, self._size, axis=1)
        pairs, third = len(lines) - 1, len(lines) // 3
        between = len(lines) - third
        near = _product(spectra, 1) / pairs
        far = _product(spectra, _APART) / (len(lines) - _APART)
        thirds = _product(np.concatenate((spectra[:third], spectra[-third:])), third) / third
        energy = np.einsum("ij,ij->j", spectra.real, spectra.real)
        energy += np.einsum("ij,ij->j", spectra.imag, spectra.imag)
        power = _smooth(energy / len(lines)) + 1e-9 * float(energy.max()) + 1e-9
        still = thirds.real
        found = self._find(near if settled else near - still, far, power)
        if found is None:
            return None
        displacement, variance, coherence, lone, weight = found
        slopes = spectra[-1] * (self._frequency * np.sqrt(weight) * 1j)
        slope = scipy.fft.irfft(slopes, self._size)[: self._block * _BLOCKS]
        energy = np.square(slope).reshape(_BLOCKS, -1).sum(axis=1)
        places = float(energy.sum() ** 2 / (energy @ energy))
        seen_at = displacement  # per line, by what is compared
        if not settled:
            other = self._find(near, far, power)
            one = self._may_be_one(near, thirds, power, displacement * between)
            if other is None or not other[3]:
                if one:
                    return None
            elif one:
                half = 0.5 * (displacement - other[0])
                seen_at, displacement = other[0], displacement - half
                variance = max(variance, other[1]) + half**2
            elif (displacement - other[0]) ** 2 < 4.0 * variance:  # nothing stands still
                variance = other[1] + 0.25 * (displacement - other[0]) ** 2
                seen_at = displacement = other[0]
        reach = _REACH * lines.shape[1] / max(abs(seen_at), 1e-3)
        if reach < between:  # the ends of the batch share no ground: lines that still do
            between = max(1, int(reach))
            thirds = _product(spectra, between) / (len(lines) - between)
        lasting = self._turned(thirds, seen_at * between)
        rest = near - self._turned(lasting, -seen_at)
        moved = self._turned(near, seen_at)
        like = float(self._band @ (_smooth(lasting.real) / power))
        like /= max(float(self._band @ (_smooth(moved.real) / power)), 1.0)
        step = abs(seen_at)
        like *= float(self._overlap[round(step)] / self._overlap[round(step * between)])
        others = self._find(rest, far, power)
        doubt = math.inf
        if others is not None and others[3]:
            doubt = (others[0] - displacement) ** 2 + others[1]
        return Whitened(displacement, variance, coherence, lone, like, between, doubt, places)

    def _may_be_one(
        self,
        near: NDArray[np.complex128],
        thirds: NDArray[np.complex128],
        power: NDArray[np.float64],
        way: float,
    ) -> bool:
        """Return whether what stands still may be ground that has hardly moved on [px]."""
        if abs(way) > _MOVED_ON:
            return False
        return self._likeness(thirds, power) > _RENEWED * self._likeness(near, power)

    def _find(
        self,
        near: NDArray[np.complex128],
        far: NDArray[np.complex128],
        power: NDArray[np.float64],
    ) -> tuple[float, float, float, bool, NDArray[np.float64]] | None:
        """Return displacement, variance, coherence, whether the peak is alone, and the weights W.

        None without a peak.
        """
        first, lone = self._search(near / power)
        found = self._refine(near, power, first)
        if found is None:
            return None
        displacement, weight, curvature = found
        turned = self._turned(near, displacement)
        score = weight * self._frequency * turned.imag / curvature
        bands = _in_bands(score)
        told = weight * self._frequency**2 * turned.real / curvature
        leverage = _in_bands(told)
        freedoms = max(1.0 / float(leverage @ leverage), _FEWEST_FREEDOMS)
        told /= power
        coherence = float(told @ turned.real)
        later = float(told @ self._turned(far, displacement * _APART).real)
        factor = _FACTOR * math.sqrt(max(1.0 - coherence, 0.0)) * max(1.0 - later, 0.0)
        variance = float(bands @ bands) * max(_LEAST_FACTOR, factor)
        variance *= freedoms / (freedoms - 2.0)  # as Student's t
        return displacement, variance, coherence, lone, weight

    def _likeness(self, cross: NDArray[np.complex128], power: NDArray[np.float64]) -> float:
        """Return the sum of the coherences over the band, whatever the displacement."""
        return float(self._band @ (np.hypot(_smooth(cross.real), _smooth(cross.imag)) / power))

    def _turned(self, cross: NDArray[np.complex128], displacement: float) -> NDArray[np.complex128]:
        """Return a cross-spectrum less the phases of a displacement [px]."""
        turned: NDArray[np.complex128] = cross * np.exp(-1j * self._frequency * displacement)
        return turned

    def _search(self, cross: NDArray[np.complex128]) -> tuple[float, bool]:
        """Return the highest peak of the whitened correlation [px], and whether it stands alone."""
        correlation = scipy.fft.irfft(cross * self._band, self._size)
        around = np.concatenate((correlation[-self._limit :], correlation[: self._limit + 1]))[::-1]
        peak = int(np.argmax(around))
        highest = float(around[peak])
        around[max(0, peak - _SHOULDER) : peak + _SHOULDER + 1] = 0.0
        return float(peak - self._limit), float(around.max()) < _LONE * highest

    def _refine(
        self,
        cross: NDArray[np.complex128],
        power: NDArray[np.float64],
        displacement: float,
    ) -> tuple[float, NDArray[np.float64], float] | None:
        """Return the displacement, the weights W and the curvature there; None without a peak."""
        for _ in range(_STEPS):
            turned = self._turned(cross, displacement)
            coherence = np.clip(_smooth(turned.real) / power, 0.0, 1.0)
            weight = coherence / np.maximum(1.0 - coherence**2, _INCOHERENT) / power
            weight *= self._used
            curvature = float(np.sum(weight * self._frequency**2 * turned.real))
            if not curvature > 0.0:
                return None
            step = float(np.sum(weight * self._frequency * turned.imag)) / curvature
            displacement += min(max(step, -_LONGEST_STEP), _LONGEST_STEP)
            if abs(step) < _CONVERGED:
                break
        return (displacement, weight, curvature) if abs(step) < _NEARLY else None


def _smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.convolve(values, np.full(_SMOOTHED, 1.0 / _SMOOTHED), "same")


def _in_bands(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums over neighbouring frequencies, which know of each other."""
    sums: NDArray[np.float64] = (
        values[: len(values) // _BAND * _BAND].reshape(-1, _BAND).sum(axis=1)
    )
    return sums


def _product(spectra: Spectra, apart: int) -> NDArray[np.complex128]:
    """Return the sum of the cross-spectra of lines that are so many apart."""
    product: NDArray[np.complex128] = np.einsum(
        "ij,ij->j", spectra[apart:], spectra[: len(spectra) - apart].conj()
    ).astype(np.complex128)
    return product
