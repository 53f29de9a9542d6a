"""Integrates the ground texture over the footprints of a line camera's pixels, at any heading.

A footprint is a rectangle of `length` (axis a) by `width` (across), a pixel one slice of it
(section 4.3.2, Figure 57). Tables of strip sums along quantised headings are fast while the
heading stands still and expensive while the vehicle turns. This integral needs no tables: with
x the texture axis that lies within 45 deg of the line (else the texture is transposed),
``s = x + y tan(heading)`` is a coordinate along the line that every row of texels shares, apart
from a shift of its own. So a line is

1. per row, one contiguous 8-bit run added onto columns over `s` (SIMD, four rows at a time).
   The shift is rounded to a quarter texel: its whole part moves the run, its fraction chooses
   one of four accumulators;
2. along the two long sides, the rows that a column covers in part, weighted;
3. the four accumulators merged into cells of a quarter texel, and their prefix sum read at the
   edges of the pixels, exact for any pixel pitch. Where texels are means of finer ones, the cells
   are weighted first so that they follow the grey within a texel.

Everything is integer arithmetic until the last step, so results do not depend on vectorisation.
Texels are squares of constant grey. What is approximated are shifts below a quarter of a texel
and the slant of a pixel's edges within one: at most 0.08 grey levels (rms) for a footprint 400
texels wide on the shipped grounds, and the more, the fewer rows are averaged: 0.25 for 50.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from omni_sim.camera.footprint.blocks import (
    BLOCK,
    add_four,
    add_four_between,
    add_four_from,
    add_four_until,
    prefetch,
)
from omni_sim.camera.footprint.padding import LEAST_WIDTH, PaddedTexture

Int8s = NDArray[np.int8]
Int16s = NDArray[np.int16]
Int32s = NDArray[np.int32]
Int64s = NDArray[np.int64]

_CLASSES = 4  # accumulators, one for each quarter of a texel; the code below is written for 4
_HALF = _CLASSES // 2
_POINT = 24  # binary places of fixed-point positions
_ONE = 1 << _POINT
_WEIGHT_BITS = 8  # binary places of the weights of partly covered rows
_SPILL = 248  # rows of |grey - middle| <= 128 that an int16 holds: 248 + 4 <= 255
_MARGIN = 8  # columns and rows beyond the footprint
_CACHE_LINE = 64  # bytes
_BLOCKS = ~(BLOCK - 1)  # of a column: the first one of its block
_PREFETCHED = 2  # cache lines of a row asked for ahead of its use
_LEVEL = 20  # binary places that stand for infinity where rows and columns run alike
_NARROW_ROWS = 640  # whose sums, times the weights of `_refine`, fit 32 bits
# Places in a list as unsigned numbers, which spare the checks for negative ones.
_1, _2, _3, _4, _5, _6, _7, _8, _9, _10, _11 = (np.uint64(i) for i in range(1, 12))


class _Ground(NamedTuple):
    """Texels as the kernel reads them; see `PaddedTexture`."""

    rows: Int8s
    columns: Int8s
    texels: int
    stride: int
    averaged: bool


class _Placement(NamedTuple):
    """Where the rows of texels lie under a line.

    Attributes:
        first: the first row, in the texture or in its mirror image.
        downwards: whether it is the mirror image.
        column: that the columns count from.
        ahead: by which the first row lies ahead of the middle one [quarter texels, fixed point].
        ahead_per_row: by which each row lies ahead of the one before.
    """

    first: int
    downwards: bool
    column: int
    ahead: int
    ahead_per_row: int


class _Cover(NamedTuple):
    """Column c covers rows ``low + c climb .. low + c climb + height`` [rows, fixed point]."""

    low: int
    climb: int
    height: int


class _RowLists(NamedTuple):
    """Rows of texels, by the class of their fractional shift.

    Attributes:
        offsets: for each row where in the texture column 0 lies.
        classes: of each row.
        listed: a quarter for each class, which holds offset, first and end column of its rows.
        end: of what each quarter holds.
    """

    offsets: Int64s
    classes: Int64s
    listed: Int64s
    end: Int64s


class _Integral(NamedTuple):
    """Integral of a line along its columns.

    Attributes:
        cells: sums of quarter texels, shape (4, columns).
        inner: sums of each column's cells to the end of each, likewise.
        prefix: sum of all columns before each.
    """

    cells: Int32s
    inner: Int32s
    prefix: Int64s


class _Edges(NamedTuple):
    """Edges of the pixels on the integral [cells].

    Attributes:
        start: the first one.
        step: from one to the next.
        slant: standard deviation of each, by its slant against a row of texels.
    """

    start: float
    step: float
    slant: float


def integrate_lines(
    texture: PaddedTexture,
    centres: NDArray[np.float64],
    length: float,
    width: float,
    pixels: int,
) -> NDArray[np.float32]:
    """Return the mean grey level of every pixel's footprint.

    Args:
        texture: the ground.
        centres: shape (m, 3): centre of the footprint x, y [m] and direction of its axis [rad].
        length: footprint along the axis [m].
        width: footprint across the axis [m]; at least 10 texels.
        pixels: pixels of a line.

    Returns:
        Grey levels of shape (m, pixels); the pixel index grows along the axis.

    Raises:
        ValueError: a pose is not finite, or the footprint does not suit the texture.
    """
    if not np.isfinite(centres).all():
        raise ValueError("a footprint's pose is not finite")
    if length > texture.reach * (1.0 + 1e-9):
        raise ValueError(f"the footprint of {length} m is longer than the reach {texture.reach} m")
    if width < LEAST_WIDTH * texture.texel:
        raise ValueError(f"the footprint of {width} m is narrower than {LEAST_WIDTH:g} texels")
    scaled = np.array(centres, dtype=np.float64)  # a copy, C-contiguous
    scaled[:, :2] /= texture.texel
    lines = np.empty((len(scaled), pixels), dtype=np.float32)
    ground = _Ground(
        texture.rows, texture.columns, texture.texels, texture.stride, texture.averaged
    )
    _integrate(ground, scaled, 0.5 * length / texture.texel, 0.5 * width / texture.texel, lines)
    lines += np.float32(texture.middle)
    return lines


@njit(cache=True, nogil=True)
def _integrate(  # noqa: PLR0915, its steps share too many arrays to be called apart
    ground: _Ground,
    centres: NDArray[np.float64],
    half_length: float,
    half_width: float,
    lines: NDArray[np.float32],
) -> None:
    """Integrate lines whose centres and half sizes are in texels, into `lines`."""
    room = math.ceil(2.0 * half_length * math.sqrt(2.0)) + 2 * _MARGIN
    room = (-(-room // BLOCK) + 2) * BLOCK
    sums = np.empty(room, np.int16)
    totals = np.empty((_CLASSES, room), np.int32)
    cells = np.empty((_CLASSES, room), np.int32)
    refined = np.empty((_CLASSES, room), np.int32)
    inner = np.empty((_CLASSES, room), np.int32)
    prefix = np.empty(room, np.int64)
    most_rows = int(2.0 * (half_length + half_width)) + 2 * _MARGIN
    offsets = np.empty(most_rows, np.int64)
    classes = np.empty(most_rows, np.int64)
    listed = np.empty(_CLASSES * 3 * (most_rows + 3), np.int64)
    listed_end = np.empty(_CLASSES, np.int64)
    texels = ground.texels
    for line in range(len(centres)):
        x = centres[line, 0] % texels
        y = centres[line, 1] % texels
        a_x = math.cos(centres[line, 2])
        a_y = math.sin(centres[line, 2])
        texture = ground.rows
        if abs(a_x) < abs(a_y):
            texture = ground.columns
            x, y, a_x, a_y = y, x, a_y, a_x
        backwards = a_x < 0.0
        if backwards:
            a_x, a_y = -a_x, -a_y
        downwards = a_y < 0.0  # mirror y: row j of the mirrored texture is row n - 1 - j
        if downwards:
            y, a_y = texels - y, -a_y

        tangent = a_y / a_x
        slope = a_x * a_y  # rows that the long sides climb per column
        reach = half_width * a_x
        half = half_length / a_x  # along s
        # Columns are the texels of the middle row: column c begins at s = origin + c - rest.
        middle = math.floor(y)
        x -= (middle + 0.5 - y) * tangent
        whole = math.floor(x)
        rest = x - whole
        origin = math.floor(-half) - 2
        count = math.ceil(half) + 4 - origin
        row_0 = math.floor(y - reach - half_length * a_y) - 2
        row_count = math.ceil(y + reach + half_length * a_y) + 3 - int(row_0)

        # Rows counted from row_0.
        low = math.floor((y - reach + slope * (origin - rest + 0.5) - row_0) * _ONE + 0.5)
        height = math.floor(2.0 * reach * _ONE + 0.5)
        cover = _Cover(low, math.floor(slope * _ONE + 0.5), height)

        # Quarter texels by which the texels of row_0 lie ahead of those of the middle row.
        ahead = (row_0 - middle) * tangent * _CLASSES + _HALF
        placement = _Placement(
            int(row_0), downwards, int(origin + whole),
            math.floor(ahead * _ONE), math.floor(tangent * _CLASSES * _ONE + 0.5),
        )  # fmt: skip
        rows = _RowLists(offsets[:row_count], classes, listed, listed_end)
        _place_rows(texels, ground.stride, placement, rows)
        _list_rows(texture, cover, count, rows)
        for cls in range(_CLASSES):
            begin = cls * len(listed) // _CLASSES
            used = listed_end[cls] - begin
            _add_rows(texture, listed[begin:], used, sums, totals[cls, :count])
        _add_edges(texture, cover, offsets, totals[_HALF, :count])
        _merge(totals, cells, count)
        seen = cells
        if ground.averaged:
            spare = 0
            while height >> (_POINT + spare) > _NARROW_ROWS:
                spare += 1
            if spare > 0:
                cells >>= spare
            _refine(cells, refined, count - 1)
            if spare > 0:
                refined <<= spare
            seen = refined
        _sum_cells(seen, inner, prefix, count - 1)

        step = 2.0 * half / lines.shape[1]
        start = (-half - (origin + 0.5 - rest)) * _CLASSES
        weight = _CLASSES * step * (height >> (_POINT - _WEIGHT_BITS))
        slant = tangent * _CLASSES / math.sqrt(12.0)
        edges = _Edges(start, step * _CLASSES, slant)
        _read_pixels(_Integral(seen, inner, prefix), edges, 1.0 / weight, lines[line])
        if backwards:
            _reverse(lines[line])


@njit(cache=True, nogil=True)
def _list_rows(texture: Int8s, cover: _Cover, count: int, rows: _RowLists) -> None:
    """List by class the rows that cover any of `count` columns in full, once they are placed."""
    low, climb, height = cover
    offsets, classes, listed, listed_end = rows
    for cls in range(_CLASSES):
        listed_end[cls] = cls * len(listed) // _CLASSES
    # Row j covers column c in full where low + climb c <= j and j + 1 <= low + climb c + height.
    # The quotients that solve this grow from row to row by whole numbers and a carry.
    above = -low
    shorter = (1 << _POINT) - height - 1
    divisor = climb
    per_row = 1 << _POINT
    if climb == 0:  # all columns or none
        divisor = 1
        per_row <<= _LEVEL
        above = (above << _LEVEL) + (1 << (_LEVEL - 1))
        shorter <<= _LEVEL
    end = above // divisor + 1
    end_rest = above % divisor
    lead = shorter // divisor  # of the start before the end, and one more with a carry
    lead_rest = divisor - shorter % divisor
    whole = per_row // divisor
    part = per_row % divisor
    for j in range(len(offsets)):
        first = max(end + lead + (1 if end_rest >= lead_rest else 0), 0)
        behind = min(end, count)
        if first < behind:
            offset = offsets[j]
            number = np.uint64(classes[j])
            for line in range(_PREFETCHED):
                prefetch(texture, offset + first + line * _CACHE_LINE)
            place = np.uint64(listed_end[number])
            listed[place] = offset
            listed[place + _1] = first
            listed[place + _2] = behind
            listed_end[number] += 3
        end_rest += part
        carry = 1 if end_rest >= divisor else 0
        end_rest -= carry * divisor
        end += whole + carry


@njit(cache=True, nogil=True)
def _place_rows(texels: int, stride: int, placement: _Placement, rows: _RowLists) -> None:
    """Set where in the texture column 0 of each row lies, and the class of its fractional shift."""
    row_0, downwards, origin, ahead, ahead_per_row = placement
    offsets, classes = rows.offsets, rows.classes
    row = row_0 % texels
    if downwards:
        row = texels - 1 - row
    step = -1 if downwards else 1
    origin %= texels
    begin = 0
    while begin < len(offsets):  # up to where the texture begins anew
        stop = min(len(offsets), begin + (row + 1 if downwards else texels - row))
        here, kinds = offsets[begin:stop], classes[begin:stop]
        for j in range(len(here)):
            at = row + step * j
            # Half a texel too many, so that classes lie around zero. Rounding every row to the
            # nearest would shift many neighbours alike at small slopes; four rows rounded
            # differently even out.
            quarters = (ahead + ahead_per_row * j + _rounding(at)) >> _POINT
            kinds[j] = quarters & (_CLASSES - 1)
            column = origin - (quarters >> 2)
            column += texels if column < 0 else 0
            column += texels if column < 0 else 0
            column -= texels if column >= texels else 0
            column -= texels if column >= texels else 0
            here[j] = at * stride + column
        ahead += ahead_per_row * (stop - begin)
        begin = stop
        row = texels - 1 if downwards else 0


@njit(cache=True, nogil=True, inline="always")
def _rounding(row: int) -> int:
    """Return 1/8, 5/8, 3/8, 7/8 in turn, as fixed point."""
    return (1 + 4 * (row & 1) + (row & 2)) << (_POINT - 3)


@njit(cache=True, nogil=True)
def _add_rows(texture: Int8s, rows: Int64s, used: int, sums: Int16s, totals: Int32s) -> None:
    """Set `totals` to the sums of the listed rows, on the scale texels x 2^_WEIGHT_BITS."""
    behind = rows[used - 1] if used > 0 else 0
    for place in range(used, -(-used // 12) * 12, 3):  # fill up with rows of no columns
        rows[place] = 0
        rows[place + 1] = rows[place + 2] = behind
    sums[:] = 0
    for place in range(0, min(used, 3 * _SPILL), 12):
        _add_four_rows(texture, rows, np.uint64(place), sums)
    for c in range(len(totals)):
        totals[c] = np.int32(sums[c]) << _WEIGHT_BITS
    for begin in range(3 * _SPILL, used, 3 * _SPILL):
        sums[:] = 0
        for place in range(begin, min(used, begin + 3 * _SPILL), 12):
            _add_four_rows(texture, rows, np.uint64(place), sums)
        for c in range(len(totals)):
            totals[c] += np.int32(sums[c]) << _WEIGHT_BITS


@njit(cache=True, nogil=True, inline="always")
def _add_four_rows(texture: Int8s, rows: Int64s, at: int, sums: Int16s) -> None:
    """Add four rows: whole blocks of what they share, their ragged ends masked."""
    offsets = (rows[at], rows[at + _3], rows[at + _6], rows[at + _9])
    starts = (rows[at + _1], rows[at + _4], rows[at + _7], rows[at + _10])
    ends = (rows[at + _2], rows[at + _5], rows[at + _8], rows[at + _11])
    # The first row lies the farthest left, the last one the farthest right.
    first = starts[0] & _BLOCKS
    inner = first + 2 * BLOCK
    outer = ends[0] & _BLOCKS
    if outer < inner or starts[3] > inner or ends[3] > outer + 2 * BLOCK:
        for c in range(first, ends[3], BLOCK):
            add_four_between(sums, c, texture, offsets, starts, ends)
        return
    # Always two blocks at an end, though one may be enough: a loop whose length changes from row
    # to row costs more than a block.
    add_four_from(sums, first, texture, offsets, starts)
    add_four_from(sums, first + BLOCK, texture, offsets, starts)
    for c in range(inner, outer, BLOCK):
        add_four(sums, c, texture, offsets)
    add_four_until(sums, outer, texture, offsets, ends)
    add_four_until(sums, outer + BLOCK, texture, offsets, ends)


@njit(cache=True, nogil=True)
def _add_edges(texture: Int8s, cover: _Cover, offsets: Int64s, totals: Int32s) -> None:
    """Add the two rows that each column covers in part, to the class without a fraction.

    All weights of a column add up to `height`, whatever the rounding: a uniform ground must not
    show where rows begin and end.
    """
    low, climb, height = cover
    height_weight = height >> (_POINT - _WEIGHT_BITS)
    y = low - 1
    for c in range(len(totals)):
        under = y >> _POINT  # the row before the first that is covered in full
        over = (y + height + 1) >> _POINT
        below = ((_ONE - 1) - (y & (_ONE - 1))) >> (_POINT - _WEIGHT_BITS)
        above = height_weight - ((over - under - 1) << _WEIGHT_BITS) - below
        # Unsigned indices spare the checks for negative ones.
        grey_below = texture[np.uint64(offsets[np.uint64(under)] + c)]
        grey_above = texture[np.uint64(offsets[np.uint64(over)] + c)]
        totals[c] += np.int32(below * grey_below + above * grey_above)
        y += climb


@njit(cache=True, nogil=True)
def _merge(totals: Int32s, cells: Int32s, count: int) -> None:
    """Merge the classes into quarter-texel cells: ``cells[q, c]`` at s = origin + c + (2 + q)/4.

    Class k of column c begins at quarter k of a column that starts half a texel early, so cell q
    sees classes up to q of its own column and the others of the column before.
    """
    n = count - 1
    here_0, here_1 = totals[0, 1:count], totals[1, 1:count]
    here_2, here_3 = totals[2, 1:count], totals[3, 1:count]
    last_1, last_2, last_3 = totals[1, :n], totals[2, :n], totals[3, :n]
    cell_0, cell_1, cell_2, cell_3 = cells[0, :n], cells[1, :n], cells[2, :n], cells[3, :n]
    for c in range(n):
        q_0 = here_0[c] + last_1[c] + last_2[c] + last_3[c]
        q_1 = q_0 + here_1[c] - last_1[c]
        q_2 = q_1 + here_2[c] - last_2[c]
        q_3 = q_2 + here_3[c] - last_3[c]
        cell_0[c], cell_1[c], cell_2[c], cell_3[c] = q_0, q_1, q_2, q_3


@njit(cache=True, nogil=True)
def _refine(cells: Int32s, refined: Int32s, n: int) -> None:
    """Restore what is lost within texels that are means of finer ones.

    The integral along the line, interpolated straight between the edges of texels, lags behind
    wherever grey changes. Weights (-9, 16, 50, 16, -9) / 64 of the cells that lie -4, -2, 0, 2, 4
    quarters away take out the steps of a texel's width (their gain is 0 there) and give back what
    both averaging and steps take from a curved profile (their second moment is that of two boxes,
    negated). Sums over 655 rows times all weights fit 32 bits.
    """
    for q in range(_CLASSES):
        other = cells[(q + _HALF) % _CLASSES]
        ahead = q // _HALF
        here, into = cells[q], refined[q]
        into[0], into[n - 1] = here[0], here[n - 1]
        into = into[1 : n - 1]
        middle, last, following = here[1 : n - 1], here[: n - 2], here[2:n]
        before, behind = other[ahead : n - 2 + ahead], other[1 + ahead : n - 1 + ahead]
        for c in range(len(into)):
            near = np.int32(before[c] + behind[c])
            far = np.int32(last[c] + following[c])
            total = np.int32(np.int32(50) * middle[c])
            total = np.int32(total + np.int32(np.int32(16) * near))
            total = np.int32(total - np.int32(np.int32(9) * far))
            into[c] = np.int32(total >> 6)


@njit(cache=True, nogil=True)
def _sum_cells(cells: Int32s, inner: Int32s, prefix: Int64s, n: int) -> None:
    """Sum the cells of each column to the end of each in `inner`, all before it in `prefix`."""
    cell_0, cell_1, cell_2, cell_3 = cells[0, :n], cells[1, :n], cells[2, :n], cells[3, :n]
    sum_0, sum_1, sum_2, sum_3 = inner[0, :n], inner[1, :n], inner[2, :n], inner[3, :n]
    for c in range(n):
        q_0, q_1, q_2, q_3 = cell_0[c], cell_1[c], cell_2[c], cell_3[c]
        sum_0[c] = q_0
        sum_1[c] = q_0 + q_1
        sum_2[c] = q_0 + q_1 + q_2
        sum_3[c] = (q_0 + q_1) + (q_2 + q_3)
    total = np.int64(0)
    fours = n // 4 * 4
    for c in range(0, fours, 4):  # four at a time wait for one sum only
        one, two = np.int64(sum_3[c]), np.int64(sum_3[c + 1])
        three, four = np.int64(sum_3[c + 2]), np.int64(sum_3[c + 3])
        prefix[c] = total
        prefix[c + 1] = total + one
        prefix[c + 2] = total + (one + two)
        prefix[c + 3] = total + (one + two + three)
        total += (one + two) + (three + four)
    for c in range(fours, n):
        prefix[c] = total
        total += np.int64(sum_3[c])


@njit(cache=True, nogil=True)
def _read_pixels(
    integral: _Integral, edges: _Edges, scale: float, line: NDArray[np.float32]
) -> None:
    """Set each pixel to the difference of the integral at its two edges, times `scale`.

    An edge is slanted against a row of texels, which smooths the integral by a box as wide as
    the slant. Two readings one standard deviation either side have the same second moment.
    """
    start, step, slant = edges
    before = math.floor((start - slant) * _ONE + 0.5)
    behind = math.floor((start + slant) * _ONE + 0.5)
    advance = math.floor(step * _ONE * 256.0 + 0.5)
    scale *= 0.5
    previous = 0.0
    for edge in range(len(line) + 1):
        moved = (advance * edge) >> 8
        value = _up_to(integral, before + moved) + _up_to(integral, behind + moved)
        if edge > 0:
            line[edge - 1] = (value - previous) * scale
        previous = value


@njit(cache=True, nogil=True, inline="always")
def _up_to(integral: _Integral, at: int) -> float:
    """Return the integral from the first column to a fixed-point position in cells."""
    cell = at >> _POINT
    fraction = (at & (_ONE - 1)) * (1.0 / _ONE)
    column = np.uint64(cell >> 2)
    quarter = np.uint64(cell & (_CLASSES - 1))
    value = np.float64(integral.prefix[column] + integral.inner[quarter, column])
    return float(value - (1.0 - fraction) * integral.cells[quarter, column])


@njit(cache=True, nogil=True)
def _reverse(line: NDArray[np.float32]) -> None:
    last = len(line) - 1
    for i in range(len(line) // 2):
        line[i], line[last - i] = line[last - i], line[i]
