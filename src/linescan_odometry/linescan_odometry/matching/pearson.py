"""Full search by Pearson's correlation (81) over the true overlap at each shift.

One cross-correlation by FFT gives the products of all shifts at once. The means and standard
deviations of the overlapping parts come from running sums, which each line shares between its two
pairs. This step in single precision only proposes candidates: every shift whose correlation could
be the largest, within a bound of the rounding error, is then evaluated in integers. So the result
equals that of a direct evaluation, for 8-bit and 16-bit lines, and does not depend on the rounding
of the FFT or on the grouping of lines into batches.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy  # loads scipy.fft at its first use, so not in processes that only read configurations
from numpy.typing import NDArray

from linescan_odometry.matching.transforms import load_transforms
from linescan_odometry.measurements import Lines
from omni_platform.kernels import kernel, njit

# Bound of the error of a single-precision FFT correlation, relative to |x| |y|. Measured errors
# stay below 4e-7 up to 16384 px; what matters is only that the bound is never exceeded.
_ROUNDING = 4e-6
# Pixels and pairs per FFT batch: enough that the cost of a call does not matter, few enough that
# the working set stays in the second-level cache.
_CHUNK_PIXELS = 1 << 16
_CHUNK = 256
_MAGNITUDE = np.int32(0x7FFFFFFF)
_BLOCK = 64  # shifts whose bounds are checked together
_NARROW = 1 << 15  # pixels of 8 bits whose sums of squares fit 32 bits

# These flags permit sums in any order. A kernel with them must not be cached if another kernel
# calls it (see `subpixel`), so only the kernel that Python calls is cached.
_REORDER = {"reassoc", "contract", "nsz", "nnan"}


class _Ends(NamedTuple):
    """The first and the last n - s pixels of each line, for every shift s.

    Index 0 of the second axis stands for the first pixels, 1 for the last ones.

    Attributes:
        sums: sums of the centered pixels, shape (lines, 2, shifts).
        scales: ``1 / sqrt(N sum x^2 - (sum x)^2)``, 0 if all pixels are equal, shape as `sums`.
        norm: root of the sum of squares of the whole line, shape (lines,).
    """

    sums: NDArray[np.float32]
    scales: NDArray[np.float32]
    norm: NDArray[np.float32]


class _Part(NamedTuple):
    """One end of one line, see `_Ends`; each of shape (shifts,)."""

    sums: NDArray[np.float32]
    scales: NDArray[np.float32]


class PearsonSearch:
    """Full search by Pearson's correlation, with working memory for one sensor."""

    def __init__(self, pixels: int, limit: int) -> None:
        """Prepare for lines of `pixels` and shifts within +/- `limit` [px]."""
        load_transforms()
        self._chunk = min(_CHUNK, max(1, _CHUNK_PIXELS // pixels))
        rows = self._chunk + 1
        length = int(scipy.fft.next_fast_len(pixels + limit, real=True))
        self._padded = np.zeros((rows, length), np.float32)
        shape = rows, 2, limit + 1
        self._ends = _Ends(
            np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(rows, np.float32)
        )
        self._upper = np.empty((2, limit + 1), np.float32)

    def reset(self) -> None:
        """Do nothing: every pair is searched independently."""

    def match(
        self,
        lines: Lines,
        shift: NDArray[np.int64],
        similarity: NDArray[np.float64],
    ) -> None:
        """Compare every line with the one before it; see `search.ShiftSearch`."""
        for first in range(0, len(lines) - 1, self._chunk):
            last = min(first + self._chunk, len(lines) - 1)
            _match(
                lines[first : last + 1], self._padded, self._ends, self._upper,
                shift[first:last], similarity[first:last],
            )  # fmt: skip


@kernel
def _match(
    lines: Lines,
    padded: NDArray[np.float32],
    ends: _Ends,
    upper: NDArray[np.float32],
    shift: NDArray[np.int64],
    similarity: NDArray[np.float64],
) -> None:
    """Compare some lines, each with the one before it; see `search.ShiftSearch`."""
    _prepare(lines, padded, ends)
    spectrum = scipy.fft.rfft(padded[: len(lines)], padded.shape[1], 1)
    _cross_spectra(spectrum)
    product = scipy.fft.irfft(spectrum[:-1], padded.shape[1], 1)
    _decide(lines, product, ends, upper, shift, similarity)


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
def _prepare(lines: Lines, padded: NDArray[np.float32], ends: _Ends) -> None:
    """Center each line; sum and scale its first and last n - s pixels for every s."""
    sums, scales, norm = ends
    rows, pixels = lines.shape
    shifts = sums.shape[2]
    running = np.empty((2, shifts), np.int64)
    for row in range(rows):
        line = lines[row]
        total = np.int64(0)
        for i in range(pixels):
            total += np.int64(line[i])
        mean = total // pixels
        squares = np.int64(0)
        for i in range(pixels):
            value = np.int64(line[i]) - mean
            squares += value * value
            padded[row, i] = np.float32(value)
        total -= mean * pixels
        norm[row] = math.sqrt(squares)
        for side in range(2):
            part, part_squares = total, squares
            parts, parts_squares = running[0], running[1]
            for s in range(shifts):
                parts[s] = part
                parts_squares[s] = part_squares
                # Unsigned indices spare the checks for negative ones.
                value = np.int64(line[np.uint64(pixels - 1 - s if side == 0 else s)]) - mean
                part -= value
                part_squares -= value * value
            into, scale = sums[row, side], scales[row, side]
            for s in range(shifts):
                into[s] = np.float32(parts[s])
                # Whole numbers, at most 2^60 for 16384 px of 16 bit: zero is exactly zero.
                variance = np.float32((pixels - s) * parts_squares[s] - parts[s] * parts[s])
                root = np.float32(1.0) / np.sqrt(max(variance, np.float32(1.0)))
                scale[s] = root if variance > np.float32(0.0) else np.float32(0.0)


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
def _cross_spectra(spectra: NDArray[np.complex64]) -> None:
    """Multiply each line's spectrum in place by the conjugate of the next newer line's."""
    rows, bins = spectra.shape
    for row in range(rows - 1):
        old, new = spectra[row], spectra[row + 1]
        for k in range(bins):
            a, b = old[k], new[k]
            old[k] = complex(a.real * b.real + a.imag * b.imag, a.imag * b.real - a.real * b.imag)


@njit(nogil=True, error_model="numpy", fastmath=_REORDER)
def _bound(
    product: NDArray[np.float32],
    new: _Part,
    old: _Part,
    pixels: int,
    slack: np.float32,
    upper: NDArray[np.float32],
    lower: NDArray[np.float32],
) -> float:
    """Write upper and lower bounds of the correlation by |shift|; return the largest lower one."""
    new_sum, new_scale = new
    old_sum, old_scale = old
    for s in range(upper.shape[0]):
        count = np.float32(pixels - s)
        scale = new_scale[s] * old_scale[s]
        r = (count * product[s] - new_sum[s] * old_sum[s]) * scale  # Eq. (81)
        bound = slack * count * scale
        penalty = np.float32(0.0) if scale > np.float32(0.0) else np.float32(8.0)
        upper[s] = r + bound - penalty
        lower[s] = r - bound - penalty
    # Compilers vectorize the maximum of integers, but not that of floating-point numbers. Read as
    # integers, the bits of these have the same order, reversed for negative numbers.
    bits = lower.view(np.int32)
    best = np.int32(-0x7FFFFFFF)
    for s in range(bits.shape[0]):
        ordered = np.int32(bits[s] ^ (np.int32(bits[s] >> 31) & _MAGNITUDE))
        best = ordered if ordered > best else best
    bits[0] = np.int32(best ^ (np.int32(best >> 31) & _MAGNITUDE))
    largest: float = lower[0]
    return largest


@njit(nogil=True, inline="always")
def _narrow_sums(x: Lines, y: Lines) -> tuple[np.int64, np.int64, np.int64, np.int64, np.int64]:
    """Return sum x, sum y, sum x^2, sum y^2 and sum x y, computed with 32 bits."""
    s_x = np.int32(0)
    s_y = np.int32(0)
    s_xx = np.int32(0)
    s_yy = np.int32(0)
    s_xy = np.int32(0)
    for i in range(x.shape[0]):
        a = np.int32(x[i])
        b = np.int32(y[i])
        s_x = np.int32(s_x + a)
        s_y = np.int32(s_y + b)
        s_xx = np.int32(s_xx + np.int32(a * a))
        s_yy = np.int32(s_yy + np.int32(b * b))
        s_xy = np.int32(s_xy + np.int32(a * b))
    return np.int64(s_x), np.int64(s_y), np.int64(s_xx), np.int64(s_yy), np.int64(s_xy)


@njit(nogil=True, error_model="numpy")
def _exact(x: Lines, y: Lines) -> float:
    """Return the correlation (81) of two equally long parts, -2 where it is undefined."""
    count = x.shape[0]
    s_x = np.int64(0)
    s_y = np.int64(0)
    s_xx = np.int64(0)
    s_yy = np.int64(0)
    s_xy = np.int64(0)
    if x.itemsize == 1 and count <= _NARROW:
        s_x, s_y, s_xx, s_yy, s_xy = _narrow_sums(x, y)
    else:
        for i in range(count):
            a = np.int64(x[i])
            b = np.int64(y[i])
            s_x += a
            s_y += b
            s_xx += a * a
            s_yy += b * b
            s_xy += a * b
    v_x = count * s_xx - s_x * s_x
    v_y = count * s_yy - s_y * s_y
    if v_x <= 0 or v_y <= 0:
        return -2.0
    r: float = (count * s_xy - s_x * s_y) / math.sqrt(np.float64(v_x) * np.float64(v_y))
    return r


@njit(nogil=True, inline="always")
def _any_within(upper: NDArray[np.float32], reach: np.float32) -> bool:
    """Return whether any of two rows of bounds is large enough; counting is vectorized."""
    count = np.int32(0)
    ahead, behind = upper[0], upper[1]
    for s in range(len(ahead)):
        count = np.int32(count + np.int32(ahead[s] >= reach) + np.int32(behind[s] >= reach))
    return bool(count > 0)


@njit(nogil=True, error_model="numpy")
def _decide(
    lines: Lines,
    product: NDArray[np.float32],
    ends: _Ends,
    upper: NDArray[np.float32],
    shift: NDArray[np.int64],
    similarity: NDArray[np.float64],
) -> None:
    """Find the best shift of each pair: bounds for all shifts, then exact values for candidates."""
    sums, scales, norm = ends
    pixels = lines.shape[1]
    length = product.shape[1]
    shifts = upper.shape[1]
    reverse = np.empty(shifts, np.float32)
    lower = np.empty(shifts, np.float32)
    for pair in range(shift.shape[0]):
        old, new = pair, pair + 1
        slack = np.float32(_ROUNDING) * norm[old] * norm[new]
        correlation = product[pair]
        reverse[0] = correlation[0]
        for s in range(1, shifts):
            reverse[s] = correlation[np.uint64(length - s)]
        ahead = _bound(
            correlation[:shifts], _Part(sums[new, 0], scales[new, 0]),
            _Part(sums[old, 1], scales[old, 1]), pixels, slack, upper[0], lower,
        )  # fmt: skip
        behind = _bound(
            reverse, _Part(sums[new, 1], scales[new, 1]),
            _Part(sums[old, 0], scales[old, 0]), pixels, slack, upper[1], lower,
        )  # fmt: skip
        reach = max(ahead, behind)
        best, best_shift = -2.0, 0
        if reach > np.float32(-4.0):
            for first in range(0, shifts, _BLOCK):
                behind_block = min(first + _BLOCK, shifts)
                if not _any_within(upper[:, first:behind_block], reach):
                    continue
                for s in range(first, behind_block):  # smaller ones first, which win a tie
                    if upper[0, s] >= reach:
                        r = _exact(lines[new, : pixels - s], lines[old, s:])
                        if r > best:
                            best, best_shift = r, s
                    if s > 0 and upper[1, s] >= reach:
                        r = _exact(lines[new, s:], lines[old, : pixels - s])
                        if r > best:
                            best, best_shift = r, -s
        shift[pair] = best_shift
        similarity[pair] = max(best, -1.0)
