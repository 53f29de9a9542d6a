"""Solver for least squares with box constraints, an active-set method for a few unknowns.

``min 1/2 sum_r w_r (b_r x - g_r)^2 + 1/2 sum_i d_i x_i^2 + p x`` for ``0 <= x <= u``, ``d > 0``.
Each unknown is either free or held at a bound, and each step leads to the minimum over the free
unknowns. A step that would leave the box ends at the first bound that it reaches. An unknown is
freed from its bound if the multiplier of the bound has the wrong sign. Each step reduces the cost,
so the method terminates; the limit on the number of steps is needed only for an ill-posed problem.

Since there are fewer rows than unknowns, each step is solved in the space of the rows (the
Sherman-Morrison-Woodbury identity).
"""

from typing import NamedTuple

import numpy as np

from omni_core.kernels import by_reference, lean
from omni_core.quantities import FloatArray, IntArray

_FREE, _LOW, _HIGH = range(3)
_TOLERANCE = 1e-9  # tolerance for rounding errors of a multiplier [1]


@by_reference
class Box(NamedTuple):
    """A problem with R rows and M unknowns of the order of 1, with working memory.

    Attributes:
        rows: ``b``, shape (R, M).
        weights: ``w > 0``, shape (R,).
        goals: ``g``, shape (R,).
        damping: ``d``, shape (M,).
        linear: ``p``, shape (M,).
        upper: ``u >= 0``, shape (M,).
        solution: initial value, then the solution, shape (M,).
        place: state of each unknown: free, at the lower bound or at the upper bound, shape (M,).
        slope: gradient of the cost, shape (M,).
        step: step from the solution to the minimum, shape (M,).
        matrix: Cholesky factor in the space of the rows, shape (R, R).
        residual: residuals of the rows, shape (R,).
    """

    rows: FloatArray
    weights: FloatArray
    goals: FloatArray
    damping: FloatArray
    linear: FloatArray
    upper: FloatArray
    solution: FloatArray
    place: IntArray
    slope: FloatArray
    step: FloatArray
    matrix: FloatArray
    residual: FloatArray


def new_box(rows: int, unknowns: int) -> Box:
    """Return a problem with weights of 1, infinite upper bounds, and zeros in all other arrays."""
    return Box(
        rows=np.zeros((rows, unknowns)),
        weights=np.ones(rows),
        goals=np.zeros(rows),
        damping=np.zeros(unknowns),
        linear=np.zeros(unknowns),
        upper=np.full(unknowns, np.inf),
        solution=np.zeros(unknowns),
        place=np.zeros(unknowns, np.int64),
        slope=np.zeros(unknowns),
        step=np.zeros(unknowns),
        matrix=np.zeros((rows, rows)),
        residual=np.zeros(rows),
    )


@lean
def box_least_squares(box: Box) -> None:
    """Minimize the cost, starting at `box.solution`, and write the minimum to `box.solution`."""
    solution, upper, step, place = box.solution, box.upper, box.step, box.place
    m = solution.size
    for i in range(m):
        solution[i] = min(max(solution[i], 0.0), upper[i])
        at_bound = _LOW if solution[i] <= 0.0 else _HIGH
        place[i] = _FREE if 0.0 < solution[i] < upper[i] else at_bound
    full = False  # whether the last step ended without meeting a bound
    for _ in range(10 * m + 10):
        _find_slope(box)
        if full and not _release(box):
            return
        _find_step(box)
        full, share, blocking = True, 1.0, 0
        for i in range(m):
            if step[i] != 0.0:
                reach = ((upper[i] if step[i] > 0.0 else 0.0) - solution[i]) / step[i]
                if reach < share:
                    full, share, blocking = False, max(reach, 0.0), i
        for i in range(m):
            solution[i] += share * step[i]
        if not full:
            place[blocking] = _HIGH if step[blocking] > 0.0 else _LOW
            solution[blocking] = upper[blocking] if step[blocking] > 0.0 else 0.0


@lean
def _find_slope(box: Box) -> None:
    n, m = box.rows.shape
    for r in range(n):
        value = -box.goals[r]
        for i in range(m):
            value += box.rows[r, i] * box.solution[i]
        box.residual[r] = box.weights[r] * value
    for i in range(m):
        value = box.damping[i] * box.solution[i] + box.linear[i]
        for r in range(n):
            value += box.rows[r, i] * box.residual[r]
        box.slope[i] = value


@lean
def _release(box: Box) -> bool:
    """Free the unknown whose bound has the most negative Lagrange multiplier.

    Returns:
        Whether an unknown was freed; False if no multiplier is negative.
    """
    worst, loosest = -_TOLERANCE, -1
    for i in range(box.slope.size):
        multiplier = box.slope[i] if box.place[i] == _LOW else -box.slope[i]
        if box.place[i] != _FREE and box.upper[i] > 0.0 and multiplier < worst:
            worst, loosest = multiplier, i
    if loosest >= 0:
        box.place[loosest] = _FREE
    return loosest >= 0


@lean
def _find_step(box: Box) -> None:
    """Write to `box.step` the step to the minimum over the free unknowns; 0 for the others.

    ``d step = b' y - slope`` with ``(1/w + b 1/d b') y = b 1/d slope``.
    """
    y, matrix = box.residual, box.matrix
    n, m = box.rows.shape
    for r in range(n):
        y[r] = 0.0
        for s in range(r):
            matrix[r, s] = 0.0
        matrix[r, r] = 1.0 / box.weights[r]
    for i in range(m):
        if box.place[i] == _FREE:
            for r in range(n):
                scaled = box.rows[r, i] / box.damping[i]
                y[r] += scaled * box.slope[i]
                for s in range(r + 1):
                    matrix[r, s] += scaled * box.rows[s, i]
    _solve(matrix, y)
    for i in range(m):
        value = -box.slope[i]
        for r in range(n):
            value += box.rows[r, i] * y[r]
        box.step[i] = value / box.damping[i] if box.place[i] == _FREE else 0.0


@lean
def _solve(matrix: FloatArray, y: FloatArray) -> None:
    """Solve ``matrix x = y``, and write x to `y`.

    The lower triangle of `matrix` is replaced by its Cholesky factor.
    """
    n = y.size
    for r in range(n):
        for s in range(r + 1):
            value = matrix[r, s]
            for k in range(s):
                value -= matrix[r, k] * matrix[s, k]
            matrix[r, s] = np.sqrt(max(value, 1e-300)) if r == s else value / matrix[s, s]
        for k in range(r):
            y[r] -= matrix[r, k] * y[k]
        y[r] /= matrix[r, r]
    for r in range(n - 1, -1, -1):
        for k in range(r + 1, n):
            y[r] -= matrix[k, r] * y[k]
        y[r] /= matrix[r, r]
