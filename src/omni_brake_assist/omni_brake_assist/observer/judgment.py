"""Isolation: which of twist, gyro, accelerometer and wheels is faulty."""

from __future__ import annotations

import math

from omni_brake_assist.observer.filters import of_then
from omni_brake_assist.observer.state import (
    ALL,
    ALONE,
    FILTERS,
    GAIN_X,
    GAIN_Y,
    GYRO,
    HEADING,
    HISTORY,
    NO_FORCE,
    NO_GYRO,
    NO_TWIST,
    NOBODY,
    PATH,
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
_PROOF = 12.0  # by how much the scores of two filters must differ
_LOSS = 10  # steps over which a loss of speed is looked at
_AGED = 1.5e7  # age from which on a twist says little of now [ns]
_FORGIVEN = 0.25  # of a dispute for every second without [1]


@lean
def differences(
    constants: ObserverConstants, memory: ObserverMemory, place_ns: int
) -> tuple[float, float]:
    """Return the disagreements on velocity and yaw rate in units of what is no dispute.

    Of the time of the newest twist: what has changed since, a filter cannot know that has only
    the twist for it.
    """
    cov, mine, other = memory.covariance, memory.desk.then, memory.desk.shift
    speed = memory.belief[0].top_speed  # the filters still have the errors that they had then
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
    """Decide whom to leave out; return the filter to use, or NOBODY."""
    belief = memory.belief[0]
    velocity, rate = belief.apart_velocity, belief.apart_rate
    out = int(belief.out)
    if out != ALL:
        own = rate if out == NO_GYRO else (velocity if out == NO_FORCE else max(velocity, rate))
        speaks = out not in (NO_TWIST, NOBODY) or belief.twist_age == 0.0
        belief.agreed = belief.agreed + dt if own < 0.6 and speaks else 0.0
        if belief.agreed < constants.parole or belief.convictions >= constants.convictions:
            return int(out)
        belief.out = ALL
        belief.disputed = 0.0
        _reinitialize(memory, out)
    if velocity < 1.0 and rate < 1.0:
        belief.disputed = max(belief.disputed - _FORGIVEN * dt, 0.0)
        # While the twist changes otherwise than the specific force has it, it is taken as it is.
        age = belief.last_ns - belief.twist_ns
        return ALL if age > _AGED or _explains(constants, memory) else NO_FORCE
    if belief.disputed <= 0.0:  # only what is said from now on counts
        acquit(memory)
    belief.disputed += dt
    better, decided = _verdict(constants, memory, rate >= velocity)
    if not decided and belief.disputed < constants.patience:
        return int(better)
    belief.out = better if decided else NOBODY
    belief.agreed = 0.0
    belief.convictions += 1.0
    return int(belief.out)


@lean
def _reinitialize(memory: ObserverMemory, right: int) -> None:
    """Start all filters from the one that has excluded the faulty sensor."""
    if right == NOBODY:
        return
    acquit(memory)
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
def acquit(memory: ObserverMemory) -> None:
    """Forget what wheels have said against the filters."""
    memory.score[:FILTERS] = 0.0
    memory.score[READINGS] = 0.0


@lean
def _explain(constants: ObserverConstants, memory: ObserverMemory) -> tuple[int, bool]:
    """Return the filter whose yaw rate explains how the twist changes, and whether it is proven.

    A twist that neither rate explains is wrong itself.
    """
    course = memory.course[0]
    with_gyro = course.change_x**2 + course.change_y**2
    with_own = (course.change_x - course.turn_x) ** 2 + (course.change_y - course.turn_y) ** 2
    right = NO_TWIST if with_gyro <= with_own else NO_GYRO
    if not _explains(constants, memory):
        return NO_TWIST, True
    return right, abs(with_gyro - with_own) > constants.proof * course.spread


@lean
def _verdict(
    constants: ObserverConstants, memory: ObserverMemory, about_rate: bool
) -> tuple[int, bool]:
    """Return the filter that is right in a dispute, and whether that is proven."""
    score = memory.score
    if memory.belief[0].since_jump < constants.parole:  # no vehicle moves like this
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
        return right, memory.belief[0].disputed >= 0.5 * constants.patience
    return better, False


@lean
def _who_loses(constants: ObserverConstants, memory: ObserverMemory) -> tuple[int, bool]:
    """Return the filter whose loss of speed is that of a stop, and whether the other's is not.

    Brakes that have acted for as long take energy, and no more than tires can: who sees none of the
    loss that the other sees is wrong, and who sees too much of it.
    """
    state = memory.state
    row = (memory.newest[0] - _LOSS) % HISTORY
    past = memory.past[row]
    most = constants.walk * (memory.stamps[memory.newest[0]] - memory.stamps[row]) * 1e-9
    loss = memory.desk.then
    for k in (NO_TWIST, NO_FORCE):
        loss[k] = math.hypot(past[k, U_X], past[k, U_Y])
        loss[k] -= math.hypot(state[k, U_X], state[k, U_Y])
    more = NO_TWIST if loss[NO_TWIST] > loss[NO_FORCE] else NO_FORCE
    less = NO_FORCE if more == NO_TWIST else NO_TWIST
    if loss[more] > most:
        return less, True
    braked = memory.belief[0].braked * 1e9 >= memory.stamps[memory.newest[0]] - memory.stamps[row]
    return more, bool(braked and loss[more] > 0.15 and loss[less] < 0.3 * loss[more])


@lean
def start_path(memory: ObserverMemory, k: int) -> None:
    """Start the path, the integrated specific force, at the velocity of a filter."""
    course, path, state = memory.course[0], memory.state[PATH], memory.state[k]
    c, s = math.cos(path[HEADING]), math.sin(path[HEADING])
    course.start_x = c * state[U_X] - s * state[U_Y] - path[GAIN_X]
    course.start_y = s * state[U_X] + c * state[U_Y] - path[GAIN_Y]
    course.start_variance = max(memory.covariance[k, U_X, U_X], memory.covariance[k, U_Y, U_Y])


@lean
def compare_path(
    constants: ObserverConstants, memory: ObserverMemory, chosen: int, dt: float
) -> int:
    """Return the filter to use, NOBODY where the path since the pedal contradicts it.

    A fault that twist and wheels share moves every filter that uses one of them; the specific
    force integrated since the pedal went down uses none. Its error grows with that of the bias.
    """
    belief, course, path = memory.belief[0], memory.course[0], memory.state[PATH]
    if chosen not in (ALL, NO_TWIST) or not math.isfinite(path[GYRO]):
        belief.unexplained = 0.0
        return chosen
    state = memory.state[chosen]
    c, s = math.cos(path[HEADING]), math.sin(path[HEADING])
    x = c * state[U_X] - s * state[U_Y] - path[GAIN_X] - course.start_x
    y = s * state[U_X] + c * state[U_Y] - path[GAIN_Y] - course.start_y
    drift = course.start_variance + (constants.bias * belief.braked) ** 2
    gate = constants.velocity_gate + constants.scale * belief.top_speed + 3.0 * math.sqrt(drift)
    belief.unexplained = belief.unexplained + dt if math.hypot(x, y) > gate else 0.0
    if belief.unexplained < constants.patience:
        return chosen
    belief.out = NOBODY
    belief.agreed = belief.unexplained = 0.0
    belief.convictions += 1.0
    return NOBODY


@lean
def judge_alone(memory: ObserverMemory, braking: bool) -> int:
    """Decide without an IMU: the twist must fit the wheels that roll."""
    belief = memory.belief[0]
    if braking and memory.score[ALONE] > ALONE_GATE:
        belief.out = NOBODY
        belief.convictions += 1.0
    return NOBODY if belief.out != ALL else ALL


@lean
def excuse_wheels(
    constants: ObserverConstants, memory: ObserverMemory, inertial: FloatArray
) -> None:
    """Let the filter without twist start from it where driven wheels slip, pedal up.

    How fast the vehicle is, it knows from nobody else then; by how much they may slip, it doubts
    that, and wheels that roll correct it once the pedal is down.
    """
    state = memory.state[ALL]
    doubt = driven_slip(memory, inertial) * math.hypot(state[U_X], state[U_Y])
    slides = (
        _is_settled(constants, memory)
        and doubt > constants.velocity_gate
        and _explains(constants, memory)
    )
    if slides or _is_slipping(constants, memory):
        copy(state, memory.state[NO_TWIST])
        for i in range(STATES):
            copy(memory.covariance[ALL, i], memory.covariance[NO_TWIST, i])
        memory.covariance[NO_TWIST, U_X, U_X] += doubt**2
        memory.covariance[NO_TWIST, U_Y, U_Y] += doubt**2


@lean
def _is_slipping(constants: ObserverConstants, memory: ObserverMemory) -> bool:
    """Return whether driven wheels are what pulls twist and IMU apart, pedal up.

    These agree on how the velocity changes, and the filter without twist has its velocity from
    the wheels.
    """
    velocity, _ = differences(constants, memory, memory.stamps[memory.newest[0]])
    return bool(_is_settled(constants, memory) and velocity >= 1.0 and _explains(constants, memory))


@lean
def _is_settled(constants: ObserverConstants, memory: ObserverMemory) -> bool:
    """Return whether there is a twist that nobody has reason to doubt but for its velocity."""
    belief, course = memory.belief[0], memory.course[0]
    known = belief.out == ALL and course.marked != 0.0
    steady = belief.since_jump >= constants.parole and belief.apart_rate < 1.0
    return bool(known and steady)
