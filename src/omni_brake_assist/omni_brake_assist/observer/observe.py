"""A step of the observer: predict, update by all sources, isolate, estimate the current twist."""

from __future__ import annotations

import math

from omni_brake_assist.observer.filters import carry_on, of_then, remember
from omni_brake_assist.observer.judgment import (
    differences,
    isolate_without_imu,
    judge,
    reset_on_wheel_slip,
    reset_scores,
)
from omni_brake_assist.observer.state import (
    ALL,
    ALONE,
    BIAS_RATE,
    BIAS_X,
    BIAS_Y,
    GYRO,
    NO_ESTIMATE,
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
from omni_brake_assist.observer.twist import learn_rate_offset, update_by_twist
from omni_brake_assist.observer.wheels import update_by_wheels
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_FEW = 4.0  # readings of rolling wheels that contradict no filter [1]
_LOST = 0.1  # time without a twist after which it is the one that has failed [s]


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
    """Advance the observer by a step.

    Args:
        constants: of the vehicle.
        memory: changed in place.
        now_ns: time of validity of the readings [ns].
        brakes: pedal and enables.
        passed: the latest twist.
        sensed: the other sensors.
        answer: receives the twist then [m/s, m/s, rad/s], shape (3,).

    Returns:
        The filter whose answer it is, or NO_ESTIMATE.
    """
    braking, inertial, isolation = brakes.pressed, sensed.inertial, memory.isolation[0]
    received, jumped, twist_ns, twist, variance = passed
    dt = (now_ns - isolation.last_ns) * 1e-9
    isolation.last_ns = now_ns
    if isolation.begun == 0.0 or not 0.0 <= dt <= constants.longest:
        if not received:
            return NO_ESTIMATE
        begin(constants, memory, now_ns, twist)
        dt = 0.0
    _follow_pedal(memory, braking, dt)
    carry_on(constants, memory, now_ns, dt, inertial)
    disputed = isolation.disputed > 0.0 or isolation.out != ALL
    # A twist of before the filters began is not compared.
    fresh = received and twist_ns > isolation.twist_ns and twist_ns >= isolation.since_ns
    if fresh and not (braking or disputed):
        of_then(memory, PATH, twist_ns, memory.workspace.then)
        learn_rate_offset(constants, memory, twist[2], variance[2], memory.workspace.then[GYRO])
    corrected = memory.workspace.corrected
    copy(twist, corrected)
    corrected[2] -= memory.course[0].offset
    ahead = memory.workspace.shift
    if fresh:
        _carry_ahead(constants, memory, twist_ns, corrected, ahead)
    update_by_wheels(
        constants, memory, dt, brakes, sensed, PassedTwist(fresh, jumped, twist_ns, ahead, variance)
    )
    isolation.twist_age = 0.0 if received else isolation.twist_age + dt
    isolation.since_jump = 0.0 if jumped else isolation.since_jump + dt
    if fresh:
        isolation.twist_ns = twist_ns
        update_by_twist(constants, memory, twist_ns, corrected, variance)
    remember(memory)
    compared_ns = twist_ns if fresh else now_ns
    isolation.apart_velocity, isolation.apart_rate = differences(constants, memory, compared_ns)
    if isolation.inertial == 0.0:
        return int(isolate_without_imu(memory, braking))
    if not braking:
        reset_on_wheel_slip(constants, memory, inertial)
    return int(_answer(constants, memory, judge(constants, memory, dt), answer))


@lean
def _follow_pedal(memory: ObserverMemory, braking: bool, dt: float) -> None:
    """Reset isolation as the pedal is released; store biases and motion until it goes down."""
    isolation = memory.isolation[0]
    if braking and isolation.pressed == 0.0:
        memory.released[:] = 0.0
        memory.score[ALONE] = 0.0
    if not braking and isolation.pressed != 0.0:
        isolation.out = isolation.disputed = isolation.agreed = 0.0
        reset_scores(memory)
    if not braking:
        used = int(isolation.out) if isolation.out < NO_ESTIMATE else ALL
        course, state = memory.course[0], memory.state[used]
        course.still_rate, course.still_x = state[BIAS_RATE], state[BIAS_X]
        course.still_y = state[BIAS_Y]
        isolation.top_speed = math.hypot(state[U_X], state[U_Y])
    isolation.pressed = 1.0 if braking else 0.0
    isolation.braked = isolation.braked + dt if braking else 0.0


@lean
def _carry_ahead(
    constants: ObserverConstants,
    memory: ObserverMemory,
    stamp_ns: int,
    twist: FloatArray,
    ahead: FloatArray,
) -> None:
    """Predict a twist to the present by the change of the filter of all sources since its stamp."""
    then, state = memory.workspace.then, memory.state[ALL]
    of_then(memory, ALL, stamp_ns, then)
    turned = state[RATE] - then[RATE]
    ahead[0] = twist[0] + (state[U_X] - then[U_X] + turned * constants.p_y)
    ahead[1] = twist[1] + (state[U_Y] - then[U_Y] - turned * constants.p_x)
    ahead[2] = twist[2] + turned


@lean
def _answer(
    constants: ObserverConstants, memory: ObserverMemory, chosen: int, answer: FloatArray
) -> int:
    """Write the estimate of a filter; return NO_ESTIMATE if wheels or variance reject it."""
    if chosen == NO_ESTIMATE:
        return NO_ESTIMATE
    state, covariance, score = memory.state[chosen], memory.covariance[chosen], memory.score
    alone = chosen != ALL or memory.isolation[0].twist_age > _LOST
    if alone and score[READINGS] > _FEW and score[chosen] > WHEEL_GATE * score[READINGS]:
        memory.isolation[0].out = NO_ESTIMATE  # the wheels contradict the filter that is left
        return NO_ESTIMATE
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
    return NO_ESTIMATE
