"""A step of the observer: predict, update by all sources, isolate, estimate the twist of now."""

from __future__ import annotations

import math

from omni_brake_assist.observer.filters import carry_on, of_then, remember
from omni_brake_assist.observer.judgment import (
    acquit,
    compare_path,
    differences,
    excuse_wheels,
    judge,
    judge_alone,
    start_path,
)
from omni_brake_assist.observer.state import (
    ALL,
    ALONE,
    BIAS_RATE,
    BIAS_X,
    BIAS_Y,
    GYRO,
    NOBODY,
    PATH,
    RATE,
    READINGS,
    U_X,
    U_Y,
    WHEEL_GATE,
    Brakes,
    ObserverConstants,
    ObserverMemory,
    PassedTwist,
    Sensed,
    begin,
    copy,
)
from omni_brake_assist.observer.twist import hear_twist, tell_apart
from omni_brake_assist.observer.wheels import hear_wheels
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_FEW = 4.0  # readings of rolling wheels that contradict no filter [1]
_LOST = 0.1  # time without a twist after which it is the one that has failed [s]
_LONG_HELD = 5e7  # time between two twists of a slow sensor [ns]


@lean
def observe_at(
    constants: ObserverConstants,
    memory: ObserverMemory,
    now_ns: int,
    brakes: Brakes,
    passed: PassedTwist,
    sensed: Sensed,
    answer: FloatArray,
) -> int:
    """Carry the second opinion on by a step.

    Args:
        constants: of the vehicle.
        memory: changed in place.
        now_ns: time of which the sensors speak [ns].
        brakes: what they do.
        passed: the latest twist.
        sensed: what the other sensors say.
        answer: receives the twist then [m/s, m/s, rad/s], shape (3,).

    Returns:
        The filter whose answer it is, or NOBODY where none can be believed.
    """
    braking, inertial, belief = brakes.pressed, sensed.inertial, memory.belief[0]
    heard, jumped, twist_ns, twist, variance = passed
    dt = (now_ns - belief.last_ns) * 1e-9
    belief.last_ns = now_ns
    if belief.begun == 0.0 or not 0.0 <= dt <= constants.longest:
        if not heard:
            return NOBODY
        begin(constants, memory, now_ns, twist)
        dt = 0.0
    _follow_pedal(memory, braking, dt)
    carry_on(constants, memory, now_ns, dt, inertial)
    lost = braking and belief.twist_age > _LOST  # who else contradicts everybody is right
    disputed = belief.disputed > 0.0 or belief.out != ALL or lost
    # What was before the filters began is compared with nobody.
    fresh = heard and twist_ns > belief.twist_ns and twist_ns >= belief.since_ns
    if fresh and not (braking or disputed):
        of_then(memory, PATH, twist_ns, memory.desk.then)
        tell_apart(constants, memory, twist[2], variance[2], memory.desk.then[GYRO])
    told = memory.desk.told
    copy(twist, told)
    told[2] -= memory.course[0].offset
    ahead = memory.desk.shift
    if fresh:
        _carry_ahead(constants, memory, twist_ns, told, ahead)
    hear_wheels(
        constants, memory, dt, brakes, sensed, PassedTwist(fresh, jumped, twist_ns, ahead, variance)
    )
    belief.twist_age = 0.0 if heard else belief.twist_age + dt
    belief.since_jump = 0.0 if jumped else belief.since_jump + dt
    if fresh:
        belief.twist_ns = twist_ns
        hear_twist(constants, memory, twist_ns, told, variance)
    remember(memory)  # as it is known now
    if fresh or now_ns - belief.twist_ns > _LONG_HELD:  # in between the filters drift apart
        compared_ns = twist_ns if fresh else now_ns
        belief.apart_velocity, belief.apart_rate = differences(constants, memory, compared_ns)
    if belief.inertial == 0.0:
        return int(judge_alone(memory, braking))
    if not braking:
        excuse_wheels(constants, memory, inertial)
    chosen = judge(constants, memory, dt)
    if braking:
        chosen = compare_path(constants, memory, chosen, dt)
    return int(_answer(constants, memory, chosen, answer))


@lean
def _follow_pedal(memory: ObserverMemory, braking: bool, dt: float) -> None:
    """Reset isolation as the pedal is released; store biases and motion until it goes down."""
    belief = memory.belief[0]
    if braking and belief.pressed == 0.0:
        memory.released[:] = 0.0
        memory.score[ALONE] = 0.0
    if not braking and belief.pressed != 0.0:
        belief.out = belief.disputed = belief.agreed = belief.convictions = 0.0
        acquit(memory)
    if not braking:
        believed = int(belief.out) if belief.out < NOBODY else ALL
        course, state = memory.course[0], memory.state[believed]
        course.still_rate, course.still_x = state[BIAS_RATE], state[BIAS_X]
        course.still_y = state[BIAS_Y]
        start_path(memory, believed)
        belief.top_speed = math.hypot(state[U_X], state[U_Y])
    belief.pressed = 1.0 if braking else 0.0
    belief.braked = belief.braked + dt if braking else 0.0


@lean
def _carry_ahead(
    constants: ObserverConstants,
    memory: ObserverMemory,
    stamp_ns: int,
    twist: FloatArray,
    ahead: FloatArray,
) -> None:
    """Write what a twist of the past would be now, as all together have the change since."""
    then, state = memory.desk.then, memory.state[ALL]
    of_then(memory, ALL, stamp_ns, then)
    turned = state[RATE] - then[RATE]
    ahead[0] = twist[0] + (state[U_X] - then[U_X] + turned * constants.p_y)
    ahead[1] = twist[1] + (state[U_Y] - then[U_Y] - turned * constants.p_x)
    ahead[2] = twist[2] + turned


@lean
def _answer(
    constants: ObserverConstants, memory: ObserverMemory, chosen: int, answer: FloatArray
) -> int:
    """Write the answer of a filter; return NOBODY where it is not good enough."""
    if chosen == NOBODY:
        return NOBODY
    state, covariance, score = memory.state[chosen], memory.covariance[chosen], memory.score
    alone = chosen != ALL or memory.belief[0].twist_age > _LOST
    if alone and score[READINGS] > _FEW and score[chosen] > WHEEL_GATE * score[READINGS]:
        memory.belief[0].out = NOBODY  # the wheels contradict the filter that is left
        return NOBODY
    answer[0] = state[U_X] + state[RATE] * constants.p_y
    answer[1] = state[U_Y] - state[RATE] * constants.p_x
    answer[2] = state[RATE]
    spread = max(covariance[U_X, U_X], covariance[U_Y, U_Y])
    if (
        spread <= constants.velocity_deviation**2
        and covariance[RATE, RATE] <= constants.rate_deviation**2
        and math.isfinite(answer[0] + answer[1] + answer[2])
    ):
        return chosen
    return NOBODY
