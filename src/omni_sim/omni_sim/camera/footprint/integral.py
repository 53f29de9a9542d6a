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
    add_four_twice,
    add_four_until,
)
from omni_sim.camera.footprint.cells import (
    LANES,
    POINT,
    WEIGHT_BITS,
    add_edges,
    add_edges_alike,
    merge_classes,
    read_edges,
    sum_cells,
    sum_classes,
)
from omni_sim.camera.footprint.padding import LEAST_WIDTH, PaddedTexture

Int8s = NDArray[np.int8]
Int16s = NDArray[np.int16]
Int32s = NDArray[np.int32]
Int64s = NDArray[np.int64]
Floats = NDArray[np.float64]

_CLASSES = 4  # accumulators, one for each quarter of a texel; the code below is written for 4
_HALF = _CLASSES // 2
_ONE = 1 << POINT
_SPILL = 248  # rows of |grey - middle| <= 128 that an int16 holds: 248 + 4 <= 255
_MARGIN = 8  # columns and rows beyond the footprint
_GROUP = 4  # rows added at a time
_BLOCKS = ~(BLOCK - 1)  # of a column: the first one of its block
_LEVEL = 20  # binary places that stand for infinity where rows and columns run alike
_NARROW_ROWS = 640  # whose sums, times the weights of `_refine`, fit 32 bits
# Places in a list as unsigned numbers, which spare the checks for negative ones.
_0, _1, _2, _3, _4, _8 = (np.uint64(i) for i in (0, 1, 2, 3, 4, 8))


class _Ground(NamedTuple):
    """Texels as the kernel reads them; see `PaddedTexture`."""

    rows: Int8s
    columns: Int8s
    texels: int
    stride: int
    texel: float
    middle: np.float32
    averaged: bool


class _Placement(NamedTuple):
    """Where the rows of texels lie under a line.

    Attributes:
        first: the first row, in the texture or in its mirror image.
        downwards: whether it is the mirror image.
        column: that the columns count from, within the period.
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


class _Rows(NamedTuple):
    """Rows of texels under a line; behind the last one there is room for a row of no columns.

    Attributes:
        offsets: for each row where in the texture column 0 lies.
        starts: the first column that each row covers in full.
        ends: the column behind the last one.
        classes: of their fractional shifts.
        listed: rows that cover any column, for each class.
        used: how many these are.
    """

    offsets: Int64s
    starts: Int64s
    ends: Int64s
    classes: Int64s
    listed: Int64s
    used: Int64s


class _Edges(NamedTuple):
    """Edges of the pixels on the integral [cells], and what makes grey levels of it.

    Attributes:
        start: the first one.
        step: from one to the next.
        slant: standard deviation of each, by its slant against a row of texels.
        scale: of a difference of the integral.
        middle: grey level that is 0 there.
    """

    start: float
    step: float
    slant: float
    scale: float
    middle: np.float32


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
    lines = np.empty((len(centres), pixels), dtype=np.float32)
    ground = _Ground(
        texture.rows, texture.columns, texture.texels, texture.stride, texture.texel,
        np.float32(texture.middle), texture.averaged,
    )  # fmt: skip
    scaled = np.ascontiguousarray(centres, dtype=np.float64)
    _integrate(ground, scaled, 0.5 * length / texture.texel, 0.5 * width / texture.texel, lines)
    return lines


@njit(cache=True, nogil=True)
def _integrate(  # noqa: PLR0915, its steps share too many arrays to be called apart
    ground: _Ground,
    centres: NDArray[np.float64],
    half_length: float,
    half_width: float,
    lines: NDArray[np.float32],
) -> None:
    """Integrate lines whose half sizes are in texels, into `lines`."""
    room = math.ceil(2.0 * half_length * math.sqrt(2.0)) + 2 * _MARGIN
    room = (-(-room // BLOCK) + 2) * BLOCK
    sums = np.empty(room + BLOCK, np.int16)
    sums = sums[-sums.ctypes.data % (2 * BLOCK) // 2 :][:room]  # from a cache line on
    totals = np.empty((_CLASSES, room), np.int32)
    cells = np.empty((_CLASSES, room), np.int32)
    refined = np.empty((_CLASSES, room), np.int32)
    integral = np.empty(_CLASSES * room)
    values = np.empty(lines.shape[1] + 1 + LANES)
    most_rows = int(2.0 * (half_length + half_width)) + 2 * _MARGIN
    offsets = np.empty(most_rows, np.int64)
    starts = np.empty(most_rows, np.int64)
    ends = np.empty(most_rows, np.int64)
    classes = np.empty(most_rows, np.int64)
    listed = np.empty((_CLASSES, most_rows + 3 * _GROUP), np.int64)
    used = np.empty(_CLASSES, np.int64)
    texels = ground.texels
    for line in range(len(centres)):
        x = centres[line, 0] / ground.texel % texels
        y = centres[line, 1] / ground.texel % texels
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
        climb = math.floor(slope * _ONE + 0.5)

        column = int(origin + whole) % texels
        if tangent * (row_count + 2 * BLOCK) < 1.0:
            # Most rows lie alike: start at a column from which a block loads of one cache line.
            spare = column % BLOCK
            column -= spare
            origin -= spare
            count += spare
            low -= climb * spare
        cover = _Cover(low, climb, height)

        # Quarter texels by which the texels of row_0 lie ahead of those of the middle row.
        ahead = (row_0 - middle) * tangent * _CLASSES + _HALF
        placement = _Placement(
            int(row_0), downwards, column,
            math.floor(ahead * _ONE), math.floor(tangent * _CLASSES * _ONE + 0.5),
        )  # fmt: skip
        rows = _Rows(offsets, starts, ends, classes[:row_count], listed, used)
        _place_rows(texels, ground.stride, placement, rows)
        _bound_rows(cover, count, rows)
        _list_rows(count, rows)
        for cls in range(_CLASSES):
            _add_rows(texture, rows, cls, sums, totals[cls, :count])
        _add_edges(texture, cover, offsets, totals[_HALF, :count])
        if ground.averaged:
            _refine(totals, cells, refined, count - 1, height)
            _sum_cells(refined, count, integral)
        else:
            _sum_classes(totals, count, integral)

        step = 2.0 * half / lines.shape[1]
        start = (-half - (origin + 0.5 - rest)) * _CLASSES
        weight = _CLASSES * step * (height >> (POINT - WEIGHT_BITS))
        slant = tangent * _CLASSES / math.sqrt(12.0)
        edges = _Edges(start, step * _CLASSES, slant, 1.0 / weight, ground.middle)
        _read_pixels(integral, edges, values, lines[line])
        if backwards:
            _reverse(lines[line])


@njit(cache=True, nogil=True, error_model="numpy")
def _bound_rows(cover: _Cover, count: int, rows: _Rows) -> None:
    """Set which of `count` columns each row covers in full.

    Row j covers column c in full where low + climb c <= j and j + 1 <= low + climb c + height.
    """
    low, climb, height = cover
    starts, ends = rows.starts, rows.ends
    above = -low
    shorter = (1 << POINT) - height - 1
    divisor = climb
    per_row = 1 << POINT
    if climb == 0:  # all columns or none
        divisor = 1
        per_row <<= _LEVEL
        above = (above << _LEVEL) + (1 << (_LEVEL - 1))
        shorter <<= _LEVEL
    lead = shorter // divisor  # of the start before the end, and one more with a carry
    lead_rest = divisor - shorter % divisor
    for j in range(len(rows.classes)):
        at = above + per_row * j
        behind = math.floor(at / divisor) + 1  # exact, as these numbers have 40 bits
        carry = 1 if at - (behind - 1) * divisor >= lead_rest else 0
        starts[j] = max(behind + lead + carry, 0)
        ends[j] = min(behind, count)


@njit(cache=True, nogil=True)
def _list_rows(count: int, rows: _Rows) -> None:
    """List by class the rows that cover any of `count` columns in full, in whole groups.

    Groups are filled up with a row of no columns, and so is one more group of each class, for
    whoever looks ahead.
    """
    classes, starts, ends, listed = rows.classes, rows.starts, rows.ends, rows.listed
    list_0, list_1, list_2, list_3 = listed[0], listed[1], listed[2], listed[3]
    n_0, n_1, n_2, n_3 = 0, 0, 0, 0
    none = len(classes)
    for j in range(none):
        # Written to all lists, kept in one: no branch that the processor cannot foresee.
        kind = classes[j] if starts[j] < ends[j] else _CLASSES
        list_0[n_0] = list_1[n_1] = list_2[n_2] = list_3[n_3] = j
        n_0 += 1 if kind == 0 else 0
        n_1 += 1 if kind == 1 else 0
        n_2 += 1 if kind == 2 else 0
        n_3 += 1 if kind == 3 else 0
    rows.offsets[none] = 0
    starts[none] = ends[none] = count
    for cls, used in enumerate((n_0, n_1, n_2, n_3)):
        rows.used[cls] = used
        listed[cls, used : used + 3 * _GROUP] = none


@njit(cache=True, nogil=True)
def _place_rows(texels: int, stride: int, placement: _Placement, rows: _Rows) -> None:
    """Set where in the texture column 0 of each row lies, and the class of its fractional shift."""
    row_0, downwards, origin, ahead, ahead_per_row = placement
    offsets, classes = rows.offsets[: len(rows.classes)], rows.classes
    row = row_0 % texels
    if downwards:
        row = texels - 1 - row
    step = -1 if downwards else 1
    begin = 0
    while begin < len(offsets):  # up to where the texture begins anew
        stop = min(len(offsets), begin + (row + 1 if downwards else texels - row))
        here, kinds = offsets[begin:stop], classes[begin:stop]
        for j in range(len(here)):
            at = row + step * j
            # Half a texel too many, so that classes lie around zero. Rounding every row to the
            # nearest would shift many neighbours alike at small slopes; four rows rounded
            # differently even out.
            quarters = (ahead + ahead_per_row * j + _rounding(at)) >> POINT
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
    return (1 + 4 * (row & 1) + (row & 2)) << (POINT - 3)


@njit(cache=True, nogil=True)
def _add_rows(texture: Int8s, rows: _Rows, cls: int, sums: Int16s, totals: Int32s) -> None:
    """Set `totals` to the sums of a class of rows, on the scale texels x 2^WEIGHT_BITS."""
    listed, used = rows.listed[cls], rows.used[cls]
    sums[:] = 0
    for place in range(0, min(used, _SPILL), _GROUP):
        _add_four_rows(texture, rows, listed[place:], len(totals), sums)
    for c in range(len(totals)):
        totals[c] = np.int32(sums[c]) << WEIGHT_BITS
    for begin in range(_SPILL, used, _SPILL):
        sums[:] = 0
        for place in range(begin, min(used, begin + _SPILL), _GROUP):
            _add_four_rows(texture, rows, listed[place:], len(totals), sums)
        for c in range(len(totals)):
            totals[c] += np.int32(sums[c]) << WEIGHT_BITS


@njit(cache=True, nogil=True, inline="always")
def _add_four_rows(texture: Int8s, rows: _Rows, listed: Int64s, count: int, sums: Int16s) -> None:
    """Add four rows: whole blocks of what they share, their ragged ends masked."""
    offsets = _four(rows.offsets, listed, _0)
    following = _four(rows.offsets, listed, _8)
    starts = _four(rows.starts, listed, _0)
    ends = _four(rows.ends, listed, _0)
    # The first row lies the farthest left, the last one the farthest right. Always two blocks at
    # a ragged end, though one may be enough: a loop whose length changes from row to row costs
    # more than a block. What is added behind the last column does not count.
    first = starts[0] & _BLOCKS
    ragged = starts[3] > first
    inner = first + 2 * BLOCK if ragged else first
    even = ends[0] >= count
    outer = (count + BLOCK - 1 if even else ends[0]) & _BLOCKS
    within = starts[3] < inner or not ragged
    if outer < inner or not within or not (even or ends[3] < outer + 2 * BLOCK):
        for c in range(first, ends[3], BLOCK):
            add_four_between(sums, c, texture, offsets, following, (starts, ends))
        return
    if ragged:
        add_four_from(sums, first, texture, offsets, following, starts)
    if (outer - inner) & BLOCK:
        add_four(sums, inner, texture, offsets)
        inner += BLOCK
    for c in range(inner, outer, 2 * BLOCK):
        add_four_twice(sums, c, texture, offsets, following)
    if not even:
        add_four_until(sums, outer, texture, offsets, following, ends)


@njit(cache=True, nogil=True, inline="always")
def _four(numbers: Int64s, listed: Int64s, at: int) -> tuple[int, int, int, int]:
    """Return the numbers of four rows of a list."""
    return (
        numbers[np.uint64(listed[at])],
        numbers[np.uint64(listed[at + _1])],
        numbers[np.uint64(listed[at + _2])],
        numbers[np.uint64(listed[at + _3])],
    )


@njit(cache=True, nogil=True)
def _add_edges(texture: Int8s, cover: _Cover, offsets: Int64s, totals: Int32s) -> None:
    """Add the two rows that each column covers in part, to the class without a fraction."""
    low, climb, height = cover
    y = low - 1
    ahead = (LANES - 1) * climb
    for column in range(0, len(totals), LANES):
        above = y + height + 1
        if y >> POINT == (y + ahead) >> POINT and above >> POINT == (above + ahead) >> POINT:
            add_edges_alike(totals, column, cover, texture, offsets)
        else:
            add_edges(totals, column, cover, texture, offsets)
        y += LANES * climb


@njit(cache=True, nogil=True)
def _sum_classes(totals: Int32s, count: int, integral: Floats) -> None:
    before = 0.0
    for column in range(0, count, LANES):
        before = sum_classes(totals, column, before, integral)


@njit(cache=True, nogil=True)
def _sum_cells(cells: Int32s, count: int, integral: Floats) -> None:
    before = 0.0
    for column in range(0, count, LANES):
        before = sum_cells(cells, column, before, integral)


@njit(cache=True, nogil=True)
def _refine(totals: Int32s, cells: Int32s, refined: Int32s, n: int, height: int) -> None:
    """Merge classes into cells, and restore what is lost in texels that are means of finer ones.

    The integral along the line, interpolated straight between the edges of texels, lags behind
    wherever grey changes. Weights (-9, 16, 50, 16, -9) / 64 of the cells that lie -4, -2, 0, 2, 4
    quarters away take out the steps of a texel's width (their gain is 0 there) and give back what
    both averaging and steps take from a curved profile (their second moment is that of two boxes,
    negated). Sums over 655 rows times all weights fit 32 bits.
    """
    for column in range(0, n, LANES):
        merge_classes(totals, column, cells)
    spare = 0
    while height >> (POINT + spare) > _NARROW_ROWS:
        spare += 1
    if spare > 0:
        cells >>= spare
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
    if spare > 0:
        refined <<= spare


@njit(cache=True, nogil=True)
def _read_pixels(
    integral: Floats, edges: _Edges, values: Floats, line: NDArray[np.float32]
) -> None:
    """Set each pixel to the difference of the integral at its two edges.

    An edge is slanted against a row of texels, which smooths the integral by a box as wide as
    the slant. Two readings one standard deviation either side have the same second moment.
    """
    start, step, slant, scale, middle = edges
    places = (
        math.floor((start - slant) * _ONE + 0.5),
        math.floor((start + slant) * _ONE + 0.5),
        math.floor(step * _ONE * 256.0 + 0.5),
    )
    for edge in range(0, len(line) + 1, LANES):
        read_edges(integral, places, edge, len(line), values)
    scale *= 0.5
    for pixel in range(len(line)):
        line[pixel] = np.float32((values[pixel + 1] - values[pixel]) * scale) + middle


@njit(cache=True, nogil=True)
def _reverse(line: NDArray[np.float32]) -> None:
    last = len(line) - 1
    for i in range(len(line) // 2):
        line[i], line[last - i] = line[last - i], line[i]
