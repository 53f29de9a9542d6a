"""Variance of the mean of many consecutive displacements, from the residuals of their matches.

The errors of consecutive displacements are strongly correlated. The noise of a line enters the
displacement before it and, with the opposite sign, the one after it, so that nearly all of it
cancels in the mean of a straight motion. In sideways motion a strip of ground disturbs the match
when it enters the view and when it leaves; neighboring strips of the same stone have similar
errors. So the variance of a mean of m displacements, each with the variance V, can be 30 times
smaller than V / m or 10 times larger.

These errors belong to positions *along the axis*, and distant positions are independent. So the
errors are first summed over time and then squared, position by position (the cluster-robust
variance of regression, Liang and Zeger 1986). With ``r_ib`` the sum of e g over block b of the
ground in pair i, ``P_ib`` that of p q (see `subpixel`), P_i its sum over the blocks and ``w_i`` the
weight of pair i in the mean,

    S_b = sum_i w_i (r_ib - P_ib / P_i sum_b r_ib) / P_i,    var = sum_b S_b^2

Three corrections make the variance valid for few blocks. Errors may extend into neighboring blocks;
therefore products of neighbors enter with the weights of Bartlett (Newey and West 1987), over a
fifth of the effective number of blocks, ``N = 1 / sum_b h_b^2`` with the leverages
``h_b = sum_i w_i P_ib / P_i``. The fit of each pair reduces the residuals by the leverage of its
blocks; the variance is increased accordingly. The variance is itself an estimate with nu degrees of
freedom; therefore it is multiplied by the variance of Student's t, ``nu / (nu - 2)``.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_platform.kernels import njit
from omni_platform.quantities import FloatArray

IntArray = NDArray[np.int64]


class Overlaps(NamedTuple):
    """Residuals of the matches of m pairs, summed over the parts of each overlap.

    Attributes:
        sums: sums of e, 2 g, 2 e g and p q over each part of each pair, with the residual e, the
            gradient 2 g and the lines p and q of `subpixel`, shape (>= m, most parts, 4); the parts
            of a pair are in consecutive blocks of ground.
        length: length of the overlap of each pair [px], shape (m,).
        parts: number of parts of each pair, shape (m,).
        block: number of the block of ground of the first part of each pair, shape (m,).
    """

    sums: FloatArray
    length: IntArray
    parts: IntArray
    block: IntArray


class _Blocks(NamedTuple):
    """Sums over the pairs, see the formulas of the module.

    Attributes:
        error: S_b of each block of ground.
        leverage: h_b of each block of ground.
        shares: P_ib / P_i, shape (m, most parts).
    """

    error: FloatArray
    leverage: FloatArray
    shares: FloatArray


_WINDOWS = 5.0  # effective number of blocks over the width of Bartlett's window
_FEWEST_FREEDOMS = 3.0
_LARGEST_LEVERAGE = 0.75
_LEAST_SHARE = 0.5  # smallest variance, over that without products of neighbors


@njit(cache=True, error_model="numpy")
def mean_variance(overlaps: Overlaps, weight: FloatArray) -> float:
    """Return the variance of a weighted mean of displacements [px^2].

    Args:
        overlaps: residuals of the matched pairs.
        weight: weight of each pair in the mean, zero for excluded ones, shape (m,).
    """
    sums, length, parts, block = overlaps
    low, behind = block.max(), 0
    for pair in range(len(weight)):
        if weight[pair] != 0.0:
            low = min(low, block[pair])
            behind = max(behind, block[pair] + parts[pair])
    error, leverage = np.zeros(behind - low), np.zeros(behind - low)
    blocks = _Blocks(error, leverage, np.zeros((len(weight), sums.shape[1])))
    variance: float = _variance(Overlaps(sums, length, parts, block - low), weight, blocks)
    return variance


@njit(cache=True, error_model="numpy")
def _variance(overlaps: Overlaps, weight: FloatArray, blocks: _Blocks) -> float:
    """Return the variance; `blocks` receives the sums over the pairs."""
    _add_pairs(overlaps, weight, blocks)
    parts, (error, leverage, shares) = overlaps.parts, blocks
    squares, number = 0.0, 0.0
    for b in range(len(error)):
        squares += error[b] * error[b]
        number += leverage[b] * leverage[b]
    number = 1.0 / number
    window = max(1.0, number / _WINDOWS)
    total: float = max(_smoothed_square(error, window), _LEAST_SHARE * squares)
    taken, weights = 0.0, 0.0
    for pair in range(len(weight)):
        if weight[pair] != 0.0:
            taken += abs(weight[pair]) * _smoothed_square(shares[pair, : parts[pair]], window)
            weights += abs(weight[pair])
    kept = 1.0 - min(taken / weights, _LARGEST_LEVERAGE)
    square = 1.0
    for lag in range(1, math.ceil(window)):
        square += 2.0 * (1.0 - lag / window) ** 2
    freedoms = max(number / square, _FEWEST_FREEDOMS)
    return total / kept * freedoms / (freedoms - 2.0)


@njit(cache=True, error_model="numpy")
def _smoothed_square(values: FloatArray, window: float) -> float:
    """Return the sum of squares and of products of neighbors, with Bartlett's weights."""
    total = 0.0
    for lag in range(min(math.ceil(window), len(values))):
        product = 0.0
        for b in range(lag, len(values)):
            product += values[b] * values[b - lag]
        total += (1.0 - lag / window) * (product if lag == 0 else 2.0 * product)
    return total


@njit(cache=True, error_model="numpy")
def _add_pairs(overlaps: Overlaps, weight: FloatArray, blocks: _Blocks) -> None:
    """Add S_b and h_b of every pair, and write its shares."""
    sums, length, parts, block = overlaps
    error, leverage, shares = blocks
    for pair in range(len(weight)):
        if weight[pair] == 0.0:
            continue
        e, g, eg, pq = 0.0, 0.0, 0.0, 0.0
        for part in range(parts[pair]):
            e += sums[pair, part, 0]
            g += sums[pair, part, 1]
            eg += sums[pair, part, 2]
            pq += sums[pair, part, 3]
        e /= length[pair]
        rest = eg - e * g
        for part in range(parts[pair]):
            share = sums[pair, part, 3] / pq
            own = sums[pair, part, 2] - e * sums[pair, part, 1] - share * rest
            error[block[pair] + part] += weight[pair] * 0.5 * own / pq
            leverage[block[pair] + part] += weight[pair] * share
            shares[pair, part] = share
