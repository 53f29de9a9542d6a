"""Full search by Pearson's correlation, Eq. (81) of the dissertation, over the true overlap.

One cross-correlation by FFT gives the products for all shifts at once. The means and standard
deviations of the overlapping parts are computed from running sums. The sums of a line are used for
both line pairs that contain the line. This first step, in single precision, only selects
candidates: the shifts whose correlation could be the largest, given a bound on the rounding error.
In a second step, the correlations of the candidates are computed with integers. The result
therefore equals that of a direct evaluation, for 8-bit and 16-bit lines. It does not depend on the
rounding of the FFT or on the grouping of lines into batches.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.matching.direct import correlation, running_sums
from linescan_odometry.matching.transforms import transform_size
from omni_core.kernels import declares, kernel
from omni_core.signals import Lines

Floats = NDArray[np.float32]

# Bound of the error of a single-precision FFT correlation, relative to |x| |y|. Measured errors
# stay below 4e-7 up to 16384 px. The bound only has to be large enough; its value does not change
# the result.
_ROUNDING = 4e-6
_CHUNK = 64  # pairs that are transformed together: their spectra fit the second-level cache
_UNDEFINED = np.float32(-8.0)  # below every correlation, for parts with equal pixels

# These flags permit summation in any order. A kernel compiled with them must not be cached if
# another kernel calls it (see `subpixel`), so only the kernel that Python calls is cached.
_REORDER = {"reassoc", "contract", "nsz", "nnan"}


class _Ends(NamedTuple):
    """Sums over the first and the last N = n - s pixels of each line, for each shift s.

    Index 0 of the second axis is for the first pixels, index 1 for the last pixels.

    Attributes:
        sums: sums of the centered pixels, shape (lines, 2, shifts).
        scales: ``1 / sqrt(N sum x^2 - (sum x)^2)``, 0 if all pixels are equal, shape as `sums`.
        norm: Euclidean norm of the whole line, shape (lines,).
    """

    sums: Floats
    scales: Floats
    norm: Floats


class PearsonSearch:
    """Full search by Pearson's correlation."""

    def __init__(self, limit: int) -> None:
        """Create a search over shifts within +/- `limit` [px]."""
        self._limit = limit

    def reset(self) -> None:
        """Do nothing, since every pair is searched independently."""

    def match(
        self, lines: Lines, shift: NDArray[np.int64], similarity: NDArray[np.float64]
    ) -> None:
        """Find the shift of each line; implements `search.ShiftSearch.match`."""
        length = int(transform_size(lines.shape[1] + self._limit))
        for first in range(0, len(lines) - 1, _CHUNK):
            last = min(first + _CHUNK, len(lines) - 1)
            own = lines[first : last + 1]
            _match(own, self._limit, length, shift[first:last], similarity[first:last])


@kernel
def _match(
    lines: Lines, limit: int, length: int, shift: NDArray[np.int64], similarity: NDArray[np.float64]
) -> None:
    """Find the shift of each of these lines from the previous one.

    Args:
        lines: m + 1 lines, oldest first, shape (m + 1, n).
        limit: limit on the shift [px].
        length: length of the Fourier transform [px].
        shift: output, best shift of each pair [px], shape (m,).
        similarity: output, correlation at this shift [1], shape (m,).
    """
    sums = running_sums(lines)
    padded, shape = np.zeros((len(lines), length), np.float32), (len(lines), 2, limit + 1)
    ends = _Ends(
        np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(len(lines), np.float32)
    )
    _prepare(lines, sums, padded, ends)
    spectrum = np.fft.rfft(padded, length, 1)
    _cross_spectra(spectrum)
    product = np.fft.irfft(spectrum[:-1], length, 1)
    upper = np.empty((2, limit + 1), np.float32)
    for pair in range(len(shift)):
        reach = _bound(product[pair], ends, pair, lines.shape[1], upper)
        best, shift[pair] = -1.0, 0
        for s in range(limit + 1):  # smaller shifts first, because they win a tie
            for side in range(2 if s > 0 else 1):
                if upper[side, s] >= reach:
                    r = correlation(lines, sums, pair, -s if side else s)
                    if r > best:
                        best, shift[pair] = r, -s if side else s
        similarity[pair] = best


@declares(cache=False, fastmath=_REORDER)
def _prepare(lines: Lines, sums: NDArray[np.int64], padded: Floats, ends: _Ends) -> None:
    """Write each line minus its mean to `padded`, and sums over both ends of the line to `ends`.

    Args:
        lines: gray levels, shape (lines, n).
        sums: result of `running_sums`.
        padded: output, centered lines followed by zeros, shape (lines, length).
        ends: output, sums over the first and the last pixels.
    """
    pixels = lines.shape[1]
    for row in range(len(lines)):
        line, total, squares = lines[row], sums[0, row], sums[1, row]
        mean = total[pixels] // pixels
        for i in range(pixels):
            padded[row, i] = np.float32(np.int64(line[i]) - mean)
        whole = squares[pixels] - mean * (2 * total[pixels] - mean * pixels)
        ends.norm[row] = math.sqrt(whole)
        for side in range(2):
            into, scale = ends.sums[row, side], ends.scales[row, side]
            for s in range(len(into)):
                count, first = pixels - s, s if side else 0
                part = total[first + count] - total[first]
                # Integers of at most 2^60 for 16384 px of 16 bits, so zero is exactly zero.
                variance = np.float32(
                    count * (squares[first + count] - squares[first]) - part * part
                )
                root = np.float32(1.0) / np.sqrt(max(variance, np.float32(1.0)))
                into[s] = np.float32(part - mean * count)
                scale[s] = root if variance > np.float32(0.0) else np.float32(0.0)


@declares(cache=False, fastmath=_REORDER)
def _cross_spectra(spectra: NDArray[np.complexfloating[Any, Any]]) -> None:
    """Multiply the spectrum of each line by the conjugate spectrum of the next line, in place.

    The spectrum of the last line does not change.

    Args:
        spectra: spectra of the lines, oldest first, shape (lines, bins).
    """
    rows, bins = spectra.shape
    for row in range(rows - 1):
        old, new = spectra[row], spectra[row + 1]
        for k in range(bins):
            a, b = old[k], new[k]
            old[k] = complex(a.real * b.real + a.imag * b.imag, a.imag * b.real - a.real * b.imag)


@declares(cache=False, fastmath=_REORDER)
def _bound(product: Floats, ends: _Ends, pair: int, pixels: int, upper: Floats) -> np.float32:
    """Write upper bounds on a pair's correlation at all shifts; return the largest lower bound.

    The bounds account for rounding errors. The largest correlation is at a shift whose upper bound
    is at least the returned lower bound.

    Args:
        product: sum of the products of both lines at each shift, with the negative shifts at the
            end, shape (length,).
        ends: sums over the overlapping parts of the lines.
        pair: number of the pair.
        pixels: number of pixels n of a line.
        upper: output, upper bounds of the correlation at the shifts s and -s, shape (2, shifts).
    """
    slack = np.float32(_ROUNDING) * ends.norm[pair] * ends.norm[pair + 1]
    reach = _UNDEFINED
    own = np.empty(upper.shape[1], np.float32)
    for side in range(2):
        for s in range(len(own)):
            own[s] = product[np.uint64(len(product) - s if side and s else s)]
        new_sum, new_scale = ends.sums[pair + 1, side], ends.scales[pair + 1, side]
        old_sum, old_scale = ends.sums[pair, 1 - side], ends.scales[pair, 1 - side]
        bound = upper[side]
        for s in range(len(own)):
            count, scale = np.float32(pixels - s), new_scale[s] * old_scale[s]
            r = (count * own[s] - new_sum[s] * old_sum[s]) * scale  # Eq. (81)
            r = r if scale > np.float32(0.0) else _UNDEFINED
            own[s] = r - slack * count * scale
            bound[s] = r + slack * count * scale
        for s in range(len(own)):
            reach = max(reach, own[s])
    return reach
