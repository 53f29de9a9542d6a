"""Isolation: which of twist, gyro, accelerometer and wheels is faulty."""

from __future__ import annotations

import math

from omni_brake_assist.observer.filters import of_then
from omni_brake_assist.observer.state import (
    ALL,
    ALONE,
    FILTERS,
    HISTORY,
    NO_ESTIMATE,
    NO_FORCE,
    NO_GYRO,
    NO_TWIST,
    RATE,
    READINGS,
    STATES,
    U_X,
    U_Y,
    ObserverConstants,
    ObserverMemory,
    copy,
)
from omni_brake_assist.observer.wheels import driven_slip
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

ALONE_GATE = 60.0  # of the squared innovations of the twist against rolling wheels [1]
_PROOF = 12.0  # difference of the scores of two filters that suffices, chi-square [1]
_LOSS = 10  # steps over which a loss of speed is measured
_AGED = 1.5e7  # age beyond which a twist is not current [ns]
_FORGIVEN = 0.25  # of a dispute for every second without [1]


@lean
def differences(
    constants: ObserverConstants, memory: ObserverMemory, place_ns: int
) -> tuple[float, float]:
    """Return the differences of velocity and yaw rate between sources, divided by their limits.

    Of the time of the newest twist: what has changed since, a filter cannot know that has only
    the twist for it.
    """
    cov, mine, other = memory.covariance, memory.workspace.then, memory.workspace.shift
    speed = memory.isolation[0].top_speed  # the filters still have the errors that they had then
    of_then(memory, NO_TWIST, place_ns, mine)
    of_then(memory, NO_FORCE, place_ns, other)
    worst = 0.0
    for j in range(2):
        gate = constants.velocity_gate + constants.scale * speed
        gate += 3.0 * math.sqrt(cov[NO_TWIST, j, j] + cov[NO_FORCE, j, j])
        worst = max(worst, abs(mine[j] - other[j]) / gate)
    gate = constants.rate_gate + constants.scale * abs(memory.state[ALL, RATE])
    gate += 3.0 * math.sqrt(cov[NO_TWIST, RATE, RATE] + cov[NO_GYRO, RATE, RATE])
    of_then(memory, NO_GYRO, place_ns, other)
    return worst, abs(mine[RATE] - other[RATE]) / gate


@lean
def judge(constants: ObserverConstants, memory: ObserverMemory, dt: float) -> int:
    """Isolate a faulty source; return the filter to use, or NO_ESTIMATE."""
    isolation = memory.isolation[0]
    velocity, rate = isolation.apart_velocity, isolation.apart_rate
    out = int(isolation.out)
    if out != ALL:
        own = rate if out == NO_GYRO else (velocity if out == NO_FORCE else max(velocity, rate))
        speaks = out not in (NO_TWIST, NO_ESTIMATE) or isolation.twist_age == 0.0
        isolation.agreed = isolation.agreed + dt if own < 0.6 and speaks else 0.0
        if isolation.agreed < constants.recovery_time:
            return int(out)
        isolation.out = ALL
        isolation.disputed = 0.0
        _reinitialize(memory, out)
    if velocity < 1.0 and rate < 1.0:
        isolation.disputed = max(isolation.disputed - _FORGIVEN * dt, 0.0)
        # If the specific force does not explain the changes of the twist, the twist is used alone.
        age = isolation.last_ns - isolation.twist_ns
        return ALL if age > _AGED or _explains(constants, memory) else NO_FORCE
    if isolation.disputed <= 0.0:  # only later readings count
        reset_scores(memory)
    isolation.disputed += dt
    better, decided = _isolate(constants, memory, rate >= velocity)
    if not decided and isolation.disputed < constants.patience:
        return int(better)
    isolation.out = better if decided else NO_ESTIMATE
    isolation.agreed = 0.0
    return int(isolation.out)


@lean
def _reinitialize(memory: ObserverMemory, right: int) -> None:
    """Start all filters from the one that has excluded the faulty sensor."""
    if right == NO_ESTIMATE:
        return
    reset_scores(memory)
    for k in range(FILTERS):
        if k != right:
            copy(memory.state[right], memory.state[k])
            for i in range(STATES):
                copy(memory.covariance[right, i], memory.covariance[k, i])
            row = memory.newest[0]
            for _ in range(HISTORY):
                copy(memory.past[row, right], memory.past[row, k])
                row = (row - 1) % HISTORY


@lean
def _explains(constants: ObserverConstants, memory: ObserverMemory) -> bool:
    """Return whether the specific force explains how the twist changes, with either yaw rate."""
    course = memory.course[0]
    with_gyro = course.change_x**2 + course.change_y**2
    with_own = (course.change_x - course.turn_x) ** 2 + (course.change_y - course.turn_y) ** 2
    return bool(min(with_gyro, with_own) <= constants.proof * course.spread)


@lean
def reset_scores(memory: ObserverMemory) -> None:
    """Reset the accumulated innovations of the wheels."""
    memory.score[:FILTERS] = 0.0
    memory.score[READINGS] = 0.0


@lean
def _explain(constants: ObserverConstants, memory: ObserverMemory) -> tuple[int, bool]:
    """Return the filter whose yaw rate explains how the twist changes, and whether that suffices.

    A twist that neither rate explains is faulty.
    """
    course = memory.course[0]
    with_gyro = course.change_x**2 + course.change_y**2
    with_own = (course.change_x - course.turn_x) ** 2 + (course.change_y - course.turn_y) ** 2
    right = NO_TWIST if with_gyro <= with_own else NO_GYRO
    if not _explains(constants, memory):
        return NO_TWIST, True
    return right, abs(with_gyro - with_own) > constants.proof * course.spread


@lean
def _isolate(
    constants: ObserverConstants, memory: ObserverMemory, about_rate: bool
) -> tuple[int, bool]:
    """Return the fault-free one of two filters that disagree, and whether that is certain."""
    score = memory.score
    if memory.isolation[0].since_jump < constants.recovery_time:  # faster than any vehicle moves
        return NO_TWIST, True
    right, decided = _explain(constants, memory) if about_rate else _who_loses(constants, memory)
    if about_rate and decided:
        return right, True
    other = NO_GYRO if about_rate else NO_FORCE
    better = NO_TWIST if score[NO_TWIST] <= score[other] else other
    worse = other if better == NO_TWIST else NO_TWIST
    if score[worse] > 3.0 * score[better] + _PROOF:
        return better, True
    if about_rate:
        return right, False
    if decided:
        return right, memory.isolation[0].disputed >= 0.5 * constants.patience
    return better, False


@lean
def _who_loses(constants: ObserverConstants, memory: ObserverMemory) -> tuple[int, bool]:
    """Return the filter whose loss of speed is that of a stop, and whether the other's is not.

    Brakes that have acted for as long dissipate energy, at most what tires allow: a filter without
    the loss of the other one is faulty, and so is one with too much of it.
    """
    state = memory.state
    row = (memory.newest[0] - _LOSS) % HISTORY
    past = memory.past[row]
    most = constants.walk * (memory.stamps[memory.newest[0]] - memory.stamps[row]) * 1e-9
    loss = memory.workspace.then
    for k in (NO_TWIST, NO_FORCE):
        loss[k] = math.hypot(past[k, U_X], past[k, U_Y])
        loss[k] -= math.hypot(state[k, U_X], state[k, U_Y])
    more = NO_TWIST if loss[NO_TWIST] > loss[NO_FORCE] else NO_FORCE
    less = NO_FORCE if more == NO_TWIST else NO_TWIST
    if loss[more] > most:
        return less, True
    braked = (
        memory.isolation[0].braked * 1e9 >= memory.stamps[memory.newest[0]] - memory.stamps[row]
    )
    return more, bool(braked and loss[more] > 0.15 and loss[less] < 0.3 * loss[more])


@lean
def isolate_without_imu(memory: ObserverMemory, braking: bool) -> int:
    """Decide without an IMU: the twist must fit the wheels that roll."""
    isolation = memory.isolation[0]
    if braking and memory.score[ALONE] > ALONE_GATE:
        isolation.out = NO_ESTIMATE
    return NO_ESTIMATE if isolation.out != ALL else ALL


@lean
def reset_on_wheel_slip(
    constants: ObserverConstants, memory: ObserverMemory, inertial: FloatArray
) -> None:
    """Reset the filter without twist to the twist where driven wheels slip, pedal up.

    It has no other velocity then. Its variance is that of the slip, so that rolling wheels correct
    it once the pedal is down.
    """
    state = memory.state[ALL]
    slip_deviation = driven_slip(memory, inertial) * math.hypot(state[U_X], state[U_Y])
    slides = (
        _is_settled(constants, memory)
        and slip_deviation > constants.velocity_gate
        and _explains(constants, memory)
    )
    if slides or _is_slipping(constants, memory):
        copy(state, memory.state[NO_TWIST])
        for i in range(STATES):
            copy(memory.covariance[ALL, i], memory.covariance[NO_TWIST, i])
        memory.covariance[NO_TWIST, U_X, U_X] += slip_deviation**2
        memory.covariance[NO_TWIST, U_Y, U_Y] += slip_deviation**2


@lean
def _is_slipping(constants: ObserverConstants, memory: ObserverMemory) -> bool:
    """Return whether driven wheels cause the dispute of twist and IMU, pedal up.

    These agree on how the velocity changes; the velocity without twist is that of the wheels.
    """
    velocity, _ = differences(constants, memory, memory.stamps[memory.newest[0]])
    return bool(_is_settled(constants, memory) and velocity >= 1.0 and _explains(constants, memory))


@lean
def _is_settled(constants: ObserverConstants, memory: ObserverMemory) -> bool:
    """Return whether there is a twist that only the wheels may contradict."""
    isolation, course = memory.isolation[0], memory.course[0]
    known = isolation.out == ALL and course.marked != 0.0
    steady = isolation.since_jump >= constants.recovery_time and isolation.apart_rate < 1.0
    return bool(known and steady)
