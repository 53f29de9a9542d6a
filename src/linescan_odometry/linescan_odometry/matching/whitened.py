"""Whole-batch maximum-likelihood displacement, by generalized cross-correlation of the spectra.

In motion across the axis, slanted edges shift along it, and the strongest edges of a view bias a
match of gray levels. Here every frequency is weighted by its information. With ``S`` the sum of the
cross-spectra of consecutive lines, ``P`` that of their power and d the displacement per line,

    S(f) = gamma(f) P(f) exp(2 pi i f d),

where the coherence gamma is lowered by noise and by the ground that enters and leaves the view. The
likelihood of d has its maximum where ``sum_f W f Im(S exp(-2 pi i f d))`` vanishes, with ``W =
gamma^2 / (1 - gamma^2) / |S|`` (Hannan and Thomson 1973). Single frequencies cannot dominate,
because 1 - gamma^2 is limited to 0.3 from below. The first d is the peak of the whitened
correlation (Knapp and Carter 1976) over the whole range.

Detail finer than pixels is aliased to frequencies near half of the sampling rate and causes a bias
to whole pixels, so these are not used. The overlap o of two lines decreases with the shift, which
causes a bias to zero of a fiftieth of a pixel at 128 px, larger for low-frequency spectra. So the
spectrum is fitted of ``c(u) (o(2 d - u) / o(u))^0.5``, with c the correlation of the windowed
lines: the same overlap on both sides of d, without bias.

If two patterns move in the view, such as the ground and the oblique joints of its bricks, their
peaks merge while they are closer than the width of a feature. A larger line spacing separates them,
as long as the lines remain coherent. So d is estimated anew from lines up to eight apart with four
fifths of the coherence, or from lines three apart; a quarter of the squared difference to the
estimate from consecutive lines is added to the variance.

A fixed pattern (dirt, unequal pixels) has the same cross-spectrum at any line spacing: that of the
first and the last third of a batch is subtracted until the flat field is estimated. If the view has
hardly moved in between, this would also subtract the ground: then the displacement is the mean of
those with and without subtraction, and the variance contains their difference. A texture that
remains in the view during motion across the axis may be oblique: it is subtracted too, and the
difference of the remaining displacement is a variance for motion across the axis.

The variance is the larger of two estimates. The phases scatter from band to band:
``V = sum_b (sum_(f in b) W f Im S)^2 / (sum_f W f^2 Re S)^2``. A stone that enters the view
affects many bands, but one position: with a and b the new and the old line, filtered by
W^0.5 and moved onto each other, ``(a + b)' (b - a) / 2`` sums over the line to the sum over f of
``W f Im S``. Its sums over positions on the ground, an eighth of the view each, give the second
estimate. No factor is fitted to grounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy  # whose fft is loaded by its first use: not where configurations are read
from numpy.typing import NDArray

from linescan_odometry.matching.transforms import load_transforms
from linescan_odometry.measurements import Lines
from omni_platform.background import in_background
from omni_platform.kernels import kernel, njit

Cross = NDArray[np.complex128]
Values = NDArray[np.float64]
Filtered = NDArray[np.float32]

_TAPER = 16  # part of a line that fades in and out
FEWEST_LINES = 12
LONG = 16_384  # pixels of a batch, from which it is worth another thread
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
_APART, _LEAST_APART = 3, 2  # line spacings of the estimate
_FARTHEST, _CHANGED = 8, 0.2  # the same, where no more than this share of the view changes
_BESIDE = 2.0  # px per line, by which these may differ from consecutive ones
_PARTED = 0.25  # of the square by which they differ from consecutive ones, that they may err by
_MOVED_ON = 200.0  # px, between these, beyond which nothing can stand still and seem to move
_LEAST_OVERLAP = 0.25  # of that on the other side of the displacement
_RENEWED = 0.5  # of the coherence, that the first and the last third have at most

# Sums in any order. Such a kernel must not be in the cache itself if another one calls it (see
# `subpixel`): all but the two that Python calls are compiled with these alone.
_REORDER = {"reassoc", "contract", "nsz"}


class Whitened(NamedTuple):
    """Whole-batch estimate.

    Attributes:
        displacement: per line [px].
        variance: of the displacement [px^2].
        lone: whether the peak is unambiguous.
        lasting: coherence at a large line spacing over that of consecutive lines [1].
        apart: this line spacing [lines].
        oblique: variance of the displacement if the lasting texture is oblique [px^2].
        places: effective number of positions with the gradients of the match.
    """

    displacement: float
    variance: float
    lone: bool
    lasting: float
    apart: int
    oblique: float
    places: float


class _Camera(NamedTuple):
    """Constants of a camera.

    Attributes:
        window: of a line, shape (n,).
        overlap: of two windows, by their shift [px], shape (n,).
        overlaps: overlap by the index of a correlation, twice, shape (2 size,).
        band: weight of each frequency in the first search, shape (size // 2 + 1,).
        size: samples of a spectrum, at least twice a line.
        used: number of used frequencies, from zero on.
        coarse: number of samples for these frequencies.
        limit: largest displacement of the search [px].
    """

    window: Filtered
    overlap: Filtered
    overlaps: Values
    band: Values
    size: int
    used: int
    coarse: int
    limit: int


class _Spectra(NamedTuple):
    """Spectra of m lines, real and imaginary parts separately, shape (m, size // 2 + 1)."""

    real: Filtered
    imaginary: Filtered


class _Peak(NamedTuple):
    """A shift estimated from lines.

    Attributes:
        found: whether there is a peak.
        shift: [px].
        variance: of the shift [px^2].
        lone: whether the peak is unambiguous.
        curvature: of the likelihood.
    """

    found: bool
    shift: float
    variance: float
    lone: bool
    curvature: float


class WhitenedMatcher:
    """Matches the lines of one camera by their spectra."""

    def __init__(self, pixels: int, limit: int) -> None:
        """Prepare for lines of n pixels.

        Args:
            pixels: n.
            limit: largest displacement of the search [px].
        """
        load_transforms()
        size = scipy.fft.next_fast_len(2 * pixels, real=True)
        edge = max(1, pixels // _TAPER)
        window = np.ones(pixels, np.float32)
        window[:edge] = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
        window[-edge:] = window[:edge][::-1]
        overlap = np.correlate(window, window, "full")[pixels - 1 :]
        overlaps = np.zeros(size)
        overlaps[:pixels] = overlap
        overlaps[-pixels + 1 :] = overlap[:0:-1]
        share = np.arange(size // 2 + 1) / size
        band = -np.expm1(-((_COARSEST * share) ** 2)) * np.exp(-((_FINEST * share) ** 2))
        used = int(np.count_nonzero(share < _HIGHEST))
        coarse = scipy.fft.next_fast_len(2 * used, real=True)
        self._camera = _Camera(
            window, overlap, np.tile(overlaps, 2), band, size, used, coarse, limit
        )

    def match(self, lines: Lines, *, settled: bool, with_lasting: bool = True) -> Whitened | None:
        """Return the displacement of a batch, None without a peak.

        Args:
            lines: m + 1 lines, oldest first, shape (m + 1, n).
            settled: whether the fixed pattern is estimated.
            with_lasting: whether to compute `lasting` and `oblique`; otherwise they are 0 and
                infinite.
        """
        if len(lines) < FEWEST_LINES:
            return None
        return self._match(self._faded(lines), settled, with_lasting)

    def begin(self, lines: Lines, *, settled: bool) -> Callable[[], Whitened | None]:
        """Match a batch in the background; return a function for the result of `match`."""
        if len(lines) < FEWEST_LINES:
            return lambda: None
        work = partial(self._match, self._faded(lines), settled, True)
        return in_background(work, worth=lines.size >= LONG)

    def _faded(self, lines: Lines) -> Filtered:
        seen: Filtered = np.empty(lines.shape, np.float32)
        _fade(lines, self._camera.window, seen)
        return seen

    def _match(self, seen: Filtered, settled: bool, with_lasting: bool) -> Whitened | None:
        found, whitened = _match(seen, self._camera, settled, with_lasting)
        return whitened if found else None


@njit(cache=True, error_model="numpy")
def _fade(lines: Lines, window: Filtered, seen: Filtered) -> None:
    """Write lines without their means, multiplied by the window."""
    for row in range(len(lines)):
        line, into = lines[row], seen[row]
        total = np.int64(0)
        for i in range(len(line)):
            total += np.int64(line[i])
        mean = np.float32(total / len(line))
        for i in range(len(line)):
            into[i] = (np.float32(line[i]) - mean) * window[i]


@kernel
def _match(
    seen: Filtered, camera: _Camera, settled: bool, with_lasting: bool
) -> tuple[bool, Whitened]:
    """Return whether a batch has a displacement, and the estimate; see `WhitenedMatcher.match`."""
    spectra = _transform(seen, camera.size)
    rows, pixels = seen.shape
    between = rows - rows // 3
    nothing = Whitened(0.0, 0.0, False, 0.0, between, math.inf, 0.0)
    near, thirds = _product(spectra, 1), _product(spectra, between)
    energy = _product(spectra, 0).real.copy()
    power = _smooth(energy) + (1e-9 * rows * energy.max() + 1e-9)
    still, nothing_still = thirds.real.copy(), np.zeros(len(power))
    weight, other_weight = np.zeros((2, len(power)))
    peak = _measure(spectra, near, nothing_still if settled else still, power, camera, weight)
    if not peak.found:
        return False, nothing
    displacement, variance = peak.shift, peak.variance
    places = _spread(spectra, weight, camera)
    seen_at = displacement  # per line, by what is compared
    if not settled:
        other = _measure(spectra, near, nothing_still, power, camera, other_weight)
        one = _may_be_one(near, thirds, power, camera.band, displacement * between)
        if not (other.found and other.lone):
            if one:
                return False, nothing
        elif one:
            half = 0.5 * (displacement - other.shift)
            seen_at, displacement = other.shift, displacement - half
            variance = max(variance, other.variance) + half**2
        elif (displacement - other.shift) ** 2 < 4.0 * variance:  # nothing stands still
            variance = other.variance + 0.25 * (displacement - other.shift) ** 2
            seen_at = displacement = other.shift
    if not with_lasting:
        return True, Whitened(displacement, variance, peak.lone, 0.0, between, math.inf, places)
    reach = _REACH * pixels / max(abs(seen_at), 1e-3)
    if reach < between:  # the ends of the batch share no ground: lines that still do
        between = max(1, int(reach))
        thirds = _product(spectra, between)
    step = 2.0 * np.pi / camera.size
    lasting = _turned(thirds, step * seen_at * between)
    rest = near - _turned(lasting, -step * seen_at)
    moved = _turned(near, step * seen_at)
    like = _weighed(lasting, power, camera.band)
    like /= max(_weighed(moved, power, camera.band), 1.0)
    way = abs(seen_at)
    near_by, far = min(round(way), pixels - 1), min(round(way * between), pixels - 1)
    like *= camera.overlap[near_by] / camera.overlap[far]
    hidden = _find(rest, power, camera, camera.limit, other_weight)
    oblique = math.inf
    if hidden.found and hidden.lone:
        oblique = (hidden.shift - displacement) ** 2 + max(hidden.variance, variance)
    return True, Whitened(displacement, variance, peak.lone, like, between, oblique, places)


@njit(nogil=True, error_model="numpy")
def _measure(
    spectra: _Spectra,
    near: Cross,
    still: Values,
    power: Values,
    camera: _Camera,
    weight: Values,
) -> _Peak:
    """Find the displacement per line.

    Args:
        spectra: of the lines.
        near: cross-spectrum of consecutive lines.
        still: spectrum of the fixed pattern, which is subtracted.
        power: power spectrum of the lines, smoothed.
        camera: constants of the camera.
        weight: receives W.
    """
    moving = near - still
    peak: _Peak = _find(moving, power, camera, camera.limit, weight)
    if not peak.found:
        return peak
    first, lone, apart, reach = peak.shift, peak.lone, 1, int(_REACH * len(camera.window))
    if _APART * abs(first) < reach:
        lone = False
        other_weight = np.zeros_like(weight)
        between = _staying(spectra, moving, still, power, camera, first)
        while between >= _LEAST_APART:  # fewer where the view changes too fast
            far = _product(spectra, between) - still
            farther = _find(far, power, camera, reach, other_weight)
            beside = between <= _APART or abs(farther.shift / between - first) <= _BESIDE
            if farther.found and farther.lone and beside:
                peak, lone, apart = farther, True, between
                weight[:] = other_weight
                break
            between = min(between - 1, _APART)
    variance = max(peak.variance, _of_places(spectra, weight, peak, apart, camera))
    displacement = peak.shift / apart
    variance = max(variance / apart**2, _PULL**2) + _PARTED * (displacement - first) ** 2
    return _Peak(True, displacement, variance, lone, peak.curvature)


@njit(nogil=True, error_model="numpy")
def _staying(
    spectra: _Spectra,
    moving: Cross,
    still: Values,
    power: Values,
    camera: _Camera,
    first: float,
) -> int:
    """Return the largest line spacing with sufficient coherence, at least `_APART`."""
    most = min(_FARTHEST, len(spectra.real) // 3)
    most = min(most, int(_REACH * len(camera.window) / max(abs(first), 1e-3)))
    if most <= _APART:
        return _APART
    step = 2.0 * np.pi / camera.size * first
    moved = _likeness(_turned(moving, step), power, camera.band)
    far = _product(spectra, most) - still
    kept = _likeness(_turned(far, most * step), power, camera.band) / max(moved, 1e-9)
    by, far_by = round(abs(first)), round(abs(first) * most)
    changed = 1.0 - kept * camera.overlap[by] / camera.overlap[far_by]
    return most if changed <= _CHANGED else max(int(most * _CHANGED / changed), _APART)


@njit(nogil=True, error_model="numpy")
def _find(near: Cross, power: Values, camera: _Camera, limit: int, weight: Values) -> _Peak:
    """Find a shift within a limit [px], its variance by the bands; `weight` receives W."""
    first, lone = _search(near, power, camera, limit)
    level = _level(near, first, camera)
    step = 2.0 * np.pi / camera.size
    converged, displacement, square, leverage, curvature = _fit(
        level, power, step, camera.used, float(first), weight
    )
    variance = square * _as_student(leverage) if converged else math.inf
    return _Peak(converged, displacement, variance, lone, curvature)


@njit(nogil=True, error_model="numpy")
def _search(cross: Cross, power: Values, camera: _Camera, limit: int) -> tuple[int, bool]:
    """Return the highest peak of the whitened correlation [px], and whether it is unambiguous."""
    white = np.empty(len(cross), np.complex64)
    for k in range(len(cross)):
        white[k] = cross[k] * (camera.band[k] / power[k])
    correlation = scipy.fft.irfft(white, camera.size)
    peak, highest = limit, -math.inf
    for s in range(limit, -limit - 1, -1):
        if correlation[s] > highest:
            peak, highest = s, correlation[s]
    other = 0.0
    for s in range(-limit, limit + 1):
        if abs(s - peak) > _SHOULDER:
            other = max(other, correlation[s])
    return -peak, other < _LONE * highest


@njit(nogil=True, error_model="numpy")
def _level(near: Cross, displacement: int, camera: _Camera) -> Cross:
    """Return a cross-spectrum with the same overlap on both sides of a displacement."""
    correlation = scipy.fft.irfft(near, camera.size)
    opposite = 2 * displacement % camera.size
    _mirror(correlation, camera.overlaps[: camera.size], camera.overlaps[opposite:])
    level: Cross = scipy.fft.rfft(correlation)
    return level


@njit(nogil=True, error_model="numpy")
def _mirror(correlation: Values, overlaps: Values, mirrored: Values) -> None:
    """Scale a correlation to the same overlap on both sides of a displacement."""
    for k in range(len(correlation)):
        least = _LEAST_OVERLAP * mirrored[k] + 1.0
        correlation[k] *= math.sqrt(mirrored[k] / max(overlaps[k], least))


@njit(nogil=True, error_model="numpy")
def _spread(spectra: _Spectra, weight: Values, camera: _Camera) -> float:
    """Return the effective number of positions with the gradients of the match."""
    slopes = np.empty(len(weight), np.complex64)
    for k in range(len(weight)):
        frequency = np.float32(2.0 * np.pi / camera.size * k * math.sqrt(weight[k]))
        slopes[k] = complex(-frequency * spectra.imaginary[-1, k], frequency * spectra.real[-1, k])
    slope = scipy.fft.irfft(slopes, camera.size)
    block = max(1, len(camera.window) // _BLOCKS)
    total, squares = 0.0, 0.0
    for first in range(0, block * _BLOCKS, block):
        energy = 0.0
        for i in range(first, first + block):
            energy += float(slope[i]) ** 2
        total += energy
        squares += energy**2
    return total**2 / squares


@njit(nogil=True, error_model="numpy")
def _of_places(
    spectra: _Spectra, weight: Values, peak: _Peak, apart: int, camera: _Camera
) -> float:
    """Return the variance of a shift by its scatter over positions on the ground [px^2]."""
    scale = camera.coarse / camera.size
    rows = len(spectra.real) - apart
    slope = np.empty((rows, camera.used), np.complex64)
    rest = np.empty_like(slope)
    _filter_pairs(spectra, weight, 2.0 * np.pi / camera.size, peak.shift, slope, rest)
    added, information = _by_place(
        scipy.fft.irfft(slope, camera.coarse, 1),
        scipy.fft.irfft(rest, camera.coarse, 1),
        peak.shift / apart * scale,
        round(len(camera.window) * scale),
    )
    factor = camera.coarse / (2.0 * rows * peak.curvature)
    whole, all_information = 0.0, 0.0
    for place in range(len(added)):
        added[place] *= factor
        whole += added[place]
        all_information += information[place]
    squares, leverage = 0.0, 0.0
    for place in range(len(added)):
        share = information[place] / all_information
        squares += (added[place] - share * whole) ** 2
        leverage += share * share
    variance: float = squares * _as_student(leverage)
    return variance


@njit(nogil=True, error_model="numpy")
def _may_be_one(near: Cross, thirds: Cross, power: Values, band: Values, way: float) -> bool:
    """Return whether the fixed pattern may be ground that has hardly moved."""
    if abs(way) > _MOVED_ON:
        return False
    renewed: bool = _likeness(thirds, power, band) > _RENEWED * _likeness(near, power, band)
    return renewed


@njit(nogil=True, error_model="numpy")
def _likeness(cross: Cross, power: Values, band: Values) -> float:
    """Return the sum of the coherences over the band at any displacement."""
    real, imaginary = _smooth(cross.real), _smooth(cross.imag)
    total = 0.0
    for k in range(len(band)):
        total += band[k] * math.hypot(real[k], imaginary[k]) / power[k]
    return total


@njit(nogil=True, error_model="numpy")
def _weighed(cross: Cross, power: Values, band: Values) -> float:
    """Return the sum of the coherences over the band after removal of a displacement."""
    real = _smooth(cross.real)
    total = 0.0
    for k in range(len(band)):
        total += band[k] * real[k] / power[k]
    return total


@njit(nogil=True, error_model="numpy")
def _as_student(leverage: float) -> float:
    """Return the factor on a variance estimated from few parts, as for Student's t."""
    freedoms = max(1.0 / leverage, _FEWEST_FREEDOMS)
    return freedoms / (freedoms - 2.0)


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
def _smooth(values: Values) -> Values:
    """Return means over neighboring frequencies, with zeros beyond the ends."""
    padded = np.zeros(len(values) + 2 * _SIDE)
    padded[_SIDE : _SIDE + len(values)] = values
    smooth = np.zeros(len(values))
    for beside in range(_SMOOTHED):
        part = padded[beside : beside + len(values)]
        for k in range(len(values)):
            smooth[k] += part[k] * (1.0 / _SMOOTHED)
    return smooth


@njit(nogil=True, error_model="numpy")
def _turned(cross: Cross, angle: float) -> Cross:
    """Return a cross-spectrum without the phases of a displacement [rad]."""
    turned = np.empty_like(cross)
    step = complex(math.cos(angle), -math.sin(angle))
    phase = complex(1.0, 0.0)
    for k in range(len(cross)):
        turned[k] = cross[k] * phase
        phase *= step
    return turned


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
def _transform(seen: Filtered, size: int) -> _Spectra:
    """Return the spectra of lines, real and imaginary parts apart."""
    spectra = scipy.fft.rfft(seen, size, 1)
    rows, bins = spectra.shape
    apart = _Spectra(np.empty((rows, bins), np.float32), np.empty((rows, bins), np.float32))
    for row in range(rows):
        source, real, imaginary = spectra[row], apart.real[row], apart.imaginary[row]
        for k in range(bins):
            real[k], imaginary[k] = source[k].real, source[k].imag
    return apart


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
def _product(spectra: _Spectra, apart: int) -> Cross:
    """Return the mean of the cross-spectra at a line spacing."""
    rows, bins = spectra.real.shape
    real, imaginary = np.zeros(bins, np.float32), np.zeros(bins, np.float32)
    for row in range(apart, rows):
        new_real, new_imaginary = spectra.real[row], spectra.imaginary[row]
        old_real, old_imaginary = spectra.real[row - apart], spectra.imaginary[row - apart]
        for k in range(bins):
            a, b, c, d = new_real[k], new_imaginary[k], old_real[k], old_imaginary[k]
            real[k] += a * c + b * d
            imaginary[k] += b * c - a * d
    product = np.empty(bins, np.complex128)
    for k in range(bins):
        product[k] = complex(real[k], imaginary[k]) / (rows - apart)
    return product


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
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
        power: power spectrum of the lines, smoothed.
        step: from one frequency to the next [rad/px].
        used: number of used frequencies, from zero on.
        displacement: initial value [px].
        weight: receives W.

    Returns:
        Whether there is a peak; its displacement [px]; the sum over the bands of their squared
        contributions to the displacement [px^2], and of their leverages; the curvature of the
        peak.
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
    square, leverage, score, information = 0.0, 0.0, 0.0, 0.0
    for k in range(used):
        # Sums over neighboring frequencies, which know of each other.
        if k % _BAND == 0:
            square += score * score
            leverage += information * information
            score, information = 0.0, 0.0
        frequency = step * k
        share = weight[k] * frequency * frequency * real[_SIDE + k] / curvature
        score += weight[k] * frequency * imaginary[_SIDE + k] / curvature
        information += share
    square += score * score
    leverage += information * information
    return abs(moved) < _NEARLY, displacement, square, leverage, curvature


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
def _filter_pairs(
    spectra: _Spectra,
    weight: Values,
    step: float,
    displacement: float,
    slope: NDArray[np.complex64],
    rest: NDArray[np.complex64],
) -> None:
    """Align pairs of lines with a common line spacing, filtered by W^0.5.

    Args:
        spectra: of the lines, of m + a.
        weight: W.
        step: from one frequency to the next [rad/px].
        displacement: of the lines of a pair [px].
        slope: receives the gradient of the mean of the two lines of each pair, shape (m, k).
        rest: receives the difference of the two lines, shape (m, k).
    """
    rows, used = slope.shape
    apart = len(spectra.real) - rows
    root = np.empty(used, np.float32)
    real, imaginary = np.empty((2, used), np.float32)
    for k in range(used):
        root[k] = math.sqrt(weight[k])
        real[k] = root[k] * math.cos(step * k * displacement)
        imaginary[k] = root[k] * math.sin(step * k * displacement)
    half = np.float32(0.5 * step)
    for row in range(rows):
        a, b = spectra.real[row + apart], spectra.imaginary[row + apart]
        c, d = spectra.real[row], spectra.imaginary[row]
        for k in range(used):
            new_real, new_imaginary = root[k] * a[k], root[k] * b[k]
            old_real = c[k] * real[k] - d[k] * imaginary[k]
            old_imaginary = c[k] * imaginary[k] + d[k] * real[k]
            frequency = half * np.float32(k)
            slope[row, k] = complex(
                frequency * (new_imaginary + old_imaginary), -frequency * (new_real + old_real)
            )
            rest[row, k] = complex(old_real - new_real, old_imaginary - new_imaginary)


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
def _by_place(
    slope: Filtered, rest: Filtered, displacement: float, pixels: int
) -> tuple[Values, Values]:
    """Sum contributions of pairs to a displacement, and their information, by position.

    Args:
        slope: gradient of the mean of the two lines of each pair, shape (m, l).
        rest: difference of the two lines, shape (m, l).
        displacement: of the ground from line to line [px].
        pixels: n of a line.
    """
    rows, place = len(slope), pixels / _PLACES
    count = int(_PLACES + abs(displacement) * rows / place) + 2
    added, information = np.zeros((2, count))
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
            information[at] += square
            at, k = at + 1, max(end, k)
    return added, information
