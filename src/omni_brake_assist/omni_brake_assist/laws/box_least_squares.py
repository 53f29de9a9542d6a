"""Least squares within bounds by an active set: a few unknowns, solved in microseconds.

It solves ``min 1/2 f' H f - q' f`` for ``0 <= f <= c`` with a positive definite ``H``. Unknowns at
a bound are held there, and the others are solved for. A step that would leave the box ends at the
first bound that it meets. A bound whose multiplier has the wrong sign is released. Each step lowers
the cost, so the method ends; the limit of its steps only matters for an invalid ``H``.
"""

import numpy as np
from numpy.typing import NDArray

from omni_platform.kernels import kernel, lean
from omni_platform.quantities import FloatArray

_FREE, _LOW, _HIGH = range(3)


@kernel
def _solve_free(
    hessian: FloatArray, gradient: FloatArray, place: NDArray[np.int64], step: FloatArray
) -> None:
    """Solve ``H_FF step_F = -gradient_F`` by Cholesky's rule; zero elsewhere."""
    n = gradient.size
    index = np.empty(n, np.int64)
    m = 0
    for i in range(n):
        step[i] = 0.0
        if place[i] == _FREE:
            index[m] = i
            m += 1
    root = np.zeros((m, m))
    for i in range(m):
        for j in range(i + 1):
            value = hessian[index[i], index[j]]
            for k in range(j):
                value -= root[i, k] * root[j, k]
            root[i, j] = np.sqrt(max(value, 1e-300)) if i == j else value / root[j, j]
    y = np.empty(m)
    for i in range(m):
        value = -gradient[index[i]]
        for k in range(i):
            value -= root[i, k] * y[k]
        y[i] = value / root[i, i]
    for i in range(m - 1, -1, -1):
        value = y[i]
        for k in range(i + 1, m):
            value -= root[k, i] * y[k]
        y[i] = value / root[i, i]
        step[index[i]] = y[i]


@kernel
def box_least_squares(
    hessian: FloatArray, linear: FloatArray, upper: FloatArray, solution: FloatArray
) -> None:
    """Minimize ``1/2 f' H f - q' f`` within ``0 <= f <= c``.

    Args:
        hessian: ``H``, positive definite, shape (N, N).
        linear: ``q``, shape (N,).
        upper: ``c >= 0``, shape (N,).
        solution: start of the search; receives the minimum, shape (N,).
    """
    n = linear.size
    place = np.zeros(n, np.int64)
    gradient, step = np.empty(n), np.empty(n)
    for i in range(n):
        solution[i] = min(max(solution[i], 0.0), upper[i])
        if upper[i] <= 0.0:
            place[i] = _LOW
    for _ in range(10 * n + 10):
        for i in range(n):
            gradient[i] = -linear[i]
            for j in range(n):
                gradient[i] += hessian[i, j] * solution[j]
        _solve_free(hessian, gradient, place, step)
        share, blocking, side = 1.0, -1, _FREE
        for i in range(n):
            if place[i] != _FREE or step[i] == 0.0:
                continue
            bound = upper[i] if step[i] > 0.0 else 0.0
            reach = (bound - solution[i]) / step[i]
            if reach < share:
                share, blocking = max(reach, 0.0), i
                side = _HIGH if step[i] > 0.0 else _LOW
        for i in range(n):
            solution[i] += share * step[i]
        if blocking >= 0:
            place[blocking] = side
            solution[blocking] = upper[blocking] if side == _HIGH else 0.0
            continue
        loosest = _loosest(hessian, linear, upper, solution, place)
        if loosest < 0:
            return
        place[loosest] = _FREE


@lean
def _loosest(
    hessian: FloatArray,
    linear: FloatArray,
    upper: FloatArray,
    solution: FloatArray,
    place: NDArray[np.int64],
) -> int:
    """Return the bound whose multiplier most clearly has the wrong sign, -1 if none has."""
    worst, loosest = -1e-12, -1
    for i in range(linear.size):
        if place[i] == _FREE or upper[i] <= 0.0:
            continue
        slope = -linear[i]
        for j in range(linear.size):
            slope += hessian[i, j] * solution[j]
        multiplier = slope if place[i] == _LOW else -slope
        if multiplier < worst:
            worst, loosest = multiplier, i
    return loosest
