"""Sub-pixel refinement of a shift by Gauss-Newton steps on smoothed lines, with its variance.

Around the integer shift s the two lines are resampled by one FIR filter each that smooths with a
Gaussian, shifts by half of the fraction f (the older line forwards, the newer one backwards) and,
in its second form, differentiates. Both lines thus pass through the same filter, which avoids a
bias towards whole pixels. Means and contrasts are equalized, so that a change of brightness has no
effect. With ``e_i = old(i + s + f/2) - new(i - f/2)``, the filtered derivatives p of the new and q
of the old line and ``g = (p + q) / 2 = de/df``, a step is

    f <- f - sum(e g) / sum(p q).

The noise of the two lines is independent, so ``sum(p q)`` is the gradient energy of the texture
alone, whereas ``sum(g^2)`` would count noise as texture. The variance is that of the last step.
For white noise e it would be the Cramer-Rao bound times the loss by smoothing. But e is correlated
along the line, by the filter and, in sideways motion, by texture that enters and leaves.
Hence e g is summed over blocks longer than this correlation:
``var f = sum_blocks(sum e g)^2 / sum(p q)^2``.

The width of the Gaussian is a compromise. A wide one loses the information of fine texture; a
narrow one is undersampled, which biases displacements towards whole pixels: by 0.006 px at a sigma
of 0.7 px, by less than 0.001 px at 0.8 px.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.matching.mean_variance import Overlaps, mean_variance
from linescan_odometry.matching.smoothed_peak import smoothed_peak
from linescan_odometry.measurements import Lines
from omni_platform.kernels import kernel, njit

FEWEST_PIXELS = 32
"""Smallest overlap of two lines that can be refined [px]."""

_RADIUS = 4  # [px] of the FIR filter: 4.1 sigma at the largest shift
_TAPS = 2 * _RADIUS + 1
_STEPS = 2
_FEWEST_TERMS = 16  # smallest overlap [px]
_FEWEST_BLOCKS = 16  # in a long overlap; rounding their length down makes no more than 32
_GROUND_BLOCKS = 32  # blocks of ground in a line
_FARTHEST = 1.0  # largest distance from the integer shift [px]; beyond, that was no peak

# The sums below may be reordered for speed. A kernel that permits this must not be cached if
# another kernel calls it: the code inlined into the caller may be rounded differently before and
# after the compiled code has been read from the cache, and runs would not repeat to the last bit.
# So only its callers are cached.
_REORDER = {"reassoc", "contract", "nsz"}


class _Layout(NamedTuple):
    """Division of the overlaps of m pairs at the blocks of the ground, each of shape (m,).

    Attributes:
        length: length of each overlap [px].
        block: length of its blocks [px].
        number: number of its first block of ground.
        lead: visible length of the first block [px].
        parts: how many blocks the overlap has.
    """

    length: NDArray[np.int64]
    block: NDArray[np.int64]
    number: NDArray[np.int64]
    lead: NDArray[np.int64]
    parts: NDArray[np.int64]


def kernel_sigma(pixels: int) -> float:
    """Return the standard deviation of the smoothing kernel [px] for lines of n pixels."""
    return 0.85 if pixels > 335 else 0.8


class SubpixelRefiner:
    """Refines the integer shifts of consecutive lines, with working memory."""

    def __init__(self, pixels: int, recovery: int = 0) -> None:
        """Prepare for one sensor.

        Args:
            pixels: n of a line.
            recovery: distance from the integer shift within which the peak is searched again on
                smoothed lines if the refinement leaves it [px]; 0 for no search.
        """
        self._pixels = pixels
        self._recovery = recovery
        self._sigma = kernel_sigma(pixels)
        self._ground_block = max(4, pixels // _GROUND_BLOCKS)
        self._shift = np.empty(0, np.int64)  # shifts of the last pairs, with recovered peaks
        self._make_room(0)

    def refine(
        self,
        lines: Lines,
        shift: NDArray[np.int64],
        displacement: NDArray[np.float64],
        variance: NDArray[np.float64],
    ) -> None:
        """Refine the shift of every line against the one before it.

        Args:
            lines: m + 1 lines of n pixels, oldest first, shape (m + 1, n).
            shift: integer shifts [px], shape (m,).
            displacement: receives shift plus fraction [px], shape (m,).
            variance: receives the variance of the displacement [px^2], shape (m,); infinite
                if the lines have no gradient or the refinement left the peak by a pixel.
        """
        pairs = len(shift)
        if len(self._filters) < pairs:
            self._make_room(pairs)
        self._shift = shift.copy()
        _center(lines, self._centered)
        lost = _refine(
            self._centered, self._shift, self._sigma, self._filters, self._sums, displacement,
            variance,
        )  # fmt: skip
        if self._recovery == 0 or lost == 0:
            return
        for pair in np.flatnonzero(np.isinf(variance)).tolist():
            old, new = lines[pair], lines[pair + 1]
            peak = smoothed_peak(old, new, int(shift[pair]), self._recovery)
            if peak != shift[pair]:
                self._shift[pair] = peak
                one = slice(pair, pair + 1)
                _refine(
                    self._centered[pair : pair + 2], self._shift[one], self._sigma,
                    self._filters[one], self._sums[one], displacement[one], variance[one],
                )  # fmt: skip

    def mean_variance(
        self, displacement: NDArray[np.float64], weight: NDArray[np.float64]
    ) -> float:
        """Return the variance of a weighted mean of the displacements refined last [px^2].

        Args:
            displacement: displacement of each pair as refined [px], shape (m,).
            weight: weight of each pair in the mean, zero for excluded ones, sum 1, shape (m,).
        """
        square: float = _weigh(
            self._centered, self._shift, self._filters, self._sums, self._ground_block,
            displacement, weight,
        )  # fmt: skip
        return square

    def _make_room(self, pairs: int) -> None:
        self._centered = np.empty((pairs + 1, self._pixels), np.float32)
        self._filters = np.empty((pairs, 4, _TAPS), np.float32)
        parts = max(self._pixels // self._ground_block, 2 * _FEWEST_BLOCKS)
        self._sums = np.empty((pairs, parts + 2, 4))


@njit(cache=True, error_model="numpy")
def _center(lines: Lines, centered: NDArray[np.float32]) -> None:
    """Copy lines minus their means; the means are rounded down."""
    for row in range(lines.shape[0]):
        line = lines[row]
        out = centered[row]
        total = np.int64(0)
        for i in range(line.shape[0]):
            total += np.int64(line[i])
        mean = np.int32(total // line.shape[0])
        for i in range(line.shape[0]):
            out[i] = np.float32(np.int32(line[i]) - mean)


@kernel
def _refine(
    centered: NDArray[np.float32],
    shift: NDArray[np.int64],
    sigma: float,
    filters: NDArray[np.float32],
    sums: NDArray[np.float64],
    displacement: NDArray[np.float64],
    variance: NDArray[np.float64],
) -> int:
    """Do all steps for every pair; return how many pairs left their peak.

    Args:
        centered: lines, shape (m + 1, n) or more.
        shift: integer shifts [px], shape (m,).
        sigma: standard deviation of the smoothing [px].
        filters: receives the filters of the last step, shape (m, 4, taps) or more.
        sums: working memory, see `Overlaps`.
        displacement: receives the shifts with their fractions [px], shape (m,).
        variance: receives the variances of the displacements [px^2], shape (m,).
    """
    pixels, pairs = centered.shape[1], len(shift)
    length, block = np.empty(pairs, np.int64), np.empty(pairs, np.int64)
    contrast = np.empty((pairs, 2))
    for pair in range(pairs):
        s = shift[pair]
        displacement[pair] = s
        overlap = pixels - abs(s)
        length[pair] = overlap - 2 * _RADIUS
        x, y = max(0, -s), max(0, s)
        contrast[pair, 0] = _contrast(centered[pair + 1, x : x + overlap])
        contrast[pair, 1] = _contrast(centered[pair, y : y + overlap])
    for step in range(_STEPS):
        final = step == _STEPS - 1  # only the variance needs the blocks
        for pair in range(pairs):
            block[pair] = _block_length(length[pair]) if final else length[pair]
        _make_filters(contrast, shift, displacement, sigma, filters)
        _filter_and_sum(centered, shift, filters, block, block, sums)
        _step(length, block, shift, sums, final, displacement, variance)
    lost = 0
    for pair in range(pairs):
        lost += variance[pair] == math.inf
    return lost


@njit(cache=True, error_model="numpy")
def _block_length(length: int) -> int:
    """Return the length of a block [px], for long ones a multiple of the processor's vectors."""
    block = max(4, length // _FEWEST_BLOCKS)
    return block - block % 16 if block > 16 else block


@njit(cache=True, error_model="numpy")
def _weigh(
    centered: NDArray[np.float32],
    shift: NDArray[np.int64],
    filters: NDArray[np.float32],
    sums: NDArray[np.float64],
    ground_block: int,
    displacement: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> float:
    """Return the variance of a weighted mean [px^2]."""
    pairs = len(weight)
    cut = _Layout(
        np.empty(pairs, np.int64), np.full(pairs, ground_block), np.empty(pairs, np.int64),
        np.empty(pairs, np.int64), np.empty(pairs, np.int64),
    )  # fmt: skip
    _lay_out(centered.shape[1], shift, displacement, weight, cut)
    _filter_and_sum(centered, shift, filters, cut.lead, cut.block, sums)
    overlaps = Overlaps(sums, cut.length, cut.parts, cut.number)
    variance: float = mean_variance(overlaps, weight)
    return variance


@njit(cache=True, error_model="numpy")
def _lay_out(
    pixels: int,
    shift: NDArray[np.int64],
    displacement: NDArray[np.float64],
    weight: NDArray[np.float64],
    cut: _Layout,
) -> None:
    """Divide each overlap at the blocks of the ground, relative to the first line.

    Args:
        pixels: n of a line.
        shift: integer shifts of m pairs [px], shape (m,).
        displacement: refined displacements [px], shape (m,).
        weight: weight of each pair in the mean, shape (m,); pairs with zero weight move by the
            mean.
        cut: receives everything except the length of the blocks.
    """
    length, block, number, lead, parts = cut
    mean = 0.0
    for pair in range(len(shift)):
        mean += weight[pair] * displacement[pair]
    path = 0.0
    for pair in range(len(shift)):
        path += displacement[pair] if weight[pair] != 0.0 else mean
        ground = math.floor(path + 0.5) + max(0, -shift[pair])
        length[pair] = pixels - abs(shift[pair]) - 2 * _RADIUS
        number[pair] = ground // block[pair]
        lead[pair] = (number[pair] + 1) * block[pair] - ground
        parts[pair] = 1 + max(0, length[pair] - lead[pair] + block[pair] - 1) // block[pair]


@njit(cache=True, error_model="numpy")
def _contrast(part: NDArray[np.float32]) -> float:
    """Return 1 over the standard deviation of part of a line, 0 for a constant one.

    The gray levels are integers, so the sums are exact in any order.
    """
    total = np.int64(0)
    squares = np.int64(0)
    for i in range(part.shape[0]):
        value = np.int64(part[i])
        total += value
        squares += value * value
    variance = np.float64(part.shape[0] * squares - total * total)
    return part.shape[0] / math.sqrt(variance) if variance > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def _make_filters(
    contrast: NDArray[np.float64],
    shift: NDArray[np.int64],
    displacement: NDArray[np.float64],
    sigma: float,
    filters: NDArray[np.float32],
) -> None:
    """Write the filters of each pair: smoothing and slope of the new line, then of the old one.

    They include the equalization of contrast; `filters[pair, 0]` has the sign of its term in e.
    """
    for pair in range(shift.shape[0]):
        half = 0.5 * (displacement[pair] - shift[pair])
        for side in range(2):
            offset = half if side else -half
            norm = contrast[pair, side] / (sigma * math.sqrt(2.0 * math.pi))
            for k in range(_TAPS):
                u = (k - _RADIUS - offset) / sigma
                weight = norm * math.exp(-0.5 * u * u)
                filters[pair, 2 * side, k] = weight if side else -weight
                filters[pair, 2 * side + 1, k] = weight * u / sigma


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
def _filter_and_sum(
    centered: NDArray[np.float32],
    shift: NDArray[np.int64],
    filters: NDArray[np.float32],
    lead: NDArray[np.int64],
    block: NDArray[np.int64],
    sums: NDArray[np.float64],
) -> None:
    """Sum e, p + q, e (p + q) and p q over parts of each overlap.

    The first part has the length `lead`, the others `block`, the last one the rest [px].
    """
    pixels = centered.shape[1]
    for pair in range(shift.shape[0]):
        s = shift[pair]
        count = pixels - abs(s) - 2 * _RADIUS
        first = 0
        end = min(lead[pair], count)
        part = 0
        u0, u1, u2, u3, u4, u5, u6, u7, u8 = filters[pair, 0]
        v0, v1, v2, v3, v4, v5, v6, v7, v8 = filters[pair, 1]
        w0, w1, w2, w3, w4, w5, w6, w7, w8 = filters[pair, 2]
        z0, z1, z2, z3, z4, z5, z6, z7, z8 = filters[pair, 3]
        while first < count:
            n = end - first
            x = centered[pair + 1, max(0, -s) + first :]
            y = centered[pair, max(0, s) + first :]
            # Slices, because an index i + k would be checked for wrap-around at every access.
            x0, x1, x2, x3, x4 = x[0:n], x[1 : n + 1], x[2 : n + 2], x[3 : n + 3], x[4 : n + 4]
            x5, x6, x7, x8 = x[5 : n + 5], x[6 : n + 6], x[7 : n + 7], x[8 : n + 8]
            y0, y1, y2, y3, y4 = y[0:n], y[1 : n + 1], y[2 : n + 2], y[3 : n + 3], y[4 : n + 4]
            y5, y6, y7, y8 = y[5 : n + 5], y[6 : n + 6], y[7 : n + 7], y[8 : n + 8]
            s_e, s_g, s_eg, s_pq = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
            for i in range(n):
                e = (
                    u0 * x0[i] + u1 * x1[i] + u2 * x2[i] + u3 * x3[i] + u4 * x4[i]
                    + u5 * x5[i] + u6 * x6[i] + u7 * x7[i] + u8 * x8[i]
                    + w0 * y0[i] + w1 * y1[i] + w2 * y2[i] + w3 * y3[i] + w4 * y4[i]
                    + w5 * y5[i] + w6 * y6[i] + w7 * y7[i] + w8 * y8[i]
                )  # fmt: skip
                p = (
                    v0 * x0[i] + v1 * x1[i] + v2 * x2[i] + v3 * x3[i] + v4 * x4[i]
                    + v5 * x5[i] + v6 * x6[i] + v7 * x7[i] + v8 * x8[i]
                )  # fmt: skip
                q = (
                    z0 * y0[i] + z1 * y1[i] + z2 * y2[i] + z3 * y3[i] + z4 * y4[i]
                    + z5 * y5[i] + z6 * y6[i] + z7 * y7[i] + z8 * y8[i]
                )  # fmt: skip
                s_e += e
                s_g += p + q
                s_eg += e * (p + q)
                s_pq += p * q
            sums[pair, part, 0] = s_e
            sums[pair, part, 1] = s_g
            sums[pair, part, 2] = s_eg
            sums[pair, part, 3] = s_pq
            part += 1
            first = end
            end = min(end + block[pair], count)


@njit(cache=True, error_model="numpy")
def _step(
    length: NDArray[np.int64],
    block: NDArray[np.int64],
    shift: NDArray[np.int64],
    sums: NDArray[np.float64],
    final: bool,
    displacement: NDArray[np.float64],
    variance: NDArray[np.float64],
) -> None:
    """Do one Gauss-Newton step for each pair; the last one also gives the variance."""
    for pair in range(shift.shape[0]):
        count = length[pair]
        parts = -(-count // block[pair])
        e, eg, pq = 0.0, 0.0, 0.0
        for part in range(parts):
            e += sums[pair, part, 0]
            eg += 0.5 * sums[pair, part, 2]
            pq += sums[pair, part, 3]
        e /= count
        for part in range(parts):
            eg -= 0.5 * e * sums[pair, part, 1]
        displaced = displacement[pair]
        lost = final and variance[pair] == math.inf  # at the step before
        step = -eg / pq if pq > 0.0 and count >= _FEWEST_TERMS else math.inf
        if lost or abs(displaced + step - shift[pair]) > _FARTHEST:
            displacement[pair] = shift[pair]
            variance[pair] = math.inf
            continue
        displacement[pair] = displaced + step
        variance[pair] = 0.0
        if final:
            spread = 0.0
            for part in range(parts):
                rest = 0.5 * (sums[pair, part, 2] - e * sums[pair, part, 1])
                rest += step * sums[pair, part, 3]
                spread += rest * rest
            variance[pair] = spread / (pq * pq) * parts / (parts - 1.0)
