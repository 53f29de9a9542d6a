"""Sums of the texels across a camera line: one sum (column) for each texel along the line.

A line is usually oblique to the rows of the texture. Each row of texels is therefore shifted along
the line, so that texels at the same place along the line are in the same column, and then the rows
are added. The shift relative to the middle row is rounded to a quarter texel: its integer part
selects the texel, and its fraction selects one of four accumulators, called classes. Rows that a
column covers only in part, along the two long sides of the footprint, are added with weights.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from omni_core.kernels import kernel, lean_inline
from omni_core.quantities import Int8Array, Int16Array, Int32Array, IntArray

POINT = 24
"""Number of fractional bits of a fixed-point position."""

ONE = 1 << POINT
"""One texel as a fixed-point position."""

WEIGHT_BITS = 8
"""Number of fractional bits of the weight of a partly covered row."""

CLASSES = 4
"""Number of accumulators, one for each quarter of a texel; the code requires 4."""

HALF = CLASSES // 2
"""Number of the class that contains the rows without a fractional shift."""

GROUP = 4
"""Number of rows that are added at a time."""

BLOCK = 32
"""Number of columns in a block; the texture must be readable up to the end of a block."""

_SPILL = 248  # rows added before an int16 could overflow: (248 + GROUP) 128 < 2^15
_EDGE_COLUMNS = 16  # columns per step along the long sides
_LEVEL = 20  # bits of the number that replaces infinity if rows and columns are parallel
# Unsigned indices avoid the check for negative numbers.
_0, _1, _2, _3 = (np.uint64(i) for i in range(4))

_Four = tuple[int, int, int, int]


class Placement(NamedTuple):
    """Placement of the rows of texels under a camera line.

    Attributes:
        first: index of the first row, in the texture or in its mirror image.
        downwards: whether the mirror image is used.
        column: index of the texel in column 0 of a row with the shift 0, counted within the period.
        ahead: shift of the first row relative to the middle row [quarter texels, fixed point].
        ahead_per_row: shift of each row relative to the row before it [quarter texels, fixed
            point].
    """

    first: int
    downwards: bool
    column: int
    ahead: int
    ahead_per_row: int


class Cover(NamedTuple):
    """Range of texel rows that each column of a footprint covers.

    Column c covers the rows from ``low + climb c`` to ``low + climb c + height``. All values are
    fixed-point numbers: `low` and `height` in rows, `climb` in rows per column.
    """

    low: int
    climb: int
    height: int


class Rows(NamedTuple):
    """Texel rows under a line, followed by an empty row.

    Attributes:
        offsets: texture index of the texel that each row has in column 0.
        starts: first column in which each row is covered completely.
        ends: column after the last column in which each row is covered completely.
        classes: class of the fractional shift of each row.
        listed: for each class, the rows that are covered completely in at least one column.
        used: number of listed rows in each class.
    """

    offsets: IntArray
    starts: IntArray
    ends: IntArray
    classes: IntArray
    listed: IntArray
    used: IntArray


@kernel
def place_rows(texels: int, stride: int, placement: Placement, rows: Rows) -> None:
    """Write the texture index of each row's texel in column 0, and the class of each row.

    Args:
        texels: number of texels per period.
        stride: number of texels in a padded row.
        placement: placement of the rows.
        rows: output, of which only `offsets` and `classes` are written.
    """
    row_0, downwards, origin, ahead, ahead_per_row = placement
    offsets, classes = rows.offsets[: len(rows.classes)], rows.classes
    row = row_0 % texels
    if downwards:
        row = texels - 1 - row
    step = -1 if downwards else 1
    begin = 0
    while begin < len(offsets):  # each pass extends to the end of the period
        stop = min(len(offsets), begin + (row + 1 if downwards else texels - row))
        here, kinds = offsets[begin:stop], classes[begin:stop]
        for j in range(len(here)):
            at = row + step * j
            # Half a texel is added so that the classes are centered on zero. At small slopes,
            # rounding to the nearest class would give many neighboring rows the same error; four
            # alternating offsets make these errors cancel.
            quarters = (ahead + ahead_per_row * j + _rounding(at)) >> POINT
            kinds[j] = quarters & (CLASSES - 1)
            column = origin - (quarters >> 2)
            column += texels if column < 0 else 0
            column += texels if column < 0 else 0
            column -= texels if column >= texels else 0
            column -= texels if column >= texels else 0
            here[j] = at * stride + column
        ahead += ahead_per_row * (stop - begin)
        begin = stop
        row = texels - 1 if downwards else 0


@lean_inline
def _rounding(row: int) -> int:
    """Return the fixed-point number that is added to a row's shift before the sum is rounded down.

    Successive rows have the numbers 1/8, 5/8, 3/8 and 7/8 of a quarter texel (dithering).
    """
    return (1 + 4 * (row & 1) + (row & 2)) << (POINT - 3)


@kernel
def bound_rows(cover: Cover, count: int, rows: Rows) -> None:
    """Write to `rows` the range of columns, out of `count`, that covers each row completely.

    Column c covers row j completely if ``low + climb c <= j`` and ``j + 1 <= low + climb c +
    height``, with the fields of `cover`.
    """
    low, climb, height = cover
    starts, ends = rows.starts, rows.ends
    above = -low
    shorter = (1 << POINT) - height - 1
    divisor = climb
    per_row = 1 << POINT
    if climb == 0:  # a row is covered in all columns or in none
        divisor = 1
        per_row <<= _LEVEL
        above = (above << _LEVEL) + (1 << (_LEVEL - 1))
        shorter <<= _LEVEL
    lead = shorter // divisor  # start minus end of a row's columns, 1 more if the remainders carry
    lead_rest = divisor - shorter % divisor
    for j in range(len(rows.classes)):
        at = above + per_row * j
        behind = math.floor(at / divisor) + 1  # exact, as the numbers have 40 bits
        carry = 1 if at - (behind - 1) * divisor >= lead_rest else 0
        starts[j] = max(behind + lead + carry, 0)
        ends[j] = min(behind, count)


@kernel
def list_rows(count: int, rows: Rows) -> None:
    """Write, for each class, the rows that are covered completely in any of `count` columns.

    In `rows.listed`, the empty row is repeated at the end of each list, because `add_rows` adds
    groups of four rows.
    """
    classes, starts, ends, listed = rows.classes, rows.starts, rows.ends, rows.listed
    list_0, list_1, list_2, list_3 = listed[0], listed[1], listed[2], listed[3]
    n_0, n_1, n_2, n_3 = 0, 0, 0, 0
    none = len(classes)
    for j in range(none):
        # Writing the row to all lists, but counting it in only one, avoids an unpredictable branch.
        kind = classes[j] if starts[j] < ends[j] else CLASSES
        list_0[n_0] = list_1[n_1] = list_2[n_2] = list_3[n_3] = j
        n_0 += 1 if kind == 0 else 0
        n_1 += 1 if kind == 1 else 0
        n_2 += 1 if kind == 2 else 0
        n_3 += 1 if kind == 3 else 0
    rows.offsets[none] = 0
    starts[none] = ends[none] = count
    for cls, used in enumerate((n_0, n_1, n_2, n_3)):
        rows.used[cls] = used
        listed[cls, used : used + GROUP] = none


@kernel
def add_rows(
    texture: Int8Array, rows: Rows, cls: int, sums: Int16Array, totals: Int32Array
) -> None:
    """Write the sum of the rows of a class in each column, scaled by 2^WEIGHT_BITS, to `totals`.

    Args:
        texture: texels.
        rows: rows from `list_rows`.
        cls: number of the class.
        sums: buffer for the sums of up to 252 rows.
        totals: output, one number for each column.
    """
    listed, used = rows.listed[cls], rows.used[cls]
    sums[:] = 0
    for place in range(0, min(used, _SPILL), GROUP):
        _add_four_rows(texture, rows, listed[place:], len(totals), sums)
    for c in range(len(totals)):
        totals[c] = np.int32(sums[c]) << WEIGHT_BITS
    for begin in range(_SPILL, used, _SPILL):
        sums[:] = 0
        for place in range(begin, min(used, begin + _SPILL), GROUP):
            _add_four_rows(texture, rows, listed[place:], len(totals), sums)
        for c in range(len(totals)):
            totals[c] += np.int32(sums[c]) << WEIGHT_BITS


@lean_inline
def _add_four_rows(
    texture: Int8Array, rows: Rows, listed: IntArray, count: int, sums: Int16Array
) -> None:
    """Add the first four listed rows to `sums`, in whole blocks of columns.

    The compiler adds the columns of a block at once. Single columns at the ends of a run, which is
    short, would take longer than the rest of the run.
    """
    offsets = _four(rows.offsets, listed)
    starts = _four(rows.starts, listed)
    ends = _four(rows.ends, listed)
    # The first row begins and ends leftmost, and the last one rightmost. Sums beyond the last
    # column are not used.
    first = starts[0] // BLOCK
    outer = (count + BLOCK - 1 if ends[0] >= count else ends[0]) // BLOCK
    inner = min((starts[3] + BLOCK - 1) // BLOCK, outer)
    last = (ends[3] + BLOCK - 1) // BLOCK
    bounds = starts, ends
    _add_ends(texture, offsets, bounds, (first, inner), sums)
    at_0, at_1, at_2, at_3 = _unsigned(offsets)
    for c in range(np.uint64(BLOCK * inner), np.uint64(BLOCK * outer)):
        near = np.int16(texture[at_0 + c]) + np.int16(texture[at_1 + c])
        sums[c] += near + np.int16(texture[at_2 + c]) + np.int16(texture[at_3 + c])
    _add_ends(texture, offsets, bounds, (max(first, outer), last), sums)


@lean_inline
def _add_ends(
    texture: Int8Array,
    offsets: _Four,
    bounds: tuple[_Four, _Four],
    blocks: tuple[int, int],
    sums: Int16Array,
) -> None:
    """Add to `sums` the columns of some blocks that four rows cover completely.

    Args:
        texture: texels.
        offsets: texture index of the texel that each row has in column 0.
        bounds: for each row, the first column that it covers, and the column after the last one.
        blocks: first block, and the block after the last one.
        sums: sum in each column, changed in place.
    """
    at_0, at_1, at_2, at_3 = _unsigned(offsets)
    (start_0, start_1, start_2, start_3), (end_0, end_1, end_2, end_3) = bounds
    for c in range(np.uint64(BLOCK * blocks[0]), np.uint64(BLOCK * blocks[1])):
        column = np.int16(c)  # comparisons of 64 bits would fill eight vectors
        total = np.int16(texture[at_0 + c]) * _between(start_0, column, end_0)
        total += np.int16(texture[at_1 + c]) * _between(start_1, column, end_1)
        total += np.int16(texture[at_2 + c]) * _between(start_2, column, end_2)
        total += np.int16(texture[at_3 + c]) * _between(start_3, column, end_3)
        sums[c] += total


@lean_inline
def _between(start: int, column: np.int16, end: int) -> np.int16:
    """Return 1 if a column is in a range, otherwise 0; a branch could not be vectorized."""
    return np.int16(np.int16(start) <= column) & np.int16(column < np.int16(end))


@lean_inline
def _four(numbers: IntArray, listed: IntArray) -> _Four:
    """Return the entries of `numbers` for the first four listed rows."""
    return (
        numbers[np.uint64(listed[_0])],
        numbers[np.uint64(listed[_1])],
        numbers[np.uint64(listed[_2])],
        numbers[np.uint64(listed[_3])],
    )


@lean_inline
def _unsigned(numbers: _Four) -> tuple[Any, Any, Any, Any]:
    """Return four numbers as unsigned indices."""
    return (
        np.uint64(numbers[0]),
        np.uint64(numbers[1]),
        np.uint64(numbers[2]),
        np.uint64(numbers[3]),
    )


@kernel
def add_edges(texture: Int8Array, cover: Cover, offsets: IntArray, totals: Int32Array) -> None:
    """Add to each column's total the weighted texels of the two rows that it covers only in part.

    The totals are those of the class without a fractional shift; a fractional shift of the two rows
    is ignored. The weights of all rows of a column add up to the footprint's height regardless of
    rounding, so that a uniform ground gives uniform lines.

    Args:
        texture: texels.
        cover: rows that each column covers.
        offsets: texture index of the texel that each row has in column 0.
        totals: sum of the rows of this class in each column, changed in place.
    """
    low, climb, height = cover
    climbed = (_EDGE_COLUMNS - 1) * climb
    whole = height >> (POINT - WEIGHT_BITS)
    for first in range(0, len(totals), _EDGE_COLUMNS):
        y = low + climb * first - 1
        top = y + height + 1
        under, over = y >> POINT, top >> POINT
        into = totals[first : first + _EDGE_COLUMNS]
        if under == (y + climbed) >> POINT and over == (top + climbed) >> POINT:
            # All these columns share the same two partly covered rows, so the compiler can
            # vectorize.
            shared = np.int32(whole - ((over - under - 1) << WEIGHT_BITS))
            at_under = np.uint64(offsets[under] + first)
            at_over = np.uint64(offsets[over] + first)
            for i in range(np.uint64(len(into))):
                below = np.int32((~(y + climb * np.int64(i)) & (ONE - 1)) >> (POINT - WEIGHT_BITS))
                above = np.int32(shared - below)
                into[i] += below * texture[at_under + i] + above * texture[at_over + i]
        else:
            for i in range(len(into)):
                under, over = y >> POINT, (y + height + 1) >> POINT
                lower = (~y & (ONE - 1)) >> (POINT - WEIGHT_BITS)
                upper = whole - ((over - under - 1) << WEIGHT_BITS) - lower
                at_under = np.uint64(offsets[np.uint64(under)] + first + i)
                at_over = np.uint64(offsets[np.uint64(over)] + first + i)
                into[i] += lower * np.int32(texture[at_under]) + upper * np.int32(texture[at_over])
                y += climb
