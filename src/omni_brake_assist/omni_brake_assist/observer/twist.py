"""Update of the filters by the twist, compared with the state at its own stamp."""

from __future__ import annotations

import math

from omni_brake_assist.observer.filters import Filter, correct, correct_past, of_then
from omni_brake_assist.observer.state import (
    ALL,
    BIAS_RATE,
    FASTEST_TURN,
    FILTERS,
    GAIN_X,
    GAIN_Y,
    HEADING,
    LARGEST_BIAS,
    NO_FORCE,
    NO_TWIST,
    PATH,
    RATE,
    STATES,
    ObserverConstants,
    ObserverMemory,
    copy,
)
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_APART_WALK = 0.001  # how much that changes from one twist to the next [rad/s]
_NEWS_GATE = 5.0  # standard deviations beyond which a reading is no calibration error [1]


@lean
def update_by_twist(
    constants: ObserverConstants,
    memory: ObserverMemory,
    stamp_ns: int,
    twist: FloatArray,
    variance: FloatArray,
) -> None:
    """Correct the filters that use the twist."""
    h, then, shift = memory.workspace.h, memory.workspace.then, memory.workspace.shift
    speed = constants.scale * math.hypot(twist[0], twist[1])
    own = constants.wheel**2 + (0.3 * speed) ** 2
    p_x, p_y = constants.p_x, constants.p_y
    _follow_twist(constants, memory, stamp_ns, twist, variance)
    for k in range(FILTERS):
        if k == NO_TWIST:
            continue
        state, covariance = memory.state[k], memory.covariance[k]
        of_then(memory, k, stamp_ns, then)
        copy(state, shift)
        for j in range(3):
            h[:] = 0.0
            if j == RATE:
                h[RATE] = 1.0
            else:
                h[j] = 1.0
                h[RATE] = p_y if j == 0 else -p_x
            # The state may have been corrected by the components before.
            predicted = 0.0
            for i in range(STATES):
                predicted += h[i] * (then[i] + state[i] - shift[i])
            spread = variance[j] + (constants.gyro**2 if j == RATE else own)
            filtered = Filter(state, covariance)
            correct(filtered, h, twist[j] - predicted, spread, memory.workspace.gain)
        for i in range(STATES):
            shift[i] = state[i] - shift[i]
        correct_past(memory, k, stamp_ns, shift)


@lean
def _follow_twist(
    constants: ObserverConstants,
    memory: ObserverMemory,
    stamp_ns: int,
    twist: FloatArray,
    variance: FloatArray,
) -> None:
    """Accumulate the changes of the twist and what each yaw rate explains of them.

    In axes that turn with the gyro, ``U' = f`` if the gyro is right. If the twist's rate is, they
    turn too far by ``d = Omega - gyro``, and the change beyond ``f`` is ``d k x U``.
    """
    course, path = memory.course[0], memory.workspace.then
    of_then(memory, PATH, stamp_ns, path)
    u_x = twist[0] - twist[2] * constants.p_y
    u_y = twist[1] + twist[2] * constants.p_x
    c, s = math.cos(path[HEADING]), math.sin(path[HEADING])
    x, y = c * u_x - s * u_y, s * u_x + c * u_y
    dt = (stamp_ns - course.mark_ns) * 1e-9
    if course.marked != 0.0 and 0.0 < dt <= constants.longest:
        keep = math.exp(-dt / constants.memory)
        change_x = x - course.mark_x - (path[GAIN_X] - course.mark_gain_x)
        change_y = y - course.mark_y - (path[GAIN_Y] - course.mark_gain_y)
        own = 0.5 * (twist[2] + course.mark_rate) * dt
        turn = path[HEADING] - course.mark_heading - own
        course.change_x = keep * course.change_x + change_x
        course.change_y = keep * course.change_y + change_y
        course.turn_x = keep * course.turn_x - turn * 0.5 * (y + course.mark_y)
        course.turn_y = keep * course.turn_y + turn * 0.5 * (x + course.mark_x)
        spread = 2.0 * max(variance[0], variance[1]) + constants.wheel**2
        course.spread = keep * course.spread + (1.0 - keep) * spread
    else:
        course.change_x = course.change_y = course.turn_x = course.turn_y = 0.0
        course.spread = 2.0 * max(variance[0], variance[1]) + constants.wheel**2
    course.marked, course.mark_x, course.mark_y = 1.0, x, y
    course.mark_rate, course.mark_ns = twist[2], stamp_ns
    course.mark_heading = path[HEADING]
    course.mark_gain_x, course.mark_gain_y = path[GAIN_X], path[GAIN_Y]


@lean
def learn_rate_offset(
    constants: ObserverConstants, memory: ObserverMemory, rate: float, variance: float, gyro: float
) -> None:
    """Estimate the difference of the yaw rates of twist and gyro [rad/s] and its source.

    A calibrated gyro has a small bias, an optical twist none: a small difference is the gyro's.
    A larger one is the twist's and gives no information on the gyro.
    """
    if not abs(gyro) < FASTEST_TURN:
        return
    course = memory.course[0]
    spread = course.apart_spread + _APART_WALK**2
    total = spread + variance + constants.gyro**2
    gain, news = spread / total, rate - gyro - course.apart
    if abs(news) > _NEWS_GATE * math.sqrt(total):
        return  # calibration errors do not jump: one of the two is faulty
    course.apart += gain * news
    course.apart_spread = (1.0 - gain) * spread
    size = abs(course.apart)
    sure = LARGEST_BIAS**2 / (LARGEST_BIAS**2 + course.apart_spread)
    bias = -math.copysign(sure * max(min(size, 2.0 * LARGEST_BIAS - size), 0.0), course.apart)
    course.offset = course.apart + bias
    for k in (ALL, NO_TWIST, NO_FORCE):
        memory.state[k, BIAS_RATE] = bias
        for i in range(STATES):
            memory.covariance[k, BIAS_RATE, i] = memory.covariance[k, i, BIAS_RATE] = 0.0
        memory.covariance[k, BIAS_RATE, BIAS_RATE] = (0.1 * LARGEST_BIAS) ** 2
