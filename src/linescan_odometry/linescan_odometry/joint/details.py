"""Details of the lines that change within a batch, limited in size, and where they are coherent.

The edge of a shadow moves with its own velocity, and may be many times stronger than the texture of
the ground. In the limited details, it counts no more than any other detail of its length.

In shapes, m is the number of lines and n the number of pixels per line.
"""

import math

import numpy as np

from linescan_odometry.joint.fit import PLACES
from linescan_odometry.joint.spectra import Doubles, Floats, mean_of, summing
from omni_core.kernels import kernel, linked

_LONGEST = 16  # details are shorter than this fraction of a line
_SAMPLED = 7  # every seventh detail counts for their median size


@linked
@kernel
def limited(logs: Floats) -> Floats:
    """Return the details that change within a batch, limited to their median size, shape (m, n).

    The mean of all lines, which contains the fixed pattern, and the moving average of each line are
    subtracted.

    Args:
        logs: logarithm of the gray levels, shape (m, n).
    """
    m, n = logs.shape
    reach, mean = max(1, n // (2 * _LONGEST)), mean_of(logs)
    details, total = np.empty((m, n), np.float32), np.zeros(n + 1)
    for k in range(m):
        row, own = details[k], logs[k]
        for i in range(n):
            row[i] = own[i] - mean[i]
            total[i + 1] = total[i] + row[i]
        # Slices with the same index need no check of their bounds, so the division is vectorized.
        inner, ahead = row[reach : n - reach], total[2 * reach + 1 :]
        for i in range(len(inner)):
            inner[i] -= (ahead[i] - total[i]) / (2 * reach + 1)
        for i in range(min(reach, n - reach)):
            row[i] -= total[i + reach + 1] / (i + reach + 1)
            row[n - 1 - i] -= (total[n] - total[n - 1 - i - reach]) / (i + reach + 1)
    limit = np.median(np.abs(details.ravel()[::_SAMPLED]))
    for k in range(m):
        row = details[k]
        for i in range(n):
            row[i] = min(max(row[i], -limit), limit)
    return details


@summing
def _product(line: Floats, other: Floats, share: float) -> float:
    """Return the sum of the products of pixels of a line and interpolated pixels of another one.

    Args:
        line: pixels, shape (p,).
        other: pixels of the other line, shape (p + 1,).
        share: share of the next pixel in each interpolated pixel [1].
    """
    total, own, following = np.float32(0.0), np.float32(1.0 - share), np.float32(share)
    for i in range(len(line)):
        total += line[i] * (own * other[i] + following * other[i + 1])
    return float(total)


@linked
@kernel
def spread(details: Floats, motion: Doubles, distance: int, most: int) -> tuple[float, float]:
    """Return over how many ground segments the details are spread that two lines share.

    Neighboring lines share the details of any texture that is longer than the error of the
    displacement. At a larger line spacing, they only share what moves with the displacement.

    Args:
        details: limited details of the lines, shape (m, n).
        motion: displacement per line in the middle of the batch [px] and its change from line to
            line [px], shape (2,).
        distance: line spacing of the two lines [lines].
        most: number of segments that the second result leaves out.

    Returns:
        Effective number of segments; and the mean of all segments except those that share most,
        divided by its standard error, which follows from their scatter (Student's t).
    """
    m, n = details.shape
    kappa = np.arange(m) - 0.5 * (m - 1)
    paths = motion[0] * kappa + 0.5 * motion[1] * kappa**2
    lowest, length = paths.min(), n / PLACES
    shared = np.zeros(int((n + paths.max() - lowest) / length) + 1)
    for k in range(m - distance):
        step, ahead = paths[k] - paths[k + distance], paths[k] - lowest
        whole = math.floor(step)
        i, end = max(0, -whole), min(n, n - 1 - whole)
        while i < end:
            place = int((i + ahead) / length)
            after = min(max(i + 1, math.ceil((place + 1) * length - ahead)), end)
            there = details[k + distance, i + whole : after + whole + 1]
            shared[place] += _product(details[k, i:after], there, step - whole)
            i = after
    shared.sort()
    others = shared[: len(shared) - most]
    mean = others.mean()
    scatter = ((others - mean) ** 2).sum() / (len(others) * (len(others) - 1))
    shared = np.maximum(shared, 0.0)
    number = shared.sum() ** 2 / max((shared * shared).sum(), 1e-12)
    return float(number), float(mean / math.sqrt(max(scatter, 1e-24)))
