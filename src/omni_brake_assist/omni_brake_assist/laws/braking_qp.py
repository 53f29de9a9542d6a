"""Quadratic program for the largest deceleration that heading and line of motion allow.

The unknowns ``x`` are the friction forces of N wheels as shares of their capacities. The rows ``b``
give deceleration, yaw moment and side force as shares of the sum of all capacities, ``e`` is the
excess of yaw moment and side force beyond their bounds, and ``W`` is the weight `deviation_weight`:

``min (1 - b_0 x)^2 + W (|e_1| + |e_2|)``
subject to ``l <= b x - e <= u`` and ``0 <= x <= min(1, what the brakes can hold)``.

The bounds ``l, u`` limit the yaw and lateral accelerations so that heading and direction of motion
stay within ``max_rotation`` (an exponential control barrier function); the estimated disturbances
are subtracted. The costs of the excess are linear (exact penalty): the cost per unit does not
depend on the distance of the motion from its bounds. Near zero they are quadratic, as in Huber's
cost.
"""

import math

from omni_brake_assist.laws.allocation_state import Constants, Memory
from omni_brake_assist.laws.box_least_squares import Box, box_least_squares, new_box
from omni_brake_assist.laws.disturbance_observer import CASCADE
from omni_brake_assist.laws.law import NO_WHEEL, Motion
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

DECELERATION, YAW, SIDE = range(3)
_DAMPED = 2.0  # ratio of the two time constants for a damping of 1/sqrt(2) [1]
_SPREAD = 1e-3  # weight of the squared forces, which shares a force between equal wheels [1]
_SLACK = 1e-6  # weight of the squared slacks, for a positive definite Hessian [1]
# Weight of the heading after a brake has failed [1]. The other brakes can keep heading and line
# only with less deceleration. Of the weights from 0.4 to 2, this one reduces the rotation without
# making stops much longer than with all brakes on (`study faults`). The line of motion then has no
# weight.
_FAILED_HEADING_WEIGHT = 0.6
_SLACKS = 6  # number of slacks: three for each of the two bounded rows
_ROUNDING = 30.0  # weight of the quadratic part of the costs near zero [1]


def new_qp(wheels: int) -> Box:
    """Return the QP of N wheels; `allocate` writes the parts that depend on the motion.

    The unknowns are the shares of the wheels' capacities, then three slacks for each of `YAW` and
    `SIDE`: the position within the bounds, the excess above them, and the excess below them.
    """
    qp = new_box(3, wheels + _SLACKS)
    qp.damping[wheels:] = _SLACK
    qp.goals[DECELERATION] = 1.0
    qp.weights[1:] = _ROUNDING
    for row in (YAW, SIDE):
        within = _first_slack(wheels, row)
        qp.rows[row, within : within + 3] = -1.0, -1.0, 1.0
    return qp


@lean
def _first_slack(wheels: int, row: int) -> int:
    """Return the index of the first of the three slacks of `YAW` or `SIDE`; see `new_qp`."""
    return wheels + 3 * (row - YAW)


@lean
def allocate(law: Constants, memory: Memory, motion: Motion) -> None:
    """Solve the QP for the demanded shares of the wheels' capacities."""
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
        qp.upper[i] = min(law.most[i] * motion.pedal / wheel[i].capacity, 1.0)
        if i == motion.failed_brake:
            qp.upper[i] = 0.0
        elif wheel[i].locked:
            qp.upper[i] = 0.0
            held_yaw += abs(qp.rows[YAW, i])
            held_side += abs(qp.rows[SIDE, i])
    per = body.mass / total  # of an acceleration
    # The time constants follow the remaining time of the stop; the inner loops must be faster.
    time = max(CASCADE**2 * law.observer_time, law.return_share * speed * per)
    outer = _DAMPED * time
    goal = -(body.heading / outer + motion.yaw_rate) / time - body.yaw_disturbance
    leeway = law.max_rotation / (outer * time)
    per_yaw = reach * per
    failed = motion.failed_brake != NO_WHEEL
    weight = min(law.deviation_weight, _FAILED_HEADING_WEIGHT) if failed else law.deviation_weight
    _bound(qp, YAW, weight, goal * per_yaw, leeway * per_yaw + held_yaw)
    drift = motion.across_x * motion.v_x + motion.across_y * motion.v_y
    goal = -drift / outer - body.lateral_disturbance
    leeway = law.max_rotation * speed / outer
    weight = 0.0 if failed else law.deviation_weight
    _bound(qp, SIDE, weight, goal * per, leeway * per + held_side)
    box_least_squares(qp)


@lean
def _bound(qp: Box, row: int, weight: float, goal: float, leeway: float) -> None:
    """Set the bounds of a row to `goal` plus or minus `leeway`; each unit beyond costs `weight`."""
    within = _first_slack(qp.solution.size - _SLACKS, row)
    qp.goals[row] = goal - leeway
    qp.upper[within] = 2.0 * leeway
    qp.linear[within + 1] = qp.linear[within + 2] = 0.5 * weight


@lean
def cost(memory: Memory, enable: FloatArray) -> float:
    """Return the cost of the forces and the sliding that are predicted for a pattern of valves.

    Args:
        memory: contains the solved QP and the predictions.
        enable: whether each valve is open, 0 or 1, shape (N,).
    """
    qp, value = memory.qp, 0.0
    for row in range(3):
        total = -qp.goals[row]
        for i in range(enable.size):
            total += qp.rows[row, i] * memory.forces[int(enable[i]), i]
        value += total * total if row == DECELERATION else _penalty(qp, row, total)
    for i in range(enable.size):
        value += memory.slides[int(enable[i]), i]
    return value


@lean
def _penalty(qp: Box, row: int, excess: float) -> float:
    """Return Huber's cost of the amount by which a sum exceeds the lower bound of its row."""
    within = _first_slack(qp.solution.size - _SLACKS, row)
    beyond, weight = max(-excess, excess - qp.upper[within], 0.0), 2.0 * qp.linear[within + 1]
    square = min(beyond, 0.5 * weight / qp.weights[row])
    return float(qp.weights[row] * square * square + weight * (beyond - square))
