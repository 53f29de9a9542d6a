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

Detail finer than pixels folds back to frequencies near half of the sampling rate and pulls to whole
pixels, so these do not count. The overlap o of two lines falls as they shift, which pulls to zero
by a fiftieth of a pixel at 128 px, the more the redder the spectrum. So the spectrum is fitted of
``c(u) (o(2 d - u) / o(u))^0.5``, with c the correlation of the windowed lines: the same overlap on
both sides of d, which does not pull.

Where two things move in the view, the ground and the joints of its bricks, which run askew, their
peaks melt into one as long as they are less apart than a structure is wide. Lines that are three
apart part them, and tell the ground two times better by it. So d is a third of the shift of these,
found anew over the whole range, and a quarter of the square by which it differs from that of
consecutive lines goes into the variance: what one pulls at, the other shows.

What stands still in the view (dirt, unlike pixels) has the same cross-spectrum however far two
lines are apart: that of the first and the last third of a batch, which is taken off until the
flat field knows it. Where the view has hardly moved on in between, that would take off the ground
as well: then the displacement lies halfway between those with and without, and the variance knows.
What lasts while the view moves on, a joint or a grain, may run askew: it is taken off likewise, and
how far the rest moves otherwise is the doubt of a match across it.

What is left errs by the larger of two. The phases scatter from band to band:
``V = sum_b (sum_(f in b) W f Im S)^2 / (sum_f W f^2 Re S)^2``. A stone that comes into the view
pulls in many bands alike, but at its place: with a and b the new and the old line, filtered by
W^0.5 and moved onto each other, ``(a + b)' (b - a) / 2`` sums over the line to the sum over f of
``W f Im S``. Its sums over places of the ground, an eighth of the view each, which move on with d,
scatter as those of the bands do. No factor in this was fitted on some grounds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy  # whose fft is loaded by its first use: not where configurations are read
from numba import njit
from numpy.typing import NDArray

from linescan_odometry.measurements import Lines

Spectra = NDArray[np.complex64]
Cross = NDArray[np.complex128]
Values = NDArray[np.float64]
Filtered = NDArray[np.float32]

_TAPER = 16  # part of a line that fades in and out
FEWEST_LINES = 12
_SMOOTHED = 9  # frequencies of twice the line
_SIDE = _SMOOTHED // 2
_BAND = 4
_FEWEST_FREEDOMS = 4.0
_BLOCKS = 32  # of a line
_PLACES = 8  # of a view, that err each by themselves
_INCOHERENT = 0.3
_HIGHEST = 0.3  # of the sampling rate: what is finer than pixels pulls to whole pixels beyond
_COARSEST, _FINEST = 100.0, 6.0  # px of the structures that the first search goes by
_STEPS = 6
_CONVERGED, _NEARLY = 1e-4, 0.02  # px
_LONGEST_STEP = 2.0  # px
_PULL = 0.003  # px, to whole pixels and by uneven overlap, which does not scatter
_LONE = 0.75  # of the highest peak, that no other one exceeds
_SHOULDER = 8  # px
_REACH = 0.4  # of a line, by which lines have shifted that are compared
_APART = (3, 2)  # lines, that tell the displacement
_PARTED = 0.25  # of the square by which they differ from consecutive ones, that they may err by
_MOVED_ON = 200.0  # px, between these, beyond which nothing can stand still and seem to move
_LEAST_OVERLAP = 0.25  # of that on the other side of the displacement
_RENEWED = 0.5  # of the coherence, that the first and the last third have at most

# Sums in any order; such a kernel must not be called by another one (see `subpixel`).
_REORDER = {"reassoc", "contract", "nsz"}


class Whitened(NamedTuple):
    """What all lines of a batch show together.

    Attributes:
        displacement: per line [px].
        variance: of it [px^2].
        lone: whether no other displacement comes near.
        lasting: coherence of lines far apart over that of consecutive ones [1].
        apart: number of lines between these.
        doubt: variance of the displacement if what lasts is grain, from what does not [px^2].
        places: over how many places of a line the slopes are spread that were matched.
    """

    displacement: float
    variance: float
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
        self._overlaps = np.zeros(self._size)  # by the index of a correlation
        self._overlaps[:pixels] = self._overlap
        self._overlaps[-pixels + 1 :] = self._overlap[:0:-1]
        share = np.arange(self._size // 2 + 1) / self._size
        self._frequency = 2.0 * np.pi * share
        self._band = -np.expm1(-((_COARSEST * share) ** 2)) * np.exp(-((_FINEST * share) ** 2))
        self._used = int(np.count_nonzero(share < _HIGHEST))
        self._coarse = scipy.fft.next_fast_len(2 * self._used, real=True)  # samples that show these

    def match(self, lines: Lines, *, settled: bool, with_lasting: bool = True) -> Whitened | None:
        """Return the displacement of a batch, None where it does not show.

        Args:
            lines: m + 1 lines, oldest first, shape (m + 1, n).
            settled: whether it is known what stands still in the view.
            with_lasting: whether it is asked what lasts, else 0 of it with an infinite doubt.
        """
        if len(lines) < FEWEST_LINES:
            return None
        seen = lines.astype(np.float32)
        seen -= seen.mean(axis=1, keepdims=True)
        seen *= self._window
        spectra = scipy.fft.rfft(seen, self._size, axis=1)
        between = len(lines) - len(lines) // 3
        near, thirds = (_product(spectra, apart) for apart in (1, between))
        energy = _product(spectra, 0).real
        power = _smooth(energy) + 1e-9 * len(lines) * float(energy.max()) + 1e-9
        still = thirds.real
        found = self._measure(spectra, near, power, None if settled else still)
        if found is None:
            return None
        displacement, variance, lone, weight = found
        slopes = spectra[-1] * (self._frequency * np.sqrt(weight) * 1j).astype(np.complex64)
        slope = scipy.fft.irfft(slopes, self._size)[: self._block * _BLOCKS]
        energy = np.square(slope).reshape(_BLOCKS, -1).sum(axis=1)
        places = float(energy.sum() ** 2 / (energy @ energy))
        seen_at = displacement  # per line, by what is compared
        if not settled:
            other = self._measure(spectra, near, power, None)
            one = self._may_be_one(near, thirds, power, displacement * between)
            if other is None or not other[2]:
                if one:
                    return None
            elif one:
                half = 0.5 * (displacement - other[0])
                seen_at, displacement = other[0], displacement - half
                variance = max(variance, other[1]) + half**2
            elif (displacement - other[0]) ** 2 < 4.0 * variance:  # nothing stands still
                variance = other[1] + 0.25 * (displacement - other[0]) ** 2
                seen_at = displacement = other[0]
        if not with_lasting:
            return Whitened(displacement, variance, lone, 0.0, between, math.inf, places)
        reach = _REACH * lines.shape[1] / max(abs(seen_at), 1e-3)
        if reach < between:  # the ends of the batch share no ground: lines that still do
            between = max(1, int(reach))
            thirds = _product(spectra, between)
        step = 2.0 * np.pi / self._size
        lasting = _turned(thirds, step * seen_at * between)
        rest = near - _turned(lasting, -step * seen_at)
        moved = _turned(near, step * seen_at)
        like = float(self._band @ (_smooth(lasting.real) / power))
        like /= max(float(self._band @ (_smooth(moved.real) / power)), 1.0)
        way = abs(seen_at)
        like *= float(self._overlap[round(way)] / self._overlap[round(way * between)])
        others = self._find(rest, power, self._limit)
        doubt = math.inf
        if others is not None and others[2]:
            doubt = (others[0] - displacement) ** 2 + max(others[1], variance)
        return Whitened(displacement, variance, lone, like, between, doubt, places)

    def _may_be_one(
        self,
        near: Cross,
        thirds: Cross,
        power: Values,
        way: float,
    ) -> bool:
        """Return whether what stands still may be ground that has hardly moved on [px]."""
        if abs(way) > _MOVED_ON:
            return False
        return self._likeness(thirds, power) > _RENEWED * self._likeness(near, power)

    def _measure(
        self, spectra: Spectra, near: Cross, power: Values, still: Values | None
    ) -> tuple[float, float, bool, Values] | None:
        """Return the displacement per line, its variance, whether it is alone, W.

        None without a peak.

        Args:
            spectra: of the lines.
            near: cross-spectrum of consecutive ones.
            power: of the lines, smoothed.
            still: spectrum of what stands still, None for nothing.
        """
        found = self._find(near if still is None else near - still, power, self._limit)
        if found is None:
            return None
        first, lone, apart, reach = found[0], found[2], 1, int(_REACH * len(self._window))
        if _APART[0] * abs(first) < reach:
            lone = False
            for between in _APART:  # fewer where the view changes too fast
                far = _product(spectra, between)
                farther = self._find(far if still is None else far - still, power, reach)
                if farther is not None and farther[2]:
                    found, lone, apart = farther, True, between
                    break
        shift, variance, _, weight, curvature = found
        variance = max(variance, self._of_places(spectra, weight, shift, apart, curvature))
        displacement = shift / apart
        variance = max(variance / apart**2, _PULL**2) + _PARTED * (displacement - first) ** 2
        return displacement, variance, lone, weight

    def _find(
        self, near: Cross, power: Values, limit: int
    ) -> tuple[float, float, bool, Values, float] | None:
        """Return a shift, its variance by the bands, whether it is alone, W, curvature.

        None without a peak within a limit [px].
        """
        first, lone = self._search(near / power, limit)
        weight = np.zeros(len(power))
        converged, displacement, square, leverage, curvature = _fit(
            self._level(near, first),
            power,
            2.0 * np.pi / self._size,
            self._used,
            float(first),
            weight,
        )
        if not converged:
            return None
        return displacement, square * _as_student(leverage), lone, weight, curvature

    def _of_places(
        self, spectra: Spectra, weight: Values, shift: float, apart: int, curvature: float
    ) -> float:
        """Return the variance by what the places of the ground add to a shift [px^2]."""
        scale = self._coarse / self._size
        rows = len(spectra) - apart
        slope = np.empty((rows, self._used), np.complex64)
        rest = np.empty_like(slope)
        _filter_pairs(spectra, weight, 2.0 * np.pi / self._size, shift, slope, rest)
        added, told = _by_place(
            scipy.fft.irfft(slope, self._coarse, axis=1),
            scipy.fft.irfft(rest, self._coarse, axis=1),
            shift / apart * scale,
            round(len(self._window) * scale),
        )
        added *= self._coarse / (2.0 * rows * curvature)
        share = told / told.sum()
        added -= share * added.sum()
        return float(added @ added) * _as_student(float(share @ share))

    def _level(self, near: Cross, displacement: int) -> Cross:
        """Return a cross-spectrum whose lines overlap alike on both sides of a displacement."""
        correlation = scipy.fft.irfft(near, self._size)
        _mirror(correlation, self._overlaps, displacement)
        level: Cross = scipy.fft.rfft(correlation)
        return level

    def _likeness(self, cross: Cross, power: Values) -> float:
        """Return the sum of the coherences over the band, whatever the displacement."""
        return float(self._band @ (np.hypot(_smooth(cross.real), _smooth(cross.imag)) / power))

    def _search(self, cross: Cross, limit: int) -> tuple[int, bool]:
        """Return the highest peak of the whitened correlation [px], and whether it stands alone."""
        correlation = scipy.fft.irfft((cross * self._band).astype(np.complex64), self._size)
        around = np.concatenate((correlation[-limit:], correlation[: limit + 1]))[::-1]
        peak = int(np.argmax(around))
        highest = float(around[peak])
        around[max(0, peak - _SHOULDER) : peak + _SHOULDER + 1] = 0.0
        return peak - limit, float(around.max()) < _LONE * highest


def _as_student(leverage: float) -> float:
    """Return the factor of a variance that few parts of known leverages tell, as Student's t."""
    freedoms = max(1.0 / leverage, _FEWEST_FREEDOMS)
    return freedoms / (freedoms - 2.0)


def _smooth(values: Values) -> Values:
    return np.convolve(values, np.full(_SMOOTHED, 1.0 / _SMOOTHED), "same")


@njit(cache=True, nogil=True)
def _mirror(correlation: Values, overlaps: Values, displacement: int) -> None:
    """Scale a correlation to the same overlap on both sides of a displacement."""
    size = len(correlation)
    opposite = 2 * displacement % size
    for k in range(size):
        mirrored = overlaps[opposite]
        if mirrored == 0.0:
            correlation[k] = 0.0
        else:
            least = _LEAST_OVERLAP * mirrored + 1.0
            correlation[k] *= math.sqrt(mirrored / max(overlaps[k], least))
        opposite = opposite + 1 if opposite + 1 < size else 0


@njit(cache=True, nogil=True)
def _turned(cross: Cross, angle: float) -> Cross:
    """Return a cross-spectrum less the phases of a displacement, an angle per frequency [rad]."""
    turned = np.empty_like(cross)
    step = complex(math.cos(angle), -math.sin(angle))
    phase = complex(1.0, 0.0)
    for k in range(len(cross)):
        turned[k] = cross[k] * phase
        phase *= step
    return turned


@njit(cache=True, nogil=True, fastmath=_REORDER)
def _product(spectra: Spectra, apart: int) -> Cross:
    """Return the mean of the cross-spectra of lines that are so many apart."""
    rows, bins = spectra.shape
    real, imaginary = np.zeros((2, bins), np.float32)
    for row in range(apart, rows):
        new, old = spectra[row], spectra[row - apart]
        for k in range(bins):
            a, b = new[k], old[k]
            real[k] += a.real * b.real + a.imag * b.imag
            imaginary[k] += a.imag * b.real - a.real * b.imag
    product = np.empty(bins, np.complex128)
    for k in range(bins):
        product[k] = complex(real[k], imaginary[k]) / (rows - apart)
    return product


@njit(cache=True, nogil=True, fastmath=_REORDER)
def _fit(
    near: Cross,
    power: Values,
    step: float,
    used: int,
    displacement: float,
    weight: Values,
) -> tuple[bool, float, float, float, float]:
    """Find the displacement by Gauss-Newton steps.

    Args:
        near: cross-spectrum of pairs of lines.
        power: of the lines, smoothed.
        step: from one frequency to the next [rad/px].
        used: number of frequencies that count, from zero on.
        displacement: where to begin [px].
        weight: receives W.

    Returns:
        Whether there is a peak; its displacement [px]; the sum over the bands of the squares of
        what their phases add to the displacement [px^2], and of their leverages; the curvature of
        the peak.
    """
    real, imaginary = np.zeros((2, used + 2 * _SIDE))  # with a margin for smoothing
    moved, curvature = 0.0, 0.0
    for turn in range(_STEPS + 1):
        angle = step * displacement
        rotation, phase = complex(math.cos(angle), -math.sin(angle)), complex(1.0, 0.0)
        for k in range(min(used + _SIDE, len(near))):
            turned = near[k] * phase
            real[_SIDE + k], imaginary[_SIDE + k] = turned.real, turned.imag
            phase *= rotation
        if turn == _STEPS or (turn > 0 and abs(moved) < _CONVERGED):
            break
        slope, curvature = 0.0, 0.0
        for k in range(1, used):
            total = 0.0
            for beside in range(_SMOOTHED):
                total += real[k + beside]
            coherence = min(max(total / _SMOOTHED / power[k], 0.0), 1.0)
            weight[k] = coherence / max(1.0 - coherence * coherence, _INCOHERENT) / power[k]
            frequency = step * k
            slope += weight[k] * frequency * imaginary[_SIDE + k]
            curvature += weight[k] * frequency * frequency * real[_SIDE + k]
        if not curvature > 0.0:
            return False, displacement, 0.0, 0.0, 0.0
        moved = slope / curvature
        displacement += min(max(moved, -_LONGEST_STEP), _LONGEST_STEP)
    square, leverage, score, told = 0.0, 0.0, 0.0, 0.0
    for k in range(used):
        # Sums over neighbouring frequencies, which know of each other.
        if k % _BAND == 0:
            square += score * score
            leverage += told * told
            score, told = 0.0, 0.0
        frequency = step * k
        share = weight[k] * frequency * frequency * real[_SIDE + k] / curvature
        score += weight[k] * frequency * imaginary[_SIDE + k] / curvature
        told += share
    square += score * score
    leverage += told * told
    return abs(moved) < _NEARLY, displacement, square, leverage, curvature


@njit(cache=True, nogil=True, fastmath=_REORDER)
def _filter_pairs(
    spectra: Spectra,
    weight: Values,
    step: float,
    displacement: float,
    slope: Spectra,
    rest: Spectra,
) -> None:
    """Move pairs of lines that are equally far apart onto each other, filtered by W^0.5.

    Args:
        spectra: of the lines, shape (m + a, k) or longer ones.
        weight: W.
        step: from one frequency to the next [rad/px].
        displacement: of the lines of a pair [px].
        slope: receives that of the mean of the two lines of each pair, shape (m, k).
        rest: receives by which they differ, shape (m, k).
    """
    rows, used = slope.shape
    apart = len(spectra) - rows
    root = np.empty(used, np.float32)
    real, imaginary = np.empty((2, used), np.float32)
    for k in range(used):
        root[k] = math.sqrt(weight[k])
        real[k] = root[k] * math.cos(step * k * displacement)
        imaginary[k] = root[k] * math.sin(step * k * displacement)
    half = np.float32(0.5 * step)
    for row in range(rows):
        for k in range(used):
            a, b = spectra[row + apart, k], spectra[row, k]
            new_real, new_imaginary = root[k] * a.real, root[k] * a.imag
            old_real = b.real * real[k] - b.imag * imaginary[k]
            old_imaginary = b.real * imaginary[k] + b.imag * real[k]
            frequency = half * np.float32(k)
            slope[row, k] = complex(
                frequency * (new_imaginary + old_imaginary), -frequency * (new_real + old_real)
            )
            rest[row, k] = complex(old_real - new_real, old_imaginary - new_imaginary)


@njit(cache=True, nogil=True, fastmath=_REORDER)
def _by_place(
    slope: Filtered, rest: Filtered, displacement: float, pixels: int
) -> tuple[Values, Values]:
    """Sum what pairs of lines add to a displacement, and what they tell, by places of the ground.

    Args:
        slope: of the mean of the two lines of each pair, shape (m, l).
        rest: by which they differ, shape (m, l).
        displacement: of the ground from line to line [px].
        pixels: n, of them that are lines.
    """
    rows, place = len(slope), pixels / _PLACES
    count = int(_PLACES + abs(displacement) * rows / place) + 2
    added, told = np.zeros((2, count))
    for row in range(rows):
        # The ground comes towards the first pixel where the displacement is positive.
        way = displacement * row if displacement >= 0.0 else -displacement * (rows - row)
        at, k = int(way / place), 0
        while k < pixels:
            end = min(int((at + 1) * place - way) + 1, pixels)
            total, square = np.float32(0.0), np.float32(0.0)
            for j in range(k, end):
                total += slope[row, j] * rest[row, j]
                square += slope[row, j] * slope[row, j]
            added[at] += total
            told[at] += square
            at, k = at + 1, max(end, k)
    return added, told
