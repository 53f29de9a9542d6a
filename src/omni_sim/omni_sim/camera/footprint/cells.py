"""Conversion of the sums of texel rows to pixels, by an integral over cells of a quarter texel."""

import math
from typing import NamedTuple

import numpy as np

from omni_core.kernels import kernel, lean_inline
from omni_core.quantities import Float32Array, FloatArray, Int32Array
from omni_sim.camera.footprint.rows import CLASSES, HALF, ONE, POINT

_NARROW_ROWS = 640  # rows whose sums, times the weights of `refine`, fit into 32 bits (up to 655)
_1 = np.uint64(1)


class Edges(NamedTuple):
    """Positions of the pixel edges along the integral, and scale of the resulting gray levels.

    Attributes:
        start: position of the first edge [cells].
        step: distance between two edges [cells].
        slant: standard deviation of the position of an edge within a row of texels, which the edge
            crosses obliquely [cells].
        scale: factor from the integral between two edges to a gray level.
        middle: gray level that is stored as 0.
    """

    start: float
    step: float
    slant: float
    scale: float
    middle: np.float32


@kernel
def merge_classes(totals: Int32Array, count: int, cells: Int32Array) -> None:
    """Merge the row sums of the four classes into cells of a quarter texel.

    The module `rows` explains the classes. Along the line, column c of class k begins at
    ``c + (k - 2)/4`` [texels], and cell ``cells[q, c]`` begins at ``c + (2 + q)/4``. The cell
    therefore contains column c + 1 of the classes 0 to q, and column c of the other classes.

    Args:
        totals: sum of the rows of each class in each column, shape (4, at least count + 1).
        count: number of columns of cells.
        cells: output, shape (4, at least count).
    """
    t_0, t_1, t_2, t_3 = totals[0], totals[1], totals[2], totals[3]
    into = cells[0]
    for c in range(np.uint64(count)):
        into[c] = np.int32(t_0[c + _1] + t_1[c] + t_2[c] + t_3[c])
    for q in range(1, CLASSES):  # loops over few arrays can be vectorized
        before, own, into = cells[q - 1], totals[q], cells[q]
        for c in range(np.uint64(count)):
            into[c] = np.int32(before[c] + own[c + _1] - own[c])


@kernel
def refine(cells: Int32Array, refined: Int32Array, n: int, height: int) -> None:
    """Compensate for the blur that the texels of a coarse texture cause.

    Each cell is replaced by a weighted sum of the cells at a distance of -4, -2, 0, 2 and 4
    quarter texels, with the weights (-9, 16, 50, 16, -9) / 64. The weights have no gain at a period
    of one texel, so they remove the steps between texels. Their second moment is minus that of two
    boxes as wide as a texel. One box compensates for the averaging within a texel, the other for
    the constant gray level of a texel.

    Args:
        cells: result of `merge_classes`; changed in place if the footprint has many rows.
        refined: output, the weighted cells, in the layout of `cells`.
        n: number of columns of cells.
        height: height of the footprint across the line [rows, fixed point].
    """
    spare = 0
    while height >> (POINT + spare) > _NARROW_ROWS:
        spare += 1
    if spare > 0:
        cells >>= spare
    for q in range(CLASSES):
        other = cells[(q + HALF) % CLASSES]
        ahead = q // HALF
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


@kernel
def sum_cells(cells: Int32Array, count: int, integral: FloatArray) -> None:
    """Set ``integral[q, c]`` to the sum of all cells before cell q of column c, for c < `count`.

    All sums are integers, even if they are stored as doubles, so they are the same on every
    processor.
    """
    c_0, c_1, c_2, c_3 = cells[0], cells[1], cells[2], cells[3]
    into = integral[0]
    total = 0
    for c in range(np.uint64(count)):
        into[c] = total
        total += np.int64(c_0[c]) + c_1[c] + c_2[c] + c_3[c]
    for q in range(1, CLASSES):
        before, cell, into = integral[q - 1], cells[q - 1], integral[q]
        for c in range(np.uint64(count)):
            into[c] = before[c] + cell[c]


@kernel
def read_pixels(integral: FloatArray, edges: Edges, values: FloatArray, line: Float32Array) -> None:
    """Set each pixel to the difference of the integral between its two edges.

    An edge that crosses a row of texels obliquely covers a short range of positions. At such
    an edge, the mean of the integral over this range is used. It is approximated by the mean of two
    values, one standard deviation before and after the middle of the range.

    Args:
        integral: result of `sum_cells`, shape (4, columns).
        edges: positions of the pixel edges.
        values: buffer for the integral at the edges, shape (pixels + 1,).
        line: output, the gray levels of the pixels, shape (pixels,).
    """
    start, step, slant, scale, middle = edges
    first = math.floor((start - slant) * ONE + 0.5)
    second = math.floor((start + slant) * ONE + 0.5)
    advance = math.floor(step * ONE * 256.0 + 0.5)
    for edge in range(len(line) + 1):
        moved = (advance * edge) >> 8
        values[edge] = _reading(integral, first + moved) + _reading(integral, second + moved)
    scale *= 0.5
    for pixel in range(len(line)):
        line[pixel] = np.float32((values[pixel + 1] - values[pixel]) * scale) + middle


@lean_inline
def _reading(integral: FloatArray, at: int) -> float:
    """Return the integral at a position [cells, fixed point], interpolated linearly."""
    cell = at >> POINT
    following = cell + 1
    low = integral[np.uint64(cell & 3), np.uint64(cell >> 2)]
    high = integral[np.uint64(following & 3), np.uint64(following >> 2)]
    value: float = high - (1.0 - (at & (ONE - 1)) * (1.0 / ONE)) * (high - low)
    return value


@kernel
def reverse(line: Float32Array) -> None:
    """Reverse a line in place."""
    last = len(line) - 1
    for i in range(len(line) // 2):
        line[i], line[last - i] = line[last - i], line[i]
