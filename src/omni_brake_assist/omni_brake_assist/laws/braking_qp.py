"""The braking QP: the friction forces with the largest deceleration that heading and line allow.

Given are the friction forces ``f`` of N wheels, their capacities ``c`` with the sum ``C``, the rows
``b`` of deceleration, yaw and side force as shares of ``C``, and a slack ``s`` for the bounds of
yaw and side force. The problem is

``min (1 - b_0 f)^2 + W_h (b_1 f - l_1 - s_1)^2 + W_l (b_2 f - l_2 - s_2)^2``
subject to ``0 <= f <= c`` and ``0 <= s <= u - l``.

The bounds ``l, u`` are the yaw and lateral accelerations that keep heading and direction of motion
within ``max_rotation`` (an exponential control barrier function), minus the disturbances.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_brake_assist.laws.allocation_state import Constants, Memory, Wheels
from omni_brake_assist.laws.box_least_squares import box_least_squares
from omni_brake_assist.laws.disturbance_observer import CASCADE
from omni_brake_assist.laws.law import Motion
from omni_platform.kernels import kernel, lean
from omni_platform.quantities import FloatArray

DECELERATION, YAW, SIDE = range(3)
_DAMPED = 2.0  # ratio of the two time constants of a second-order system damped by 1/sqrt(2) [1]
_SPREAD = 1e-3  # weight of the squared forces, which spreads them where nothing else does [1]
_SLACK = 1e-6  # weight of the squared slacks, so that the Hessian is positive definite [1]


class Task(NamedTuple):
    """Rows of the QP and the bounds of their sums, as shares of the sum of all capacities.

    Attributes:
        rows: deceleration, yaw and side force per friction force [1/N], shape (3, N).
        low: lower bounds [1], of `YAW` and `SIDE` only, shape (3,).
        high: upper bounds [1], of `YAW` and `SIDE` only, shape (3,).
        weights: weights of the three squares [1], shape (3,).
    """

    rows: FloatArray
    low: FloatArray
    high: FloatArray
    weights: FloatArray


@kernel
def braking_task(law: Constants, memory: Memory, motion: Motion, wheels: Wheels) -> Task:
    """Return the rows and bounds of the QP."""
    body, wheel, n = memory.body[0], memory.wheel, law.rim.size
    total = 0.0
    for i in range(n):
        total += wheel[i].capacity
    speed = math.hypot(motion.v_x, motion.v_y)
    reach = math.sqrt(law.gyration)
    rows, held = np.empty((3, n)), np.zeros(3)
    for i in range(n):
        unit = wheels.sign[i] / total
        along = law.n_x[i] * motion.v_x + law.n_y[i] * motion.v_y
        rows[DECELERATION, i] = unit * along / (speed + 1e-9)
        rows[YAW, i] = -unit * law.lever[i] / reach
        rows[SIDE, i] = -unit * (law.n_x[i] * motion.across_x + law.n_y[i] * motion.across_y)
        if wheels.locked[i]:
            held += np.abs(rows[:, i]) * wheel[i].capacity
    per = body.mass / total  # share of the capacities per acceleration [s^2/m]
    # Heading: both time constants follow the remaining time of the stop; inner loops are faster.
    time = max(CASCADE**2 * law.observer_time, law.return_share * speed * per)
    drift = motion.across_x * motion.v_x + motion.across_y * motion.v_y
    leeway = speed * math.sin(min(law.max_rotation, 0.5 * math.pi))
    rest = np.array([0.0, body.yaw_disturbance * reach * per, body.lateral_disturbance * per])
    low, high = np.zeros(3), np.zeros(3)
    for side, bound in ((-1.0, low), (1.0, high)):
        rate = (side * law.max_rotation - body.heading) / (_DAMPED * time)
        bound[YAW] = (rate - motion.yaw_rate) / time * reach * per
        bound[SIDE] = (side * leeway - drift) / law.line_time * per
        for row in (YAW, SIDE):  # locked wheels resist up to their capacity
            beyond = math.copysign(max(abs(rest[row]) - held[row], 0.0), rest[row])
            bound[row] += side * held[row] - beyond
    return Task(rows, low, high, np.array([1.0, law.heading_weight, law.line_weight]))


@kernel
def allocate(memory: Memory, wheels: Wheels, task: Task) -> None:
    """Solve the QP and store the forces demanded of the wheels."""
    wheel, n = memory.wheel, wheels.hub.size
    rows, upper, solution = np.zeros((3, n + 2)), np.zeros(n + 2), np.zeros(n + 2)
    rows[:, :n] = task.rows
    total = 0.0
    for i in range(n):
        total += wheel[i].capacity
        solution[i] = wheel[i].demand
        upper[i] = 0.0 if wheels.locked[i] else wheel[i].capacity
    goals = task.low.copy()
    goals[DECELERATION] = 1.0
    for row in (YAW, SIDE):
        rows[row, n + row - 1] = -1.0
        upper[n + row - 1] = task.high[row] - task.low[row]
    hessian, linear = np.zeros((n + 2, n + 2)), np.zeros(n + 2)
    for i in range(n + 2):
        for row in range(3):
            linear[i] += task.weights[row] * goals[row] * rows[row, i]
            for j in range(n + 2):
                hessian[i, j] += task.weights[row] * rows[row, i] * rows[row, j]
        hessian[i, i] += _SPREAD / total**2 if i < n else _SLACK
    box_least_squares(hessian, linear, upper, solution)
    for i in range(n):
        wheel[i].demand = solution[i]


@lean
def cost(task: Task, sums: FloatArray) -> float:
    """Return the cost of the QP for given sums of its rows, with the best slacks.

    Args:
        task: rows and bounds.
        sums: deceleration, yaw and side force as shares of all capacities [1], shape (3,).
    """
    value = (1.0 - sums[DECELERATION]) ** 2
    for row in (YAW, SIDE):
        beyond = max(task.low[row] - sums[row], sums[row] - task.high[row], 0.0)
        value += task.weights[row] * beyond * beyond
    return float(value)
