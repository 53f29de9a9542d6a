"""Search for the shift between lines by any distance measure, with an optional window and prior.

Equation and section numbers refer to the dissertation. For each shift, integer sums are computed
over the true overlap of the lines. A sum is divided by the number of common pixels, since otherwise
a sum over fewer pixels would be smaller:

| metric | distance at a shift with N common pixels |
|---|---|
| `euclidean` | ``sqrt(sum (x - y)^2) / N`` (79) |
| `squared_euclidean` | ``sum (x - y)^2 / N`` |
| `manhattan` | ``sum |x - y| / N`` (80) |
| `pearson` | ``1 - r`` (81) |
| `spearman` | ``1 - r`` of the ranks within the overlap, ties at their mean |
| `cosine` | ``1 - cos`` (83) |

The distance `euclidean` is the root mean square divided by ``sqrt(N)``. Unlike `squared_euclidean`,
it therefore prefers longer overlaps. The first three distances are *not* invariant to a change of
brightness, contrary to section 4.3.2. The cosine is not invariant at low contrast.

Two methods of section 4.6 use the last displacement. With a **window**, only shifts near the last
displacement are searched; if the best of these shifts is not credible, all shifts are searched. A
**prior** multiplies the distance at shift s by ``1 + weight |s - before| / limit``, which favors
small changes of velocity.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_core.kernels import kernel
from omni_core.quantities import FloatArray, IntArray
from omni_core.signals import Lines

_PEARSON, _COSINE, _EUCLIDEAN, _SQUARED_EUCLIDEAN, _MANHATTAN, _SPEARMAN = range(6)
_KINDS = {
    "pearson": _PEARSON,
    "cosine": _COSINE,
    "euclidean": _EUCLIDEAN,
    "squared_euclidean": _SQUARED_EUCLIDEAN,
    "manhattan": _MANHATTAN,
    "spearman": _SPEARMAN,
}

# Smallest correlation of a credible shift. If the window is around a wrong shift, it does not
# contain the right one, so its best shift is at the border or has a low correlation. This check
# detects nearly all such windows, and the median filter rejects displacements of the others.
_CREDIBLE = 0.5
_UNDEFINED = math.inf


class _Batch(NamedTuple):
    """Lines to compare, with tables for the distance measures.

    Attributes:
        kind: number of the distance measure.
        lines: gray levels, shape (m, n).
        codes: rank of each pixel's gray level among the levels that occur, shape (m, n).
        sums: sums of the first k pixels of each line and of their squares, from `running_sums`.
        ranks: working memory for each level that occurs, shape (2, levels).
    """

    kind: int
    lines: Lines
    codes: Lines
    sums: IntArray
    ranks: IntArray


class _Range(NamedTuple):
    """Range of shifts to search, with a prior that favors shifts near the last displacement.

    Attributes:
        low: the smallest shift [px].
        high: the largest shift [px].
        prior: last displacement [px].
        pull: relative increase of the distance per pixel between a shift and the last displacement
            [1/px].
    """

    low: int
    high: int
    prior: int
    pull: float


class DirectSearch:
    """Finds the shift of one line pair after another, with optional use of the last shift."""

    def __init__(self, metric: str, limit: int, window: int = 0, prior_weight: float = 0.0) -> None:
        """Create the search for the lines of one camera.

        Args:
            metric: distance measure of the search, one of `search.METRICS`.
            limit: limit on the shift [px].
            window: half width of the search range around the last displacement [px]; 0 to search
                all shifts always.
            prior_weight: relative increase of the distance at a shift that differs from the last
                displacement by `limit` [1].
        """
        self._kind = _KINDS[metric]
        self._limit = limit
        self._window = window
        self._prior_weight = prior_weight
        self._before = np.zeros(2, np.int64)  # last shift [px]; 1 if there is one, else 0

    def reset(self) -> None:
        """Discard the last displacement; the next line starts a new sequence."""
        self._before[:] = 0

    def match(self, lines: Lines, shift: IntArray, similarity: FloatArray) -> None:
        """Find the shift of each line; implements `search.ShiftSearch.match`."""
        codes, levels = lines, 0
        if self._kind == _SPEARMAN:
            codes, levels = _order(lines)
        batch = _Batch(
            self._kind, lines, codes, running_sums(lines), np.empty((2, levels), np.int64)
        )
        whole = _Range(-self._limit, self._limit, 0, self._prior_weight / self._limit)
        _match(batch, whole, self._window, self._before, shift, similarity)


def _order(lines: Lines) -> tuple[Lines, int]:
    """Return the rank of each pixel's gray level, shape (m, n), and the number of levels.

    The ranks count only levels that occur. 8-bit lines are returned unchanged, with 256 levels.
    """
    if lines.dtype == np.uint8:
        return lines, 256
    values, places = np.unique(lines, return_inverse=True)
    return places.reshape(lines.shape).astype(np.uint32), len(values)  # type: ignore[return-value]


@kernel
def running_sums(lines: Lines) -> IntArray:
    """Return sums over the first k = 0 to n pixels of each line, shape (2, m, n + 1).

    Entry 0 of the first axis is for the gray levels, entry 1 for their squares.
    """
    rows, pixels = lines.shape
    sums = np.zeros((2, rows, pixels + 1), np.int64)
    for row in range(rows):
        total, squares = np.int64(0), np.int64(0)
        for i in range(pixels):
            value = np.int64(lines[row, i])
            total += value
            squares += value * value
            sums[0, row, i + 1], sums[1, row, i + 1] = total, squares
    return sums


@kernel
def _match(
    batch: _Batch,
    whole: _Range,
    window: int,
    before: IntArray,
    shift: IntArray,
    similarity: FloatArray,
) -> None:
    """Match all line pairs of a batch, and write their shifts and correlations.

    Args:
        batch: lines and their sums.
        whole: range of shifts to search, and pull toward the previous shift.
        window: largest change of the shift for which the whole range is not searched [px]; 0 to
            search the whole range always.
        before: shift of the previous pair [px], and 1 if it was credible, else 0; changed in place.
        shift: output, shift of each pair [px], shape (m,).
        similarity: output, correlation of each pair [1], shape (m,).
    """
    lines, sums, low, high = batch.lines, batch.sums, whole.low, whole.high
    for pair in range(shift.shape[0]):
        prior = before[0]
        pull = whole.pull if before[1] else 0.0
        found, r = 0, -1.0
        searched = False
        if window > 0 and before[1]:
            near = _Range(max(low, prior - window), min(high, prior + window), prior, pull)
            found = _best(batch, pair, near)
            r = correlation(lines, sums, pair, found)
            inside = (found > near.low or near.low == low) and (
                found < near.high or near.high == high
            )
            searched = inside and r >= _CREDIBLE
        if not searched:
            found = _best(batch, pair, _Range(low, high, prior, pull))
            r = correlation(lines, sums, pair, found)
        shift[pair], similarity[pair] = found, r
        before[0], before[1] = found, 1 if r >= _CREDIBLE else 0


@kernel
def _best(batch: _Batch, pair: int, within: _Range) -> int:
    """Return the shift of a line pair with the smallest distance [px].

    Of several shifts with equal distances, the one closest to 0 is returned.

    Args:
        batch: lines to compare.
        pair: number of the pair.
        within: shifts to search, with the prior.
    """
    low, high, prior, pull = within
    best, best_shift = _UNDEFINED, min(max(0, low), high)
    nearest = max(0, low, -high)
    for size in range(nearest, max(abs(low), abs(high)) + 1):
        for sign in (1, -1):
            s = sign * size
            if s < low or s > high or (size == 0 and sign < 0):
                continue
            d = _distance(batch, pair, s) * (1.0 + pull * abs(s - prior))
            if d < best:
                best, best_shift = d, s
    return best_shift


@kernel
def _distance(batch: _Batch, pair: int, s: int) -> float:
    """Return the distance measure of a line pair at shift `s` [px], infinite if undefined."""
    kind, lines, codes, sums, ranks = batch
    count = lines.shape[1] - abs(s)
    x, y = max(0, -s), max(0, s)
    distance: float
    if kind == _MANHATTAN:  # Eq. (80)
        distance = _differences(lines[pair + 1, x : x + count], lines[pair, y : y + count]) / count
        return distance
    if kind == _SPEARMAN:
        distance = 1.0 - _rank_correlation(
            codes[pair + 1, x : x + count], codes[pair, y : y + count], ranks
        )
        return distance
    if kind == _PEARSON:  # Eq. (81)
        distance = 1.0 - correlation(lines, sums, pair, s, -_UNDEFINED)
        return distance
    xy = _product(lines[pair + 1, x : x + count], lines[pair, y : y + count])
    xx = sums[1, pair + 1, x + count] - sums[1, pair + 1, x]
    yy = sums[1, pair, y + count] - sums[1, pair, y]
    if kind == _COSINE:  # Eq. (83)
        if xx == 0 or yy == 0:
            return _UNDEFINED
        distance = 1.0 - xy / math.sqrt(np.float64(xx) * np.float64(yy))
        return distance
    square = np.float64(xx + yy - 2 * xy)
    distance = (math.sqrt(square) if kind == _EUCLIDEAN else square) / count  # Eq. (79)
    return distance


@kernel
def correlation(lines: Lines, sums: IntArray, pair: int, s: int, undefined: float = -1.0) -> float:
    """Return Pearson's correlation (81) of a pair at shift `s` [px].

    The result is bit-identical to that of the module `pearson`. If a line is constant in the
    overlap, the result is `undefined`.
    """
    count = lines.shape[1] - abs(s)
    x, y = max(0, -s), max(0, s)
    s_x = sums[0, pair + 1, x + count] - sums[0, pair + 1, x]
    s_y = sums[0, pair, y + count] - sums[0, pair, y]
    v_x = count * (sums[1, pair + 1, x + count] - sums[1, pair + 1, x]) - s_x * s_x
    v_y = count * (sums[1, pair, y + count] - sums[1, pair, y]) - s_y * s_y
    if v_x <= 0 or v_y <= 0:
        return undefined
    s_xy = _product(lines[pair + 1, x : x + count], lines[pair, y : y + count])
    r: float = (count * s_xy - s_x * s_y) / math.sqrt(np.float64(v_x) * np.float64(v_y))
    return r


@kernel
def _product(x: Lines, y: Lines) -> int:
    """Return the sum of ``x_i y_i`` over the pixels i of two parts of lines, shape (N,) each.

    For 8-bit lines, 32-bit sums suffice and are faster.
    """
    if x.itemsize == 1:
        narrow = np.int32(0)
        for i in range(x.shape[0]):
            narrow = np.int32(narrow + np.int32(x[i]) * np.int32(y[i]))
        return np.int64(narrow)  # type: ignore[return-value]
    wide = np.int64(0)
    for i in range(x.shape[0]):
        wide += np.int64(x[i]) * np.int64(y[i])
    return wide  # type: ignore[return-value]


@kernel
def _differences(x: Lines, y: Lines) -> int:
    """Return the sum of ``|x_i - y_i|`` over the pixels i of two parts of lines, shape (N,) each.

    A sum of 32 bits suffices for 16384 pixels of 16 bits.
    """
    total = np.int32(0)
    for i in range(x.shape[0]):
        total = np.int32(total + abs(np.int32(x[i]) - np.int32(y[i])))
    return np.int64(total)  # type: ignore[return-value]


@kernel
def _rank_correlation(x: Lines, y: Lines, ranks: IntArray) -> float:
    """Return the rank correlation of two parts of lines; minus infinity if a part is constant.

    Args:
        x: `_Batch.codes` of one part, shape (N,).
        y: `_Batch.codes` of the other part, shape (N,).
        ranks: working memory, shape (2, levels).
    """
    count = np.int64(x.shape[0])
    # Ranks are doubled, so that ties have integer ranks; the doubled ranks have the mean count + 1.
    variance_x = _rank(x, ranks[0])
    variance_y = _rank(y, ranks[1])
    if variance_x == 0 or variance_y == 0:
        return -_UNDEFINED
    total = np.int64(0)
    for i in range(count):
        total += ranks[0, x[i]] * ranks[1, y[i]]
    return total / math.sqrt(np.float64(variance_x) * np.float64(variance_y))


@kernel
def _rank(part: Lines, ranks: IntArray) -> int:
    """Write the centered ranks of the gray levels in part of a line to `ranks`.

    Args:
        part: `_Batch.codes` of the part, shape (N,).
        ranks: output, for each level: twice its mean rank minus twice the mean of all ranks, shape
            (levels,).

    Returns:
        Sum of the squared output over the pixels of the part.
    """
    count = part.shape[0]
    ranks[:] = 0
    for i in range(count):
        ranks[part[i]] += 1
    below, squares = 0, 0
    for level in range(ranks.shape[0]):
        here = ranks[level]
        rank = 2 * below + here - count
        ranks[level] = rank
        squares += here * rank * rank
        below += here
    return squares
