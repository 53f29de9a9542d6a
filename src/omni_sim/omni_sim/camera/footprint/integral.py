"""Integral of the ground texture over the footprints of a line camera's pixels, at any heading.

A footprint is a rectangle of `length` (along the camera's axis) by `width` (across), and each pixel
is a slice of it (dissertation, section 4.3.2, Figure 57). The texture is transposed if necessary,
so that its x axis is within 45 deg of the line. Then ``s = x + y tan(heading)`` is a coordinate
along the line, and in each row of texels it differs from x only by a constant shift. A line is
computed in three steps:

1. Each row is one contiguous 8-bit run, which is added to columns over `s` (SIMD, four rows at a
   time). The shift of the row is rounded to a quarter texel. The integer part of the shift moves
   the run, and the fraction selects one of four accumulators.
2. Along the two long sides, the rows that a column covers only in part are added with weights.
3. The four accumulators are merged into cells of a quarter texel. The prefix sum of the cells is
   read at the edges of the pixels, which is exact for any pixel pitch. If texels are means of finer
   texels, the cells are weighted first, to follow the gray level within a texel.

All computations except the last step use integers, so results do not depend on vectorization.
Texels are squares of constant gray level. Shifts below a quarter texel and the slant of a pixel's
edges within a texel are approximated. The error due to these approximations is larger for
footprints that are only a few rows of texels wide. `benchmarks/render_lines.py` measures the error.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_core.kernels import kernel
from omni_core.quantities import Float32Array, FloatArray, Int8Array, Int16Array, Int32Array
from omni_sim.camera.footprint import cells, rows
from omni_sim.camera.footprint.padding import LEAST_WIDTH, PaddedTexture
from omni_sim.camera.footprint.rows import Rows

_MARGIN = 8  # columns and rows added beyond the footprint


class _Scratch(NamedTuple):
    """Buffers for one line; the module `rows` explains the four classes of texel rows.

    Attributes:
        sums: sums of the rows of one class in each of c columns, shape (c,).
        totals: totals of the classes, shape (4, c).
        cells: result of `cells.merge_classes`, shape (4, c).
        refined: result of `cells.refine`, shape (4, c).
        integral: result of `cells.sum_cells`, shape (4, c).
        values: integral at the edges of the pixels, shape (pixels + 1,).
        rows: rows of texels.
    """

    sums: Int16Array
    totals: Int32Array
    cells: Int32Array
    refined: Int32Array
    integral: FloatArray
    values: FloatArray
    rows: Rows


def integrate_lines(
    texture: PaddedTexture, centers: FloatArray, length: float, width: float, pixels: int
) -> Float32Array:
    """Return the mean gray level of each pixel's footprint.

    Args:
        texture: padded texture of the ground.
        centers: center x, y of each footprint [m] and direction of its axis [rad], shape (m, 3).
        length: length of the footprint along the axis [m].
        width: width of the footprint across the axis [m], at least 10 texels.
        pixels: number of pixels per line.

    Returns:
        Gray levels, shape (m, pixels); the pixel index increases along the axis.

    Raises:
        ValueError: a pose is not finite, or the footprint exceeds the limits of the texture.
    """
    if not np.isfinite(centers).all():
        raise ValueError("a footprint's pose is not finite")
    if length > texture.reach * (1.0 + 1e-9):
        raise ValueError(f"the footprint of {length} m is longer than the reach {texture.reach} m")
    if width < LEAST_WIDTH * texture.texel:
        raise ValueError(f"the footprint of {width} m is narrower than {LEAST_WIDTH:g} texels")
    lines = np.empty((len(centers), pixels), dtype=np.float32)
    scaled = np.ascontiguousarray(centers, dtype=np.float64)
    _integrate(texture, scaled, 0.5 * length / texture.texel, 0.5 * width / texture.texel, lines)
    return lines


@kernel
def _integrate(
    ground: PaddedTexture,
    centers: FloatArray,
    half_length: float,
    half_width: float,
    lines: Float32Array,
) -> None:
    """Write the pixels of all lines; `half_length` and `half_width` are in [texels]."""
    scratch = _scratch(half_length, half_width, lines.shape[1])
    texels = ground.texels
    for line in range(len(centers)):
        x = centers[line, 0] / ground.texel % texels
        y = centers[line, 1] / ground.texel % texels
        a_x = math.cos(centers[line, 2])
        a_y = math.sin(centers[line, 2])
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
        half = (half_length, half_width)
        _integrate_line(ground, texture, (x, y, a_x, a_y), downwards, half, scratch, lines[line])
        if backwards:
            cells.reverse(lines[line])


@kernel
def _scratch(half_length: float, half_width: float, pixels: int) -> _Scratch:
    """Return the buffers for one line.

    Args:
        half_length: half the length of the footprint [texels].
        half_width: half the width of the footprint [texels].
        pixels: number of pixels per line.
    """
    room = math.ceil(2.0 * half_length * math.sqrt(2.0)) + 2 * _MARGIN
    room = (-(-room // rows.BLOCK) + 2) * rows.BLOCK
    sums = np.empty(room + rows.BLOCK, np.int16)
    most_rows = int(2.0 * (half_length + half_width)) + 2 * _MARGIN
    return _Scratch(
        sums[-sums.ctypes.data % (2 * rows.BLOCK) // 2 :][:room],  # aligned to a cache line
        np.empty((rows.CLASSES, room), np.int32),
        np.empty((rows.CLASSES, room), np.int32),
        np.empty((rows.CLASSES, room), np.int32),
        np.empty((rows.CLASSES, room)),
        np.empty(pixels + 1),
        Rows(
            np.empty(most_rows, np.int64),
            np.empty(most_rows, np.int64),
            np.empty(most_rows, np.int64),
            np.empty(most_rows, np.int64),
            np.empty((rows.CLASSES, most_rows + rows.GROUP), np.int64),
            np.empty(rows.CLASSES, np.int64),
        ),
    )


@kernel
def _integrate_line(
    ground: PaddedTexture,
    texture: Int8Array,
    axis: tuple[float, float, float, float],
    downwards: bool,
    half_size: tuple[float, float],
    scratch: _Scratch,
    line: Float32Array,
) -> None:
    """Compute the pixels of one line.

    Args:
        ground: padded texture of the ground.
        texture: rows of the ground, or its columns if the line is closer to the y axis.
        axis: center x, y [texels] and direction cosines of the line in the axes of `texture`. The
            direction is within 45 deg of the x axis, and its y component is not negative.
        downwards: whether y is mirrored.
        half_size: half the length and width of the footprint [texels].
        scratch: scratch buffers.
        line: output, the gray levels of the pixels.
    """
    x, y, a_x, a_y = axis
    tangent = a_y / a_x
    slope = a_x * a_y  # rows by which a long side of the footprint rises per column
    reach = half_size[1] * a_x
    half = half_size[0] / a_x  # half length along s [texels]
    # Columns are aligned with the texels of the middle row: column c starts at s = origin + c -
    # rest.
    middle = math.floor(y)
    x -= (middle + 0.5 - y) * tangent
    whole = math.floor(x)
    rest = x - whole
    origin = math.floor(-half) - 2
    count = math.ceil(half) + 4 - origin
    row_0 = math.floor(y - reach - half_size[0] * a_y) - 2
    row_count = math.ceil(y + reach + half_size[0] * a_y) + 3 - int(row_0)

    # Row numbers are relative to row_0.
    low = math.floor((y - reach + slope * (origin - rest + 0.5) - row_0) * rows.ONE + 0.5)
    height = math.floor(2.0 * reach * rows.ONE + 0.5)
    climb = math.floor(slope * rows.ONE + 0.5)

    column = int(origin + whole) % ground.texels
    if tangent * (row_count + 2 * rows.BLOCK) < 1.0:
        # Most rows have the same shift, so blocks start where they match the cache lines.
        spare = column % rows.BLOCK
        column -= spare
        origin -= spare
        count += spare
        low -= climb * spare

    # Shift of the texels of row_0 relative to those of the middle row [quarter texels].
    ahead = math.floor(((row_0 - middle) * tangent * rows.CLASSES + rows.HALF) * rows.ONE)
    per_row = math.floor(tangent * rows.CLASSES * rows.ONE + 0.5)
    placement = rows.Placement(int(row_0), downwards, column, ahead, per_row)
    cover = rows.Cover(low, climb, height)
    _add_rows(ground, texture, placement, cover, (row_count, count), scratch)
    _read_line(ground, scratch, (count, height), tangent, (half, origin + 0.5 - rest), line)


@kernel
def _add_rows(
    ground: PaddedTexture,
    texture: Int8Array,
    placement: rows.Placement,
    cover: rows.Cover,
    counts: tuple[int, int],
    scratch: _Scratch,
) -> None:
    """Add the rows of texels under a line to the totals of the classes, `scratch.totals`.

    Args:
        ground: padded texture of the ground.
        texture: rows of the ground, or its columns if the line is closer to the y axis.
        placement: placement of the rows.
        cover: rows that each column covers.
        counts: number of rows and number of columns.
        scratch: scratch buffers.
    """
    row_count, count = counts
    room = scratch.rows
    placed = Rows(
        room.offsets, room.starts, room.ends, room.classes[:row_count], room.listed, room.used
    )
    rows.place_rows(ground.texels, ground.stride, placement, placed)
    rows.bound_rows(cover, count, placed)
    rows.list_rows(count, placed)
    for cls in range(rows.CLASSES):
        rows.add_rows(texture, placed, cls, scratch.sums, scratch.totals[cls, :count])
    rows.add_edges(texture, cover, placed.offsets, scratch.totals[rows.HALF, :count])


@kernel
def _read_line(
    ground: PaddedTexture,
    scratch: _Scratch,
    size: tuple[int, int],
    tangent: float,
    span: tuple[float, float],
    line: Float32Array,
) -> None:
    """Compute the pixels of a line from the totals of the four classes of texel rows.

    Args:
        ground: padded texture of the ground.
        scratch: scratch buffers, which contain the totals.
        size: number of columns; height of the footprint in each column [texels, fixed point].
        tangent: tangent of the angle between the line and the rows of texels [1].
        span: half the length of the footprint; start of the first cell; both along s [texels].
        line: output, the gray levels of the pixels.
    """
    count, height = size
    half, first = span
    integrated = scratch.cells
    cells.merge_classes(scratch.totals, count - 1, scratch.cells)
    if ground.averaged:
        cells.refine(scratch.cells, scratch.refined, count - 1, height)
        integrated = scratch.refined
    cells.sum_cells(integrated, count, scratch.integral)
    step = 2.0 * half / len(line)
    start = (-half - first) * rows.CLASSES
    weight = rows.CLASSES * step * (height >> (rows.POINT - rows.WEIGHT_BITS))
    slant = tangent * rows.CLASSES / math.sqrt(12.0)
    edges = cells.Edges(start, step * rows.CLASSES, slant, 1.0 / weight, np.float32(ground.middle))
    cells.read_pixels(scratch.integral, edges, scratch.values, line)
