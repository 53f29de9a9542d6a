"""Quadratic program for the largest deceleration that heading and line of motion allow.

The unknowns ``x`` are the friction forces of N wheels as shares of their usable forces. The usable
force of a wheel is its friction capacity, or its whole brake force if this is less, because the
pedal is only partly down. The rows ``b`` give deceleration, yaw moment and side force as shares of
the sum of all usable forces, ``g`` are the demanded yaw moment and side force, and ``W`` is the
weight `deviation_weight`:

``min (1 - b_0 x)^2 + W (|b_1 x - g_1| + |b_2 x - g_2|)``
subject to ``0 <= x <= 1``.

The demand corrects heading and direction of motion if they deviate by more than ``max_rotation``;
it includes the estimated disturbances. The cost of violating the demand is quadratic near zero and
otherwise linear in the violation (exact penalty), as in the Huber loss.
"""

import math

from omni_brake_assist.laws.allocation_state import CASCADE, Constants, Memory
from omni_brake_assist.laws.box_least_squares import Box, box_least_squares, new_box
from omni_brake_assist.laws.law import NO_WHEEL, Motion
from omni_core.kernels import lean

DECELERATION, YAW, SIDE = range(3)
_SPREAD = 1e-3  # weight of the squared forces; it distributes a force equally to equal wheels [1]
# Weight of the heading after a brake has failed, as a share of `deviation_weight` [1]. The other
# brakes can keep heading and line of motion only with less deceleration. Half of the default weight
# reduces the rotation without making stops much longer than with all brakes on (`study faults`,
# with weights from 0.4 to 2). After a failure, the line of motion has no weight.
_FAILED_SHARE = 0.5
_ROUNDING = 20.0  # weight of the quadratic part of the costs near zero [1]


def new_qp(wheels: int) -> Box:
    """Return the quadratic program of N wheels; `allocate` writes the values of each step.

    The first N unknowns are the used shares of the usable forces. The other unknowns are the amount
    above the demand and the amount below the demand, first for `YAW`, then for `SIDE`.
    """
    qp = new_box(3, wheels + 4)
    qp.damping[:] = _SPREAD / wheels**2
    qp.goals[DECELERATION] = 1.0
    qp.weights[1:] = _ROUNDING
    qp.rows[YAW, wheels : wheels + 2] = qp.rows[SIDE, wheels + 2 :] = -1.0, 1.0
    return qp


@lean
def allocate(law: Constants, memory: Memory, motion: Motion) -> None:
    """Write the quadratic program of this step to `memory.qp`, and solve it.

    The solution begins with the friction force of each wheel as a share of its usable force.
    """
    body, qp, n = memory.body[0], memory.qp, law.rim.size
    total = 0.0
    for i, wheel in enumerate(memory.wheel):
        wheel.usable = min(wheel.capacity, law.most[i] * motion.pedal)
        total += wheel.usable
    per = body.mass / total  # share per acceleration [s^2/m]
    speed = math.hypot(motion.v_x, motion.v_y)
    body.left = speed * per
    # The time constants are proportional to the remaining time of the stop. Their lower limit
    # ensures that the inner loops are faster.
    time = max(CASCADE**2 * law.observer_time, law.return_share * body.left)
    # The parts of the deviations that exceed their limits.
    heading = body.heading - min(max(body.heading, -law.max_rotation), law.max_rotation)
    drift = motion.across_x * motion.v_x + motion.across_y * motion.v_y
    drift -= min(max(drift, -law.max_rotation * speed), law.max_rotation * speed)
    turn = (heading / (CASCADE * time) + motion.yaw_rate) / time + body.yaw_disturbance
    qp.goals[YAW] = -turn * law.gyration * per
    qp.goals[SIDE] = -(drift / (CASCADE * time) + body.lateral_disturbance) * per
    yaw, side = (1.0, 1.0) if motion.failed_brake == NO_WHEEL else (_FAILED_SHARE, 0.0)
    for k in range(4):
        qp.linear[n + k] = 0.5 * law.deviation_weight * (yaw if k < 2 else side)
    for i, wheel in enumerate(memory.wheel):
        unit = wheel.sign * wheel.usable / total
        along = law.active[i, 0] * motion.v_x + law.active[i, 1] * motion.v_y
        across = law.active[i, 0] * motion.across_x + law.active[i, 1] * motion.across_y
        qp.rows[DECELERATION, i] = unit * along / (speed + 1e-9)
        qp.rows[YAW, i] = -unit * law.active[i, 2] / law.gyration
        qp.rows[SIDE, i] = -unit * across
        qp.upper[i] = 1.0 if i != motion.failed_brake else 0.0
    box_least_squares(qp)


@lean
def best_pattern(memory: Memory) -> int:
    """Return the pattern of open and shut valves with the lowest predicted cost in the solved QP.

    Bit `i` of a pattern is set if valve `i` is open. If the brake force of a wheel far exceeds its
    capacity, the wheel slides during the whole prediction, whether its valve is open or shut. Both
    patterns then have the same cost, and the smaller number is returned, in which the valve is
    shut. The brake force thus decreases.
    """
    qp, n = memory.qp, memory.wheel.size
    least, best = math.inf, 0
    for pattern in range(1 << n):
        cost = 0.0
        for row in range(3):
            excess = -qp.goals[row]
            for i in range(n):
                excess += qp.rows[row, i] * memory.forces[(pattern >> i) & 1, i]
            size = square = abs(excess)
            if row != DECELERATION:  # the cost of a large excess is linear
                square = min(size, qp.linear[n + 2 * (row - YAW)] / qp.weights[row])
            cost += qp.weights[row] * square * (2.0 * size - square)
        if cost < least:
            least, best = cost, pattern
    return best
