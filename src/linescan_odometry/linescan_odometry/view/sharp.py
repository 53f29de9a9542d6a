"""Fine detail of lines, without shadows and uneven light.

The edge of a moving shadow, or light that changes along the line, has more contrast than most
grounds and dominates a match. But it is smooth: the second difference of means over a few pixels
keeps the texture of a ground and removes a ramp of light. If the displacement of this detail
differs from that of the lines, two patterns move in the view, and the ground is the finer one.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from linescan_odometry.matching.subpixel import FEWEST_PIXELS
from linescan_odometry.measurements import Lines
from omni_platform.kernels import njit

_RANGE = 30000.0  # of 16 bit to either side
_CLIPPED = 4.0  # standard deviations: single pixels and edges do not rule a line
_MIDDLE = 32768.0
_BESIDE = 1  # px beside the expected shift
_MOST = 0.5  # correlation from which nothing else can hold more of the detail

# Sums in any order; such a kernel must not be called by another one (see `matching.subpixel`).
_REORDER = {"reassoc", "contract", "nsz"}


def steps(pixels: int) -> tuple[int, int]:
    """Return how many pixels the fine and the coarse mean of a line of n pixels average."""
    fine = 4 if pixels > 512 else 2
    return fine, max(2 * fine, pixels // 100)


def sharp_pixels(pixels: int, step: int) -> int:
    """Return the number of pixels of the detail of n pixels."""
    return pixels - 3 * step + 1


def sharpened(lines: Lines, step: int) -> Lines:
    """Return the fine detail of lines, 16 bit, shape (m, `sharp_pixels`).

    Args:
        lines: shape (m, n).
        step: number of pixels of the means that are compared.
    """
    sharp: Lines = np.empty((len(lines), sharp_pixels(lines.shape[1], step)), np.uint16)
    _sharpen(lines, step, np.empty(sharp.shape, np.float32), sharp)
    return sharp


def follows(sharp: Lines, displacement: float) -> bool:
    """Return whether the detail clearly has the displacement of the lines.

    If two patterns move in the view, they share the energy of the detail: the one with more than
    half of it in most pairs is the result of a full search.

    Args:
        sharp: detail of m + 1 lines, oldest first.
        displacement: of the lines from one to the next [px].
    """
    alike: int = _count_alike(sharp, round(displacement))
    return 2 * alike > len(sharp) - 1


@njit(cache=True, fastmath=_REORDER)
def _sharpen(lines: Lines, step: int, detail: NDArray[np.float32], sharp: Lines) -> None:
    """Write the second difference of sums of `step` pixels, clipped, as 16 bit."""
    rows, pixels = detail.shape
    squares = 0.0
    for row in range(rows):
        line, out = lines[row], detail[row]
        first, middle, last = np.int64(0), np.int64(0), np.int64(0)
        for i in range(step):
            first += np.int64(line[i])
            middle += np.int64(line[i + step])
            last += np.int64(line[i + 2 * step])
        out[0] = first - 2 * middle + last
        # The sums move on by what enters and what leaves; whole numbers, so nothing drifts.
        value = first - 2 * middle + last
        enters, thrice = line[3 * step :], line[2 * step :]
        thrice_less, leaves = line[step:], line
        for i in range(pixels - 1):
            value += (
                np.int64(enters[i]) - np.int64(leaves[i])
                - 3 * (np.int64(thrice[i]) - np.int64(thrice_less[i]))
            )  # fmt: skip
            out[i + 1] = value
        for i in range(pixels):
            squares += float(out[i]) * float(out[i])
    limit = max(_CLIPPED * math.sqrt(squares / (rows * pixels)), 1e-3)
    scale = np.float32(_RANGE / limit)
    for row in range(rows):
        source, into = detail[row], sharp[row]
        for i in range(pixels):
            value_f = min(max(source[i] * scale, np.float32(-_RANGE)), np.float32(_RANGE))
            into[i] = np.uint16(np.int32(value_f + np.float32(_MIDDLE + 0.5)))


@njit(cache=True, fastmath=_REORDER)
def _count_alike(sharp: Lines, shift: int) -> int:
    """Count the pairs of consecutive lines that are correlated at a shift or next to it."""
    count = 0
    for pair in range(len(sharp) - 1):
        old, new = sharp[pair], sharp[pair + 1]
        for s in range(shift - _BESIDE, shift + _BESIDE + 1):
            overlap = len(new) - abs(s)
            if overlap < FEWEST_PIXELS:
                continue
            x, y = new[max(0, -s) :][:overlap], old[max(0, s) :][:overlap]
            xx, yy, xy = np.float32(0), np.float32(0), np.float32(0)
            for i in range(overlap):
                a, b = (
                    np.float32(x[i]) - np.float32(_MIDDLE),
                    np.float32(y[i]) - np.float32(_MIDDLE),
                )
                xx += a * a
                yy += b * b
                xy += a * b
            if xy > _MOST * math.sqrt(float(xx) * float(yy)):
                count += 1
                break
    return count
