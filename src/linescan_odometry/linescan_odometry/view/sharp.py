"""The fine detail of lines, in which shadows and uneven light have no part.

The edge of a shadow that runs through the view, or light that changes along it, has more contrast
than most grounds, and a match follows it. But it is smooth: the second difference of means over a
few pixels keeps the grain of a ground, and nothing of a ramp of light. Where that detail moves
otherwise than the lines as a whole, two things move in the view, and the ground is the finer one.
"""

from __future__ import annotations

import numpy as np

from linescan_odometry.measurements import Lines

_RANGE = 30000.0  # of 16 bit to either side
_CLIPPED = 4.0  # standard deviations: single pixels and edges do not rule a line


def steps(pixels: int) -> tuple[int, int]:
    """Return the numbers of pixels of the means, fine and coarse, for lines of n pixels."""
    fine = 4 if pixels > 512 else 2
    return fine, max(2 * fine, pixels // 100)


def sharp_pixels(pixels: int, step: int) -> int:
    """Return how many pixels are left of n."""
    return pixels - 3 * step + 1


def sharpened(lines: Lines, step: int) -> Lines:
    """Return the fine detail of lines, 16 bit, shape (m, `sharp_pixels`).

    Args:
        lines: shape (m, n).
        step: number of pixels of the means that are compared.
    """
    s = step
    sums = np.zeros((len(lines), lines.shape[1] + 1), np.float32)
    np.cumsum(lines, axis=1, dtype=np.float32, out=sums[:, 1:])
    detail = sums[:, 3 * s :] - sums[:, : -3 * s]
    detail -= 3.0 * (sums[:, 2 * s : -s] - sums[:, s : -2 * s])
    limit = _CLIPPED * max(float(np.sqrt(np.mean(detail * detail))), 1e-3)
    np.clip(detail, -limit, limit, out=detail)
    detail *= _RANGE / limit
    detail += 32768.0
    sharp: Lines = np.rint(detail).astype(np.uint16)
    return sharp
