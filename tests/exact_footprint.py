"""The exact integral that the line camera approximates: each texel is clipped to each pixel.

It is much slower than the integral of the simulator. Tests and the benchmark of the
line cameras use it as the reference.
"""

import math

import numpy as np
from numpy.typing import NDArray

from omni_core.kernels import njit


def integrate_exactly(
    texture: NDArray[np.uint8],
    size: float,
    center: tuple[float, float, float],
    length: float,
    width: float,
    pixels: int,
) -> NDArray[np.float64]:
    """Return the mean of a periodic texture over each pixel's rotated rectangle.

    Args:
        texture: gray levels of shape (n, n), row index along y; texels are constant squares.
        size: period [m].
        center: footprint center x, y [m] and direction of its axis [rad].
        length: footprint along the axis [m].
        width: footprint across the axis [m].
        pixels: pixels of the line.

    Returns:
        Gray levels of shape (pixels,).
    """
    line = np.empty(pixels)
    texel = size / len(texture)
    x, y, heading = center
    _integrate(
        texture, x / texel, y / texel, heading, 0.5 * length / texel, 0.5 * width / texel, line
    )
    return line


@njit(cache=True)
def _integrate(
    texture: NDArray[np.uint8],
    x: float,
    y: float,
    heading: float,
    half_length: float,
    half_width: float,
    line: NDArray[np.float64],
) -> None:
    n = len(texture)
    a_x, a_y = math.cos(heading), math.sin(heading)
    pitch = 2.0 * half_length / len(line)
    quad, scratch = np.empty((4, 2)), np.empty((2, 16, 2))
    for pixel in range(len(line)):
        u = -half_length + pixel * pitch
        for corner in range(4):
            along = u + (pitch if corner in (1, 2) else 0.0)
            across = half_width if corner >= 2 else -half_width
            quad[corner, 0] = x + along * a_x - across * a_y
            quad[corner, 1] = y + along * a_y + across * a_x
        lowest, highest = np.inf, -np.inf
        for corner in range(4):
            lowest, highest = min(lowest, quad[corner, 1]), max(highest, quad[corner, 1])
        total = 0.0
        for j in range(math.floor(lowest), math.floor(highest) + 1):
            left, right = _extent(quad, float(j))
            for i in range(math.floor(left), math.floor(right) + 1):
                total += _overlap(quad, float(i), float(j), scratch) * texture[j % n, i % n]
        line[pixel] = total / (pitch * 2.0 * half_width)


@njit(cache=True)
def _extent(quad: NDArray[np.float64], j: float) -> tuple[float, float]:
    """Return the smallest and largest x of the quadrangle within the row j <= y <= j + 1."""
    left, right = np.inf, -np.inf
    for corner in range(4):
        x_0, y_0 = quad[corner, 0], quad[corner, 1]
        x_1, y_1 = quad[(corner + 1) % 4, 0], quad[(corner + 1) % 4, 1]
        for y in (min(max(y_0, j), j + 1.0), min(max(y_1, j), j + 1.0)):
            if min(y_0, y_1) <= y <= max(y_0, y_1):
                x = x_0 if y_0 == y_1 else x_0 + (y - y_0) / (y_1 - y_0) * (x_1 - x_0)
                left, right = min(left, x), max(right, x)
                if y_0 == y_1:
                    left, right = min(left, x_1), max(right, x_1)
    return left, right


@njit(cache=True)
def _overlap(quad: NDArray[np.float64], i: float, j: float, scratch: NDArray[np.float64]) -> float:
    """Return the area that the quadrangle shares with a texel (Sutherland-Hodgman, shoelace)."""
    polygon, clipped = scratch[0], scratch[1]
    n = 4
    for corner in range(4):
        polygon[corner, 0] = quad[corner, 0] - i
        polygon[corner, 1] = quad[corner, 1] - j
    for side in range(4):
        axis, upper = side // 2, side % 2 == 1
        kept = 0
        for p in range(n):
            q = (p + 1) % n
            d_p = 1.0 - polygon[p, axis] if upper else polygon[p, axis]
            d_q = 1.0 - polygon[q, axis] if upper else polygon[q, axis]
            if d_p >= 0.0:
                for k in range(2):
                    clipped[kept, k] = polygon[p, k]
                kept += 1
            if (d_p >= 0.0) != (d_q >= 0.0):
                share = d_p / (d_p - d_q)
                for k in range(2):
                    clipped[kept, k] = polygon[p, k] + share * (polygon[q, k] - polygon[p, k])
                kept += 1
        n = kept
        polygon, clipped = clipped, polygon
    area = 0.0
    for p in range(n):
        q = (p + 1) % n
        area += polygon[p, 0] * polygon[q, 1] - polygon[p, 1] * polygon[q, 0]
    return 0.5 * abs(area)
