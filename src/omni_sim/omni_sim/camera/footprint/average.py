"""Resampling of a texture to larger texels, each of which is the exact mean over its area.

Larger texels preserve the integral over every area that is composed of them. The number of texels
per period is arbitrary: a new texel contains a share of each old texel that its edges cut. All
computations use integers.
"""

import numpy as np
from numpy.typing import NDArray

from omni_platform.kernels import njit


@njit(cache=True, nogil=True)
def average_texels(gray: NDArray[np.uint8], middle: int, averages: NDArray[np.int8]) -> None:
    """Write the rounded means of a texture minus `middle` to ``averages[:, :len(averages)]``.

    Values of one half are rounded up and down in a checkerboard pattern. Always rounding up would
    increase the means of 2 x 2 texels by an eighth of a gray level.

    Args:
        gray: gray levels of the texture, shape (n, n).
        middle: gray level that is stored as 0.
        averages: output, one row per new texel in a period, at most n rows.
    """
    fine, coarse = len(gray), len(averages)
    # A fine texel is `coarse` units long, a coarse one `fine` units.
    area = np.int64(fine) * fine
    sums = np.empty(fine, np.int32)
    for i in range(coarse):
        sums[:] = 0
        low = i * fine
        for j in range(low // coarse, (low + fine - 1) // coarse + 1):
            share = np.int32(min(low + fine, (j + 1) * coarse) - max(low, j * coarse))
            row = gray[j]
            for c in range(fine):
                sums[c] += share * np.int32(row[c])
        j = 0
        for k in range(coarse):
            end = (k + 1) * fine
            at = k * fine
            total = np.int64(0)
            while at < end:
                until = min(end, (j + 1) * coarse)
                total += (until - at) * np.int64(sums[j])
                at = until
                if at == (j + 1) * coarse:
                    j += 1
            rounded = (2 * total + area - ((i + k) & 1)) // (2 * area)
            averages[i, k] = rounded - middle
