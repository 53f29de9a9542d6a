"""Compiled patterns that ground textures are made of; each is periodic over the picture.

Lengths are in periods or in cells of a pattern's own grid, never in texels.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float32]


def voronoi(
    texels: int,
    points: Floats,
    grey: Floats,
    border_grey: float,
    border: float,
    warp: Floats,
) -> Floats:
    """Return cells of constant grey around points, with soft dark borders between them.

    Args:
        texels: edge of the picture.
        points: one point in every cell of a grid, as place within the cell, shape (c, c, 2).
        grey: grey level of each point's cell, shape (c, c).
        border_grey: grey level half way between two points.
        border: distance from there at which the border has faded [cells].
        warp: displacement of x and y that bends the borders [cells], shape (2, w, w).
    """
    picture = np.empty((texels, texels), np.float32)
    shift = np.zeros((2, texels, texels) if warp.any() else (2, 1, 1), np.float32)
    if warp.any():
        add_noise(shift[0], warp[0])
        add_noise(shift[1], warp[1])
    _voronoi(picture, points, grey, np.float32(border_grey), np.float32(border), shift)
    return picture


def add_noise(picture: Floats, lattice: Floats) -> None:
    """Add a lattice of values, interpolated by the cubic 3 t^2 - 2 t^3, to a square picture."""
    place = (np.arange(len(picture)) + 0.5) * (len(lattice) / len(picture))
    node = place.astype(np.int64)
    t = place - node
    _add_noise(picture, lattice, node, (t * t * (3.0 - 2.0 * t)).astype(np.float32))


def dead_leaves(picture: Floats, leaves: NDArray[np.float64], softness: float) -> None:
    """Paint ellipses one over the other.

    Args:
        picture: what they are painted on.
        leaves: rows of centre x, y [periods], long half axis [periods], axis ratio, direction of
            the long axis [rad], grey level; the first one lies lowest.
        softness: width of the transition at the edge [periods].
    """
    _dead_leaves(picture, leaves, softness)


@njit(cache=True, nogil=True)
def _voronoi(
    picture: Floats,
    points: Floats,
    grey: Floats,
    border_grey: np.float32,
    border: np.float32,
    shift: Floats,
) -> None:
    texels = len(picture)
    cells = len(points)
    warped = shift.shape[1] == texels
    scale = np.float32(cells) / np.float32(texels)
    half = np.float32(0.5)
    for row in range(texels):
        for column in range(texels):
            x = (np.float32(column) + half) * scale
            y = (np.float32(row) + half) * scale
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
                j_in = j + cells if j < 0 else (j - cells if j >= cells else j)
                for i in range(i_0 - 1, i_0 + 2):
                    i_in = i + cells if i < 0 else (i - cells if i >= cells else i)
                    d_x = np.float32(i) + points[j_in, i_in, 0] - x
                    d_y = np.float32(j) + points[j_in, i_in, 1] - y
                    square = d_x * d_x + d_y * d_y
                    if square < nearest:
                        second, s_x, s_y = nearest, n_x, n_y
                        nearest, n_x, n_y = square, d_x, d_y
                        shade = grey[j_in, i_in]
                    elif square < second:
                        second, s_x, s_y = square, d_x, d_y
            # Distance from the perpendicular bisector of the two nearest points.
            between = math.sqrt((s_x - n_x) ** 2 + (s_y - n_y) ** 2)
            t = min(half * (second - nearest) / (between * border), np.float32(1.0))
            t = t * t * (np.float32(3.0) - np.float32(2.0) * t)
            picture[row, column] = border_grey + (shade - border_grey) * t


@njit(cache=True, nogil=True)
def _add_noise(picture: Floats, lattice: Floats, node: NDArray[np.int64], blend: Floats) -> None:
    cells = len(lattice)
    mixed = np.empty(cells + 1, np.float32)
    for row in range(len(picture)):
        upper = lattice[node[row]]
        lower = lattice[(node[row] + 1) % cells]
        for i in range(cells):
            mixed[i] = upper[i] + (lower[i] - upper[i]) * blend[row]
        mixed[cells] = mixed[0]
        for column in range(len(node)):
            i = node[column]
            picture[row, column] += mixed[i] + (mixed[i + 1] - mixed[i]) * blend[column]


@njit(cache=True, nogil=True)
def _dead_leaves(picture: Floats, leaves: NDArray[np.float64], softness: float) -> None:
    texels = len(picture)
    for leaf in range(len(leaves)):
        centre_x = leaves[leaf, 0] * texels
        centre_y = leaves[leaf, 1] * texels
        radius = leaves[leaf, 2] * texels
        ratio = leaves[leaf, 3]
        cosine = math.cos(leaves[leaf, 4])
        sine = math.sin(leaves[leaf, 4])
        grey = leaves[leaf, 5]
        steepness = radius * ratio / (softness * texels)
        rim = radius + softness * texels
        for j in range(math.floor(centre_y - rim), math.ceil(centre_y + rim) + 1):
            row = j % texels
            d_y = j + 0.5 - centre_y
            chord = rim * rim - d_y * d_y
            if chord <= 0.0:
                continue
            half = math.sqrt(chord)
            for i in range(math.floor(centre_x - half), math.ceil(centre_x + half) + 1):
                d_x = i + 0.5 - centre_x
                along = (d_x * cosine + d_y * sine) / radius
                across = (d_y * cosine - d_x * sine) / (radius * ratio)
                cover = (1.0 - math.sqrt(along * along + across * across)) * steepness + 0.5
                if cover <= 0.0:
                    continue
                column = i - texels if i >= texels else (i + texels if i < 0 else i)
                under = picture[row, column]
                picture[row, column] = under + (grey - under) * min(cover, 1.0)
