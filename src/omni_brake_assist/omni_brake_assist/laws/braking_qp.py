"""The braking QP: the friction forces with the largest deceleration that heading and line allow.

With the friction forces of N wheels as shares ``x`` of their capacities, the rows ``b`` of
deceleration, yaw and side force as shares of the sum of all capacities, and by how much ``e`` yaw
and side force exceed their bounds,

``min (1 - b_0 x)^2 + W_h |e_1| + W_l |e_2|``
subject to ``l <= b x - e <= u`` and ``0 <= x <= min(1, what the brakes can hold)``.

The bounds ``l, u`` are those of the yaw and lateral accelerations that keep heading and direction
of motion within ``max_rotation`` (an exponential control barrier function), less disturbances.
Their costs are linear (exact penalties): the price of a deviation stays the same however far the
motion is from its bounds. Near zero they are rounded by a square, as Huber's cost is.
"""

import math

from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.box_least_squares import Box, box_least_squares, new_box
from omni_brake_assist.laws.disturbance_observer import CASCADE
from omni_brake_assist.laws.law import Motion
from omni_platform.kernels import lean

DECELERATION, YAW, SIDE = range(3)
_DAMPED = 2.0  # ratio of the two time constants of a second-order system damped by 1/sqrt(2) [1]
_SPREAD = 1e-3  # weight of the squared forces, which spreads them where nothing else does [1]
_SLACK = 1e-6  # weight of the squared slacks, so that the Hessian is positive definite [1]
_SQUARES = 1.0, 60.0, 12.0  # weights of the rows' squares, which round the costs of the bounds [1]


def new_qp(wheels: int) -> Box:
    """Return the QP of N wheels, whose parts that depend on the motion `allocate` writes.

    Its unknowns are the shares of the wheels' capacities, then three slacks of `YAW` and of `SIDE`:
    the place within the bounds, and by how much a sum is above and below them.
    """
    qp = new_box(3, wheels + 6)
    qp.damping[wheels:] = _SLACK
    qp.goals[DECELERATION] = 1.0
    qp.weights[:] = _SQUARES
    for row in (YAW, SIDE):
        within = wheels + 3 * (row - 1)
        qp.rows[row, within : within + 3] = -1.0, -1.0, 1.0
    return qp


@lean
def allocate(law: Constants, memory: Memory, motion: Motion) -> None:
    """Solve the QP for the shares of the capacities that are demanded of the wheels."""
    body, wheel, qp, n = memory.body[0], memory.wheel, memory.qp, law.rim.size
    total = 0.0
    for i in range(n):
        total += wheel[i].capacity
    speed = math.hypot(motion.v_x, motion.v_y)
    reach = math.sqrt(law.gyration)
    held_yaw = held_side = 0.0
    for i in range(n):
        share = wheel[i].capacity / total
        unit = wheel[i].sign * share
        along = law.n_x[i] * motion.v_x + law.n_y[i] * motion.v_y
        across = law.n_x[i] * motion.across_x + law.n_y[i] * motion.across_y
        qp.rows[DECELERATION, i] = unit * along / (speed + 1e-9)
        qp.rows[YAW, i] = -unit * law.lever[i] / reach
        qp.rows[SIDE, i] = -unit * across
        qp.damping[i] = _SPREAD * share * share
        largest = law.brake.max_torque * motion.pedal / (law.rim[i] * wheel[i].capacity)
        qp.upper[i] = min(largest, 1.0)
        if wheel[i].locked:
            qp.upper[i] = 0.0
            held_yaw += abs(qp.rows[YAW, i])
            held_side += abs(qp.rows[SIDE, i])
        qp.solution[i] = wheel[i].demand
    per = body.mass / total  # of an acceleration
    # Heading: both time constants follow the time that is left; loops inside must be faster.
    time = max(CASCADE**2 * law.observer_time, law.return_share * speed * per)
    per_yaw = reach * per
    goal = -(body.heading / (_DAMPED * time) + motion.yaw_rate) / time * per_yaw
    leeway = law.max_rotation / (_DAMPED * time * time) * per_yaw
    _bound(qp, YAW, law.heading_weight, goal, leeway, body.yaw_disturbance * per_yaw, held_yaw)
    drift = motion.across_x * motion.v_x + motion.across_y * motion.v_y
    goal = -drift / law.line_time * per
    leeway = speed * math.sin(min(law.max_rotation, 0.5 * math.pi)) / law.line_time * per
    _bound(qp, SIDE, law.line_weight, goal, leeway, body.lateral_disturbance * per, held_side)
    box_least_squares(qp)
    for i in range(n):
        wheel[i].demand = qp.solution[i]


@lean
def _bound(
    qp: Box,
    row: int,
    weight: float,
    goal: float,
    leeway: float,
    disturbance: float,
    held: float,
) -> None:
    """Bound the sum of a row to a goal with a leeway; locked wheels hold against what they can."""
    within = qp.solution.size - 9 + 3 * row
    beyond = math.copysign(max(abs(disturbance) - held, 0.0), disturbance)
    qp.goals[row] = goal - beyond - leeway - held
    qp.upper[within] = 2.0 * (leeway + held)
    qp.linear[within + 1] = qp.linear[within + 2] = 0.5 * weight


@lean
def cost(qp: Box, braking: float, yaw: float, side: float) -> float:
    """Return the cost of the QP for given sums of its rows over the wheels, with the best slacks.

    Args:
        qp: the solved QP.
        braking: sum of the row `DECELERATION`.
        yaw: sum of the row `YAW`.
        side: sum of the row `SIDE`.
    """
    missing = 1.0 - braking
    return float(missing * missing + _penalty(qp, YAW, yaw) + _penalty(qp, SIDE, side))


@lean
def _penalty(qp: Box, row: int, total: float) -> float:
    within = qp.solution.size - 9 + 3 * row
    excess, weight = total - qp.goals[row], 2.0 * qp.linear[within + 1]
    beyond = max(-excess, excess - qp.upper[within], 0.0)
    square = min(beyond, 0.5 * weight / qp.weights[row])
    return float(qp.weights[row] * square * square + weight * (beyond - square))
