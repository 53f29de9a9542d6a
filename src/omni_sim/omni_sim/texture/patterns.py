"""Compiled patterns of which ground textures are composed.

A picture is one period of a texture. Lengths are in periods or in cells of a pattern's own grid,
never in texels. A pattern can draw each band of texel rows separately, and the result does not
depend on the division into bands. A picture of any resolution therefore needs memory only for its
gray levels, and bands can be drawn in parallel.
"""

import dataclasses
import math
from typing import Protocol

import numpy as np

from omni_core.kernels import kernel
from omni_core.quantities import Float32Array, FloatArray, IntArray


class Pattern(Protocol):
    """Interface of a pattern, which is one layer of a picture."""

    def draw(self, band: Float32Array, first_row: int) -> None:
        """Draw the pattern over the layers below.

        Args:
            band: some rows of the picture, changed in place, shape (rows, texels per period).
            first_row: index of the first of these rows in the picture.
        """


@dataclasses.dataclass(frozen=True, eq=False)
class Plain:
    """Pattern with the same gray level everywhere.

    Attributes:
        gray: gray level.
    """

    gray: float

    def draw(self, band: Float32Array, first_row: int) -> None:  # noqa: ARG002
        """Fill the band with the gray level."""
        band[:] = self.gray


@dataclasses.dataclass(frozen=True, eq=False)
class Cells:
    """Voronoi cells of constant gray level, with soft dark borders between them.

    Lengths are in cells of a grid that has c x c cells per period.

    Attributes:
        points: position of one point within each cell of the grid [cells], shape (c, c, 2).
        gray: gray level of each point's Voronoi cell, shape (c, c).
        border_gray: gray level of a border, halfway between two points.
        border: distance from the middle of a border at which the border has faded [cells].
        warp: displacement of x and y that bends the borders [cells], at the nodes of a lattice,
            shape (2, w, w).
        darken: whether to draw only where the pattern is darker than the layers below.
    """

    points: Float32Array
    gray: Float32Array
    border_gray: float
    border: float
    warp: Float32Array
    darken: bool = False

    def draw(self, band: Float32Array, first_row: int) -> None:
        """Draw the cells and their borders."""
        warped = bool(self.warp.any())
        shift = np.zeros((2, *band.shape) if warped else (2, 1, 1), np.float32)
        if warped:
            Noise(self.warp[0]).draw(shift[0], first_row)
            Noise(self.warp[1]).draw(shift[1], first_row)
        target = np.empty_like(band) if self.darken else band
        borders = np.float32(self.border_gray), np.float32(self.border)
        _voronoi(target, first_row, self.points, self.gray, borders, warped, shift)
        if self.darken:
            np.minimum(band, target, out=band)


@dataclasses.dataclass(frozen=True, eq=False)
class Noise:
    """Smooth noise: values on a lattice, interpolated by the cubic 3 t^2 - 2 t^3.

    The noise is added to the layers below.

    Attributes:
        lattice: values at the nodes [gray levels], shape (nodes along y, nodes along x).
    """

    lattice: Float32Array

    def draw(self, band: Float32Array, first_row: int) -> None:
        """Add the noise to the layers below."""
        texels = band.shape[1]
        row, row_blend = _places(texels, len(self.lattice))
        column, column_blend = _places(texels, self.lattice.shape[1])
        rows = slice(first_row, first_row + len(band))
        _add_noise(band, self.lattice, row[rows], row_blend[rows], column, column_blend)


@dataclasses.dataclass(frozen=True, eq=False)
class Leaves:
    """Ellipses painted on top of each other.

    Attributes:
        leaves: rows of center x, y [periods], long semi-axis [periods], ratio of the semi-axes [1],
            direction of the long axis [rad] and gray level, shape (n, 6); the first ellipse is
            lowest.
        softness: width of the transition at the edge [periods].
    """

    leaves: FloatArray
    softness: float

    def draw(self, band: Float32Array, first_row: int) -> None:
        """Paint the ellipses over the layers below."""
        _dead_leaves(band, first_row, self.leaves, self.softness)


@dataclasses.dataclass(frozen=True, eq=False)
class Rings:
    """Bent lines along x, like the growth rings of a board, with gray levels as a function of y.

    Attributes:
        profile: gray levels over one period in y, interpolated linearly.
        bend: layers of `Noise` whose sum displaces the profile along y [periods].
    """

    profile: Float32Array
    bend: tuple[Noise, ...]

    def draw(self, band: Float32Array, first_row: int) -> None:
        """Draw the bent lines over the layers below."""
        shift = np.zeros(band.shape, np.float32)
        for noise in self.bend:
            noise.draw(shift, first_row)
        _bent(band, first_row, self.profile, shift)


@dataclasses.dataclass(frozen=True, eq=False)
class Bond:
    """Rows of rectangles along x with joints between them, such as bricks or boards.

    Attributes:
        gray: gray level of each rectangle, shape (rows, columns); with a single column, each row
            is an endless board.
        joint_gray: gray level of the joints.
        joint: width of the joints [periods].
        softness: width of the transition at the edges of the joints [periods].
        staggered: whether every other row is shifted by half a rectangle.
    """

    gray: Float32Array
    joint_gray: float
    joint: float
    softness: float
    staggered: bool

    def draw(self, band: Float32Array, first_row: int) -> None:
        """Draw the rectangles and joints over the layers below."""
        rows, columns = self.gray.shape
        texels = band.shape[1]
        y = (np.arange(first_row, first_row + len(band), dtype=np.float32) + 0.5) / texels * rows
        row = np.minimum(y.astype(np.int64), rows - 1)
        to_edge = (0.5 - np.abs(y - row - 0.5))[:, None] / rows
        x = (np.arange(texels, dtype=np.float32) + 0.5) / texels * columns
        x = (x + 0.5 * self.staggered * (row % 2)[:, None]) % columns
        column = np.minimum(x.astype(np.int64), columns - 1)
        if columns > 1:
            to_edge = np.minimum(to_edge, (0.5 - np.abs(x - column - 0.5)) / columns)
        inside = np.clip((to_edge - 0.5 * self.joint) / self.softness + 0.5, 0.0, 1.0)
        band[:] = self.joint_gray + (self.gray[row[:, None], column] - self.joint_gray) * inside


@dataclasses.dataclass(frozen=True, eq=False)
class Added:
    """Wrapper of a pattern that is added to the layers below instead of replacing them.

    Attributes:
        pattern: pattern to add.
    """

    pattern: Pattern

    def draw(self, band: Float32Array, first_row: int) -> None:
        """Add the pattern to the layers below."""
        added = np.zeros_like(band)
        self.pattern.draw(added, first_row)
        band += added


@dataclasses.dataclass(frozen=True, eq=False)
class Studs:
    """Square studs on a grid, with rounded corners and beveled edges, lit from the upper left.

    The grid has c x c cells per period, one for each stud.

    Attributes:
        gray: gray level of the top of each stud, shape (c, c).
        groove_gray: gray level between the studs.
        top: half the edge length of a stud's flat top [cells].
        bevel: width of a stud's sloping edge [cells].
        corner: radius of a stud's corners [cells].
        glare: increase of the gray level at edges that face the light, and decrease of the gray
            level at the other edges.
    """

    gray: Float32Array
    groove_gray: float
    top: float
    bevel: float
    corner: float
    glare: float

    def draw(self, band: Float32Array, first_row: int) -> None:
        """Draw the studs over the layers below."""
        cells, texels = len(self.gray), band.shape[1]
        y = (np.arange(first_row, first_row + len(band), dtype=np.float32) + 0.5) * (cells / texels)
        x = (np.arange(texels, dtype=np.float32) + 0.5) * (cells / texels)
        u, v = x[None, :] % 1.0 - 0.5, y[:, None] % 1.0 - 0.5
        inner = self.top - self.corner
        out_x, out_y = np.maximum(np.abs(u) - inner, 0.0), np.maximum(np.abs(v) - inner, 0.0)
        outside = np.hypot(out_x, out_y)
        t = np.clip((outside - self.corner) / self.bevel, 0.0, 1.0)
        level = t * t * (3.0 - 2.0 * t)
        slope = 4.0 * t * (1.0 - t) / np.maximum(outside, 1e-9)
        lit = -(np.sign(u) * out_x + np.sign(v) * out_y) * slope
        tops = self.gray[np.ix_(y.astype(np.int64), x.astype(np.int64))]
        band[:] = tops + (self.groove_gray - tops) * level + self.glare * math.sqrt(0.5) * lit


def _places(texels: int, nodes: int) -> tuple[IntArray, Float32Array]:
    """Return for each texel the lattice node before it, and the weight of the next node [1].

    Args:
        texels: number of texels per period.
        nodes: number of lattice nodes per period.

    Returns:
        Indices of the nodes, shape (texels,); weights, shape (texels,).
    """
    place = (np.arange(texels) + 0.5) * (nodes / texels)
    node = place.astype(np.int64)
    t = place - node
    return node, (t * t * (3.0 - 2.0 * t)).astype(np.float32)


@kernel
def _voronoi(
    band: Float32Array,
    first_row: int,
    points: Float32Array,
    gray: Float32Array,
    borders: tuple[np.float32, np.float32],
    warped: bool,
    shift: Float32Array,
) -> None:
    """Draw Voronoi cells with borders to some rows of the picture.

    Args:
        band: these rows, overwritten, shape (rows, texels per period).
        first_row: index of the first of these rows in the picture.
        points: as in `Cells`.
        gray: as in `Cells`.
        borders: `border_gray` and `border` of `Cells`.
        warped: whether `shift` is added to the positions of the texels.
        shift: displacement of each texel along x and y [cells], shape (2, rows, texels).
    """
    border_gray, border = borders
    texels = band.shape[1]
    cells = len(points)
    scale = np.float32(cells) / np.float32(texels)
    half = np.float32(0.5)
    for row in range(len(band)):
        for column in range(texels):
            x = (np.float32(column) + half) * scale
            y = (np.float32(first_row + row) + half) * scale
            if warped:
                x += shift[0, row, column]
                y += shift[1, row, column]
            i_0 = math.floor(x)
            j_0 = math.floor(y)
            nearest = np.float32(1e9)
            second = np.float32(1e9)
            n_x = n_y = s_x = s_y = np.float32(0.0)
            shade = np.float32(0.0)
            for j in range(j_0 - 1, j_0 + 2):
                j_in = j % cells  # if there are few cells, some are visited twice
                for i in range(i_0 - 1, i_0 + 2):
                    i_in = i % cells
                    d_x = np.float32(i) + points[j_in, i_in, 0] - x
                    d_y = np.float32(j) + points[j_in, i_in, 1] - y
                    square = d_x * d_x + d_y * d_y
                    if square < nearest:
                        second, s_x, s_y = nearest, n_x, n_y
                        nearest, n_x, n_y = square, d_x, d_y
                        shade = gray[j_in, i_in]
                    elif square < second:
                        second, s_x, s_y = square, d_x, d_y
            # Distance from the perpendicular bisector of the two nearest points.
            between = math.sqrt((s_x - n_x) ** 2 + (s_y - n_y) ** 2)
            t = min(half * (second - nearest) / (between * border), np.float32(1.0))
            t = t * t * (np.float32(3.0) - np.float32(2.0) * t)
            band[row, column] = border_gray + (shade - border_gray) * t


@kernel
def _add_noise(
    band: Float32Array,
    lattice: Float32Array,
    row_node: IntArray,
    row_blend: Float32Array,
    column_node: IntArray,
    column_blend: Float32Array,
) -> None:
    """Add noise, interpolated between lattice nodes, to some rows of the picture.

    Args:
        band: these rows, changed in place, shape (rows, texels per period).
        lattice: values at the nodes [gray levels], shape (nodes along y, nodes along x).
        row_node: node before each row, from `_places`, shape (rows,).
        row_blend: weight of the next node of each row [1], shape (rows,).
        column_node: node before each column, shape (texels,).
        column_blend: weight of the next node of each column [1], shape (texels,).
    """
    rows, cells = lattice.shape
    mixed = np.empty(cells + 1, np.float32)
    for row in range(len(band)):
        upper = lattice[row_node[row]]
        lower = lattice[(row_node[row] + 1) % rows]
        for i in range(cells):
            mixed[i] = upper[i] + (lower[i] - upper[i]) * row_blend[row]
        mixed[cells] = mixed[0]
        for column in range(len(column_node)):
            i = column_node[column]
            band[row, column] += mixed[i] + (mixed[i + 1] - mixed[i]) * column_blend[column]


@kernel
def _bent(band: Float32Array, first_row: int, profile: Float32Array, shift: Float32Array) -> None:
    """Set each texel to the gray level that a profile has at the texel's displaced position y.

    Args:
        band: some rows of the picture, changed in place, shape (rows, texels per period).
        first_row: index of the first of these rows in the picture.
        profile: gray levels over one period in y, shape (p,).
        shift: displacement of each texel along y [periods], shape (rows, texels per period).
    """
    texels = band.shape[1]
    count = len(profile)
    for row in range(len(band)):
        y = (first_row + row + 0.5) / texels
        for column in range(texels):
            place = (y + shift[row, column]) * count
            node = math.floor(place)
            i = node % count
            j = i + 1 if i + 1 < count else 0
            band[row, column] = profile[i] + (profile[j] - profile[i]) * (place - node)


@kernel
def _dead_leaves(band: Float32Array, first_row: int, leaves: FloatArray, softness: float) -> None:
    """Paint ellipses over some rows of the picture.

    The arguments are those of `_bent` and the attributes of `Leaves`.
    """
    texels = band.shape[1]
    rows = len(band)
    for leaf in range(len(leaves)):
        center_x = leaves[leaf, 0] * texels
        center_y = leaves[leaf, 1] * texels
        radius = leaves[leaf, 2] * texels
        ratio = leaves[leaf, 3]
        cosine = math.cos(leaves[leaf, 4])
        sine = math.sin(leaves[leaf, 4])
        gray = leaves[leaf, 5]
        steepness = radius * ratio / (softness * texels)
        rim = radius + softness * texels
        for j in range(math.floor(center_y - rim), math.ceil(center_y + rim) + 1):
            row = j % texels - first_row
            if row < 0 or row >= rows:
                continue
            d_y = j + 0.5 - center_y
            chord = rim * rim - d_y * d_y
            if chord <= 0.0:
                continue
            half = math.sqrt(chord)
            for i in range(math.floor(center_x - half), math.ceil(center_x + half) + 1):
                d_x = i + 0.5 - center_x
                along = (d_x * cosine + d_y * sine) / radius
                across = (d_y * cosine - d_x * sine) / (radius * ratio)
                cover = (1.0 - math.sqrt(along * along + across * across)) * steepness + 0.5
                if cover <= 0.0:
                    continue
                column = i - texels if i >= texels else (i + texels if i < 0 else i)
                under = band[row, column]
                band[row, column] = under + (gray - under) * min(cover, 1.0)
