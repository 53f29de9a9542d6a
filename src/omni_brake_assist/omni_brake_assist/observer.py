"""A second opinion on the motion: who of twist, gyro, accelerometer and wheels is to be believed.

Four extended Kalman filters run side by side on the state ``(u_x, u_y, Omega, b_g, b_x, b_y)``:
velocity ``u = v + Omega k x p`` of the place ``p`` where the IMU is mounted, in the body frame, yaw
rate, and the biases of gyro and accelerometer. One hears everybody, each of the others leaves one
of twist, gyro and accelerometer out. At the mounting the specific force ``f`` needs no angular
acceleration,

    u' = R(-Omega dt) u + R(-Omega dt / 2) (f - b) dt

and without an accelerometer the velocity walks at random within what tires can do. Measured are

    gyro           Omega + b_g
    twist          v = u - Omega k x p, Omega          (at its own stamp: see below)
    rolling wheel  n_w . u + (lever + n_wx p_y - n_wy p_x) Omega = R omega n_w . u_w

A wheel rolls while the pedal is up, and when its brake has been released for long enough for it to
have spun up; it says one component of the motion exactly and knows neither of the IMU nor
of the twist. A twist that comes late is compared with the state of its stamp and corrects that of
now, so the answer is always of now.

Consistency decides whom to believe (parity by leaving one out). The filters without twist and
without accelerometer must agree on the velocity, those without twist and without gyro on the yaw
rate. Where they do not, one of two channels lies. Witnesses say which: the wheels that roll
contradict the filter that believes it; in a dispute about the velocity, who sees none of the loss
that braking wheels cause is wrong; in one about the yaw rate, the right one explains how the
velocity of the twist changes. A twist that leaps, or that braking does not change, has no case.
In axes that turn with the gyro ``U' = f`` if the gyro is right; by
the twist's own rate it should change by another ``(Omega - gyro) k x U``. Both are added up over
the last `memory`, so that a rate that is off by little shows too; a twist that neither explains is
wrong itself. What is convicted is left out until it has agreed with
the others for a while, the third time until the pedal is released. Until there is a verdict the
filter that fits better is used; if there is none in time, nobody is believed. A wheel that
contradicts all filters is not heard. Without an IMU the twist must fit the wheels that roll, and
lose speed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_platform.geometry import PlatformGeometry, cross
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

IntArray = NDArray[np.int64]

# Entries of the scores behind those of the filters: the twist against the wheels by itself, how
# many wheels have spoken lately.
ALONE, SPOKEN = 4, 5
SCORES = 6

# The filters, by who is left out.
ALL, NO_TWIST, NO_GYRO, NO_FORCE = range(4)
FILTERS = 4
_U_X, _U_Y, _RATE, _BIAS_RATE, _BIAS_X, _BIAS_Y = range(6)
STATES = 6

# A fifth row of states is the path of the IMU alone: its heading by the gyro [rad], what the
# specific force has added to the velocity since in axes that do not turn [m/s], its last rate.
PATH = 4
_HEADING, _GAIN_X, _GAIN_Y, _LAST_RATE = range(4)

# Entries of the course: whether there is an earlier twist, its velocity in the axes of the path
# [m/s], its yaw rate [rad/s], its time [ns], the path then, and what twists have lately changed by
# beyond the specific force with the gyro's yaw rate [m/s], what they would have with their own
# yaw rate [m/s], the variance of both [m^2/s^2], the biases when the pedal went down [rad/s],
# [m/s^2], by how much the yaw rates of twist and gyro differ with the pedal up [rad/s], the
# variance of that [rad^2/s^2], how much of it is the twist's [rad/s].
(
    MARKED,
    MARK_X,
    MARK_Y,
    MARK_RATE,
    MARK_NS,
    MARK_HEADING,
    MARK_GAIN_X,
    MARK_GAIN_Y,
    CHANGE_X,
    CHANGE_Y,
    TURN_X,
    TURN_Y,
    SPREAD,
    STILL_RATE,
    STILL_X,
    STILL_Y,
    APART,
    APART_SPREAD,
    OFFSET,
    MARK_SPREAD,
    LEAPT,
    SAME_X,
    SAME_Y,
    SAME,
) = range(24)
COURSE_SIZE = 24

# Who is not believed, beside the filters above: nobody is.
NOBODY = 4

# Entries of the belief: who is left out; time that the dispute has lasted [s]; for how long the one
# left out has agreed again [s]; how often one has been convicted; whether there has been an IMU
# reading; whether the filters have begun; time since the last good twist [s]; time of the last
# step [ns]; time of the newest twist used [ns]; whether the pedal was down; for how long the
# twist has lost no speed [s]; speed when the pedal went down [m/s]; what wheel radii are off by, as
# learnt while the pedal was up [1]; how far velocities and yaw rates were apart at the newest
# twist, see `_differences` [1].
(
    OUT,
    DISPUTED,
    AGREED,
    CONVICTIONS,
    INERTIAL,
    BEGUN,
    TWIST_AGE,
    LAST_NS,
    TWIST_NS,
    PRESSED,
    IDLE,
    TOP_SPEED,
    SCALE,
    APART_VELOCITY,
    APART_RATE,
) = range(15)
BELIEF_SIZE = 15

_FADE = 0.96  # of evidence, per step
_PROOF = 12.0  # by how much the scores of two filters must differ
_LOSS = 10  # steps over which a loss of speed is looked at
_FASTEST_TURN = 50.0  # [rad/s]
_LARGEST_FORCE = 100.0  # [m/s^2]
_LARGEST_SCALE = 0.03  # error of wheel radii that is learnt [1]
_FASTEST_RIM = 200.0  # [m/s]
_APART_WALK = 0.001  # how much that changes from one twist to the next [rad/s]
_LARGEST_BIAS = 0.01  # of a gyro that has been calibrated at rest [rad/s]
_APART = 0.05  # by how much honest yaw rates of twist and gyro may differ [rad/s]
_LONG_HELD = 5e7  # time between two twists of a slow sensor [ns]
_AGED = 1.5e7  # age from which on a twist says little of now [ns]
_LEAP_DEVIATIONS = 5.0  # of two twists, which noise alone does not exceed [1]
_LEAP_MEMORY = 0.3  # for how long a leap counts [s]
_STUCK = 1e-4  # change from twist to twist, below which it does not change [m/s], [rad/s]
_STUCK_TIME = 0.03  # for which it may not while braking, if others say that it should [s]
_MOVES = 0.3  # speed from which on a twist must lose some while braking [m/s]
_DOUBTED = 4.0  # contradictions from which on a wheel is not heard
_GAIN_FADE = 0.7  # of what a rim has gained, per step
_LARGEST_GAIN = 0.2  # of a rim in a step that counts [m/s]
# Slip of driven wheels by acceleration [s^2/m], [s^4/m^2]; all readings of the last steps share it.
_SLIP, _SLIP_GROWTH, _SLIP_SHARED = 0.01, 0.002, 40.0
_HISTORY = 32  # states of the past that a late twist can be compared with

# Rows of the desk: direction of a measurement, gain, state of then, its shift, twist as corrected,
# innovation and spread in each filter, and two of a product of matrices.
_H, _GAIN, _THEN, _SHIFT, _TOLD, _INNOVATION, _SPREAD, _PRODUCT = range(8)
_ROWS = _PRODUCT + 2


class Brakes(NamedTuple):
    """What the brakes do.

    Attributes:
        pressed: whether the pedal is down.
        enable: what they were told in the step before, shape (N,).
    """

    pressed: bool
    enable: FloatArray


class PassedTwist(NamedTuple):
    """A twist after the gate.

    Attributes:
        heard: whether there is one that passed.
        stamp_ns: its stamp [ns].
        value: the twist [m/s, m/s, rad/s], shape (3,).
        variance: of its components, shape (3,).
    """

    heard: bool
    stamp_ns: int
    value: FloatArray
    variance: FloatArray


class Sensed(NamedTuple):
    """What the other sensors say; no numbers where they say nothing.

    Attributes:
        inertial: yaw rate [rad/s] and specific force [m/s^2], shape (3,).
        speeds: of the wheels [rad/s], shape (N,).
    """

    inertial: FloatArray
    speeds: FloatArray


class _RollingWheel(NamedTuple):
    """What a rolling wheel measures: ``h . x`` is `rim` [m/s], with a variance."""

    h: FloatArray
    rim: float
    variance: float


class _Force(NamedTuple):
    """Specific force [m/s^2], and whether it is known."""

    known: bool
    x: float
    y: float


class ObserverConstants(NamedTuple):
    """What never changes.

    Attributes:
        n_x: active directions [1], shape (N,).
        n_y: likewise.
        lever: of the active directions about the mounting of the IMU [m], shape (N,).
        roll: speed along the active direction per wheel speed, ``R n_w . u_w`` [m], shape (N,).
        p_x: mounting of the IMU [m].
        p_y: likewise [m].
        force: uncertainty of the specific force [m/s^2].
        walk: acceleration that tires can make [m/s^2].
        turn: angular acceleration that they can make [rad/s^2].
        gyro: standard deviation of the gyro [rad/s].
        wheel: of the speed of a rolling wheel [m/s].
        scale: relative error of wheel radii and twist [1].
        velocity_gate: disagreement on the velocity that is no dispute [m/s].
        rate_gate: likewise on the yaw rate [rad/s].
        patience: time within which the wheels must settle a dispute [s].
        parole: time of agreement until a convicted channel is heard again [s].
        convictions: after which it stays out.
        velocity_deviation: of the answer, largest [m/s].
        rate_deviation: likewise of the yaw rate [rad/s].
        spin_up: time since its release after which a wheel rolls [s].
        spinning: gain of a rim from which on it still spins up [m/s].
        rebound: how much faster than it rolls a wheel may spin after its release, while the tire
            springs back [m/s].
        blind_rebound: likewise where wheels alone judge the twist [m/s].
        rebound_time: for how long, then it fades [s].
        delay: by which a twist is older than its stamp [ns].
        longest: step across which the filters go on [s].
        memory: time over which changes of the twist are added up [s].
        proof: by how much two explanations of them must differ, in variances [1].
    """

    n_x: FloatArray
    n_y: FloatArray
    lever: FloatArray
    roll: FloatArray
    p_x: float
    p_y: float
    force: float
    walk: float
    turn: float
    gyro: float
    wheel: float
    scale: float
    velocity_gate: float
    rate_gate: float
    patience: float
    parole: float
    convictions: float
    velocity_deviation: float
    rate_deviation: float
    spin_up: float
    spinning: float
    rebound: float
    blind_rebound: float
    rebound_time: float
    delay: float
    longest: float
    memory: float
    proof: float


class ObserverMemory(NamedTuple):
    """What it remembers from step to step.

    Attributes:
        state: of each filter and the path, shape (5, 6).
        covariance: likewise, shape (4, 6, 6).
        belief: see the constants of the module, shape (15,).
        released: for how long each wheel's brake has been released [s], shape (N,).
        rim: the last speed of each rim along the active direction [m/s], shape (N,).
        gain: by how much each rim has lately become faster [m/s], shape (N,).
        doubt: how often each has contradicted everybody lately [1], shape (N,).
        score: how badly wheels fit the filters, see the head of the module [1], shape (6,).
        blame: how much of the scores of the filters each wheel has caused [1], shape (N, 4).
        course: what explains the change of the twist, see the head of the module, shape (24,).
        past: states of the last stamps, a ring, shape (32, 5, 6).
        stamps: of them [ns], -1 where there is none, shape (32,).
        newest: row of the newest of them, shape (1,).
        desk: rows that a step is worked on with, shape (9, 6).
    """

    state: FloatArray
    covariance: FloatArray
    belief: FloatArray
    released: FloatArray
    rim: FloatArray
    gain: FloatArray
    doubt: FloatArray
    score: FloatArray
    blame: FloatArray
    course: FloatArray
    past: FloatArray
    stamps: IntArray
    newest: IntArray
    desk: FloatArray


def observer_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> ObserverConstants:
    """Lay out the constants for the kernel.

    Args:
        configuration: of the assistant.
        geometry: of the wheels.
    """
    p_x, p_y = configuration.imu_x, configuration.imu_y
    n_x, n_y = np.ascontiguousarray(geometry.active.T)
    return ObserverConstants(
        n_x=n_x,
        n_y=n_y,
        lever=cross(geometry.position, geometry.active) + n_x * p_y - n_y * p_x,
        roll=geometry.radius * np.sum(geometry.active * geometry.rolling, axis=1),
        p_x=p_x,
        p_y=p_y,
        force=0.3,
        walk=30.0,
        turn=60.0,
        gyro=0.01,
        wheel=0.03,
        scale=0.015,
        velocity_gate=0.1,
        rate_gate=0.05,
        patience=0.1,
        parole=0.2,
        convictions=3.0,
        velocity_deviation=0.4,
        rate_deviation=0.15,
        # A brake that lags acts for a while after its release.
        spin_up=0.03 + configuration.brake.dead_time + 2.0 * configuration.brake.time_constant,
        spinning=0.1,
        rebound=0.25,
        blind_rebound=0.1,
        rebound_time=0.15,
        delay=float(round(configuration.feedback_delay * 1e9)),
        longest=configuration.maximum_time_step,
        memory=0.2,
        proof=9.0,
    )


def observer_memory(wheels: int) -> ObserverMemory:
    """Return a memory that has seen nothing."""
    return ObserverMemory(
        np.zeros((FILTERS + 1, STATES)),
        np.zeros((FILTERS, STATES, STATES)),
        np.zeros(BELIEF_SIZE),
        np.zeros(wheels),
        np.full(wheels, np.nan),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros(SCORES),
        np.zeros((wheels, FILTERS)),
        np.zeros(COURSE_SIZE),
        np.zeros((_HISTORY, FILTERS + 1, STATES)),
        np.full(_HISTORY, -1, np.int64),
        np.zeros(1, np.int64),
        np.zeros((_ROWS, STATES)),
    )


class _Filter(NamedTuple):
    """State of a filter, shape (6,), and its covariance, shape (6, 6)."""

    state: FloatArray
    covariance: FloatArray


@lean
def _copy(values: FloatArray, target: FloatArray) -> None:
    for i in range(values.size):
        target[i] = values[i]


@lean
def _remember(memory: ObserverMemory) -> None:
    """Write the states of now into the newest row of the past."""
    row = memory.newest[0]
    for k in range(FILTERS + 1):
        _copy(memory.state[k], memory.past[row, k])


@lean
def _begin(memory: ObserverMemory, now_ns: int, twist: FloatArray) -> None:
    """Start all filters at a twist of which little is known."""
    memory.released[:] = 0.0
    memory.rim[:] = math.nan
    memory.gain[:] = 0.0
    memory.doubt[:] = 0.0
    memory.stamps[:] = -1
    memory.score[:] = 0.0
    memory.blame[:] = 0.0
    memory.course[:] = 0.0
    memory.course[APART_SPREAD] = _APART**2
    memory.course[LEAPT] = _LEAP_MEMORY
    belief = memory.belief
    belief[:] = 0.0
    belief[BEGUN] = 1.0
    belief[LAST_NS] = now_ns
    belief[TWIST_NS] = -1.0
    memory.state[:] = 0.0
    memory.covariance[:] = 0.0
    for k in range(FILTERS):
        for j in range(3):
            memory.state[k, j] = twist[j]
            memory.covariance[k, j, j] = 100.0
        memory.covariance[k, _BIAS_RATE, _BIAS_RATE] = _LARGEST_BIAS**2
        memory.covariance[k, _BIAS_X, _BIAS_X] = 0.5**2
        memory.covariance[k, _BIAS_Y, _BIAS_Y] = 0.5**2


@lean
def _predict(
    constants: ObserverConstants,
    state: FloatArray,
    covariance: FloatArray,
    dt: float,
    measured: _Force,
    product: FloatArray,
) -> None:
    """Carry one filter on by a step."""
    inertial, f_x, f_y = measured
    rate, u_x, u_y = state[_RATE], state[_U_X], state[_U_Y]
    cos, sin = math.cos(rate * dt), math.sin(rate * dt)
    state[_U_X], state[_U_Y] = cos * u_x + sin * u_y, cos * u_y - sin * u_x
    spread = constants.walk
    if inertial:
        spread = constants.force
        a_x, a_y = f_x - state[_BIAS_X], f_y - state[_BIAS_Y]
        half_c, half_s = math.cos(0.5 * rate * dt), math.sin(0.5 * rate * dt)
        state[_U_X] += dt * (half_c * a_x + half_s * a_y)
        state[_U_Y] += dt * (half_c * a_y - half_s * a_x)
    # Rows of the Jacobian that differ from those of the unit matrix.
    t_x, t_y = dt * state[_U_Y], -dt * state[_U_X]
    bias = -dt if inertial else 0.0
    for j in range(STATES):
        p_x, p_y = covariance[_U_X, j], covariance[_U_Y, j]
        turn = covariance[_RATE, j]
        product[0, j] = cos * p_x + sin * p_y + t_x * turn + bias * covariance[_BIAS_X, j]
        product[1, j] = cos * p_y - sin * p_x + t_y * turn + bias * covariance[_BIAS_Y, j]
    for j in range(STATES):
        covariance[_U_X, j], covariance[_U_Y, j] = product[0, j], product[1, j]
    for i in range(STATES):
        p_x, p_y = covariance[i, _U_X], covariance[i, _U_Y]
        turn = covariance[i, _RATE]
        covariance[i, _U_X] = cos * p_x + sin * p_y + t_x * turn + bias * covariance[i, _BIAS_X]
        covariance[i, _U_Y] = cos * p_y - sin * p_x + t_y * turn + bias * covariance[i, _BIAS_Y]
    covariance[_U_X, _U_X] += (spread * dt) ** 2
    covariance[_U_Y, _U_Y] += (spread * dt) ** 2
    covariance[_RATE, _RATE] += (constants.turn * dt) ** 2


@lean
def _spread(covariance: FloatArray, h: FloatArray) -> float:
    """Return the variance of ``h . x``."""
    total = 0.0
    for i in range(STATES):
        if h[i] != 0.0:
            for j in range(STATES):
                total += h[i] * covariance[i, j] * h[j]
    return total


@lean
def _correct(
    filtered: _Filter, h: FloatArray, innovation: float, variance: float, gain: FloatArray
) -> None:
    """Correct one filter by a scalar measurement ``h . x``; its gain is left in `gain`."""
    state, covariance = filtered
    total = variance
    for i in range(STATES):
        gain[i] = 0.0
        for j in range(STATES):
            gain[i] += covariance[i, j] * h[j]
        total += h[i] * gain[i]
    for i in range(STATES):
        state[i] += gain[i] * innovation / total
    for i in range(STATES):
        for j in range(STATES):
            covariance[i, j] -= gain[i] * gain[j] / total


@lean
def _of_then(memory: ObserverMemory, k: int, stamp_ns: int, then: FloatArray) -> None:
    """Write the state of a filter at a time; the oldest known one if it is longer ago."""
    row = memory.newest[0]
    _copy(memory.state[k], then)
    later_ns = memory.stamps[row]
    for _ in range(_HISTORY - 1):
        if later_ns <= stamp_ns:
            return
        row = (row - 1) % _HISTORY
        earlier_ns = memory.stamps[row]
        if earlier_ns < 0 or earlier_ns >= later_ns:
            return
        if earlier_ns <= stamp_ns:
            share = (later_ns - stamp_ns) / (later_ns - earlier_ns)
            for j in range(STATES):
                then[j] += share * (memory.past[row, k, j] - then[j])
            return
        _copy(memory.past[row, k], then)
        later_ns = earlier_ns


@lean
def _hear_twist(
    constants: ObserverConstants,
    memory: ObserverMemory,
    stamp_ns: int,
    twist: FloatArray,
    variance: FloatArray,
) -> None:
    """Correct the filters that hear the twist by it."""
    h, then, shift = memory.desk[_H], memory.desk[_THEN], memory.desk[_SHIFT]
    speed = constants.scale * math.hypot(twist[0], twist[1])
    own = constants.wheel**2 + (0.3 * speed) ** 2
    p_x, p_y = constants.p_x, constants.p_y
    place_ns = stamp_ns - int(constants.delay)
    _follow_twist(constants, memory, place_ns, twist, variance)
    for k in range(FILTERS):
        if k == NO_TWIST:
            continue
        state, covariance = memory.state[k], memory.covariance[k]
        _of_then(memory, k, place_ns, then)
        _copy(state, shift)
        for j in range(3):
            h[:] = 0.0
            if j == _RATE:
                h[_RATE] = 1.0
            else:
                h[j] = 1.0
                h[_RATE] = p_y if j == 0 else -p_x
            # The state may have been corrected by the components before.
            predicted = 0.0
            for i in range(STATES):
                predicted += h[i] * (then[i] + state[i] - shift[i])
            spread = variance[j] + (constants.gyro**2 if j == _RATE else own)
            filtered = _Filter(state, covariance)
            _correct(filtered, h, twist[j] - predicted, spread, memory.desk[_GAIN])
        for i in range(STATES):
            shift[i] = state[i] - shift[i]
        _correct_past(memory, k, place_ns, shift)


@lean
def _correct_past(memory: ObserverMemory, k: int, since_ns: int, shift: FloatArray) -> None:
    """Shift what a filter remembers, or the next late twist would correct it once more."""
    row = (memory.newest[0] - 1) % _HISTORY
    while row != memory.newest[0] and memory.stamps[row] >= since_ns:
        for i in range(STATES):
            memory.past[row, k, i] += shift[i]
        row = (row - 1) % _HISTORY


@lean
def _follow_twist(
    constants: ObserverConstants,
    memory: ObserverMemory,
    place_ns: int,
    twist: FloatArray,
    variance: FloatArray,
) -> None:
    """Add up what the twist changes by, and what each yaw rate explains of it.

    In axes that turn with the gyro, ``U' = f`` if the gyro is right. If the twist's rate is, they
    turn too far by ``d = Omega - gyro``, and the change beyond ``f`` is ``d k x U``.
    """
    course, path = memory.course, memory.desk[_THEN]
    _of_then(memory, PATH, place_ns, path)
    u_x = twist[0] - twist[2] * constants.p_y
    u_y = twist[1] + twist[2] * constants.p_x
    c, s = math.cos(path[_HEADING]), math.sin(path[_HEADING])
    x, y = c * u_x - s * u_y, s * u_x + c * u_y
    dt = (place_ns - course[MARK_NS]) * 1e-9
    if course[MARKED] != 0.0 and 0.0 < dt <= constants.longest:
        keep = math.exp(-dt / constants.memory)
        change_x = x - course[MARK_X] - (path[_GAIN_X] - course[MARK_GAIN_X])
        change_y = y - course[MARK_Y] - (path[_GAIN_Y] - course[MARK_GAIN_Y])
        own = 0.5 * (twist[2] + course[MARK_RATE]) * dt
        turn = path[_HEADING] - course[MARK_HEADING] - own
        _notice_leap(constants, course, variance, dt, (x, y, turn))
        course[CHANGE_X] = keep * course[CHANGE_X] + change_x
        course[CHANGE_Y] = keep * course[CHANGE_Y] + change_y
        course[TURN_X] = keep * course[TURN_X] - turn * 0.5 * (y + course[MARK_Y])
        course[TURN_Y] = keep * course[TURN_Y] + turn * 0.5 * (x + course[MARK_X])
        spread = 2.0 * max(variance[0], variance[1]) + constants.wheel**2
        course[SPREAD] = keep * course[SPREAD] + (1.0 - keep) * spread
    else:
        course[CHANGE_X:SPREAD] = 0.0
        course[SPREAD] = 2.0 * max(variance[0], variance[1]) + constants.wheel**2
    course[MARKED], course[MARK_X], course[MARK_Y] = 1.0, x, y
    course[MARK_SPREAD] = max(variance[0], variance[1])
    course[MARK_RATE], course[MARK_NS] = twist[2], place_ns
    course[MARK_HEADING] = path[_HEADING]
    course[MARK_GAIN_X], course[MARK_GAIN_Y] = path[_GAIN_X], path[_GAIN_Y]


@lean
def _notice_leap(
    constants: ObserverConstants,
    course: FloatArray,
    variance: FloatArray,
    dt: float,
    moved: tuple[float, float, float],
) -> None:
    """See whether the twist has changed by more than tires and its own noise can, with any rate."""
    x, y, turn = moved
    change_x, change_y = x - course[MARK_X], y - course[MARK_Y]
    change = min(
        math.hypot(change_x, change_y), math.hypot(change_x + turn * y, change_y - turn * x)
    )
    spread = max(variance[0], variance[1]) + course[MARK_SPREAD] + 2.0 * constants.wheel**2
    if change > constants.walk * dt + _LEAP_DEVIATIONS * math.sqrt(spread):
        course[LEAPT] = 0.0


@lean
def _notice_stuck(
    constants: ObserverConstants, memory: ObserverMemory, braking: bool, twist: PassedTwist
) -> None:
    """Book for how long braking has not changed the twist, once brakes have had time to act."""
    course, value = memory.course, twist.value
    changed = abs(value[0] - course[SAME_X]) > _STUCK or abs(value[1] - course[SAME_Y]) > _STUCK
    changed = changed or abs(value[2] - course[MARK_RATE]) > _STUCK
    course[SAME_X], course[SAME_Y] = value[0], value[1]
    course[SAME] += (twist.stamp_ns - memory.belief[TWIST_NS]) * 1e-9
    if not braking:
        course[SAME] = -constants.spin_up
    elif changed:
        course[SAME] = min(course[SAME], 0.0)


@lean
def _fade(memory: ObserverMemory) -> int:
    """Let what wheels have said count for less; return how many contradict everybody."""
    strangers = 0
    for i in range(memory.doubt.size):
        strangers += memory.doubt[i] >= _DOUBTED
        for k in range(FILTERS):
            memory.blame[i, k] *= _FADE
    for k in range(FILTERS):
        memory.score[k] *= _FADE
    memory.score[SPOKEN] *= _FADE
    return strangers


@lean
def _hear_wheels(
    constants: ObserverConstants,
    memory: ObserverMemory,
    dt: float,
    brakes: Brakes,
    sensed: Sensed,
    disputed: bool,
    twist: PassedTwist,
) -> None:
    """Find the wheels that roll, see whom they contradict, and correct the filters by them."""
    braking, enable = brakes
    speeds = sensed.speeds
    h, innovations, spreads = memory.desk[_H], memory.desk[_INNOVATION], memory.desk[_SPREAD]
    h[:] = 0.0
    # One may be wrong; if several contradict everybody, they are not.
    several = _fade(memory) > 1
    slip = 0.0 if braking else _SLIP_SHARED * _driven_slip(memory, sensed.inertial) ** 2
    inertial = memory.belief[INERTIAL] != 0.0  # without, wheels are all that contradicts a twist
    for i in range(speeds.size):
        rim = constants.roll[i] * speeds[i] / (1.0 + memory.belief[SCALE])
        before, memory.rim[i] = memory.rim[i], rim
        h[_U_X], h[_U_Y], h[_RATE] = constants.n_x[i], constants.n_y[i], constants.lever[i]
        spins_up = _gain_of(memory, i, h, rim - before, dt) > constants.spinning
        held = braking and enable[i] > 0.0
        memory.released[i] = 0.0 if held else memory.released[i] + dt
        limit = 8.0 * dt + 2.0 * constants.wheel
        rolls = (
            not held
            and memory.released[i] >= constants.spin_up
            and abs(rim) < _FASTEST_RIM
            and abs(rim - before) <= limit
            and not (braking and (abs(rim) < 0.1 or (inertial and spins_up)))
        )
        if not rolls:
            continue
        # A wheel that still spins up is slower than it will be by some of its changes.
        own = constants.wheel**2 + (constants.scale**2 + slip) * rim**2 + 16.0 * (rim - before) ** 2
        blind = own + 0.05**2
        if braking:
            fresh = min(constants.rebound_time / memory.released[i], 1.0)
            own += (constants.rebound * fresh) ** 2
            blind += (constants.blind_rebound * fresh) ** 2
        fits = True
        trusted = several or memory.doubt[i] < _DOUBTED
        for k in range(FILTERS):
            state = memory.state[k]
            predicted = h[0] * state[0] + h[1] * state[1] + h[2] * state[2]
            innovations[k] = rim - predicted
            spreads[k] = _spread(memory.covariance[k], h) + own
            misfit = innovations[k] ** 2 / spreads[k]
            fits = fits and misfit <= 12.0
            if trusted:
                wrong = min(innovations[k] ** 2 / own, 25.0)
                memory.score[k] += wrong
                memory.blame[i, k] += wrong
        if not disputed:
            strange = innovations[ALL] ** 2 > 9.0 * own
            memory.doubt[i] = 0.9 * memory.doubt[i] + (1.0 if strange else 0.0)
        if not trusted:
            continue
        memory.score[SPOKEN] += 1.0
        if twist.heard:
            _compare_twist(constants, memory, braking, _RollingWheel(h, rim, blind), twist)
        for k in range(FILTERS):
            misfit = innovations[k] ** 2 / spreads[k]
            if fits or (disputed and misfit <= 12.0):
                filtered = _Filter(memory.state[k], memory.covariance[k])
                _correct(filtered, h, innovations[k], own, memory.desk[_GAIN])


@lean
def _gain_of(memory: ObserverMemory, i: int, h: FloatArray, gained: float, dt: float) -> float:
    """Return by how much a rim has lately become faster than the turning vehicle explains.

    Braking takes speed from a wheel that rolls. On ice one spins up so slowly that no single step
    shows it.
    """
    state, row = memory.state[ALL], (memory.newest[0] - 1) % _HISTORY
    turned = h[_U_X] * state[_U_Y] - h[_U_Y] * state[_U_X]
    explained = turned * state[_RATE] * dt + h[_RATE] * (
        state[_RATE] - memory.past[row, ALL, _RATE]
    )
    gain = gained - explained if memory.rim[i] >= 0.0 else explained - gained
    if not abs(gain) < _LARGEST_GAIN:
        gain = _LARGEST_GAIN  # a rim that was not known, or has just been let go
    memory.gain[i] = max(_GAIN_FADE * memory.gain[i] + gain, 0.0)
    return float(memory.gain[i])


@lean
def _driven_slip(memory: ObserverMemory, inertial: FloatArray) -> float:
    """Return by which share driven wheels may slip in a turn, pedal up [1].

    The harder they push, the more; specific force and turning must both say that they do.
    """
    f_x, f_y = inertial[1], inertial[2]
    if not (abs(f_x) < _LARGEST_FORCE and abs(f_y) < _LARGEST_FORCE):
        return 0.0
    state = memory.state[ALL]
    turning = abs(state[_RATE]) * math.hypot(state[_U_X], state[_U_Y])
    push = min(turning, math.hypot(f_x - state[_BIAS_X], f_y - state[_BIAS_Y]))
    return float(_SLIP * push + _SLIP_GROWTH * push * push)


@lean
def _compare_twist(
    constants: ObserverConstants,
    memory: ObserverMemory,
    braking: bool,
    wheel: _RollingWheel,
    passed: PassedTwist,
) -> None:
    """Compare the twist with a rolling wheel; learn what wheel radii are off by, pedal up."""
    h, rim, spread = wheel
    twist, variance = passed.value, passed.variance
    # The twist of base_link at the wheel.
    place = (h[_RATE] + h[_U_Y] * constants.p_x - h[_U_X] * constants.p_y) * twist[2]
    misfit = rim - h[_U_X] * twist[0] - h[_U_Y] * twist[1] - place
    if not braking and abs(rim) > 0.5:
        error = misfit / (rim - misfit) if rim != misfit else 0.0
        if abs(error) < _LARGEST_SCALE:
            scale = memory.belief[SCALE] + 0.02 * error
            memory.belief[SCALE] = min(max(scale, -_LARGEST_SCALE), _LARGEST_SCALE)
    total = spread
    for j in range(3):
        total += 4.0 * h[j] ** 2 * variance[j]
    memory.score[ALONE] = 0.9 * memory.score[ALONE] + min(misfit**2 / total, 25.0)


@lean
def _differences(constants: ObserverConstants, memory: ObserverMemory) -> tuple[float, float]:
    """Return the disagreements on velocity and yaw rate in units of what is no dispute."""
    state, cov = memory.state, memory.covariance
    speed = memory.belief[TOP_SPEED]  # the filters still have the errors that they had then
    worst = 0.0
    for j in range(2):
        gate = constants.velocity_gate + constants.scale * speed
        gate += 3.0 * math.sqrt(cov[NO_TWIST, j, j] + cov[NO_FORCE, j, j])
        worst = max(worst, abs(state[NO_TWIST, j] - state[NO_FORCE, j]) / gate)
    gate = constants.rate_gate + constants.scale * abs(state[ALL, _RATE])
    gate += 3.0 * math.sqrt(cov[NO_TWIST, _RATE, _RATE] + cov[NO_GYRO, _RATE, _RATE])
    return worst, abs(state[NO_TWIST, _RATE] - state[NO_GYRO, _RATE]) / gate


@lean
def _judge(constants: ObserverConstants, memory: ObserverMemory, dt: float) -> int:
    """Decide whom to leave out; return the filter to use, or NOBODY."""
    belief = memory.belief
    velocity, rate = belief[APART_VELOCITY], belief[APART_RATE]
    out = int(belief[OUT])
    if out != ALL:
        own = rate if out == NO_GYRO else (velocity if out == NO_FORCE else max(velocity, rate))
        speaks = out != NO_TWIST or belief[TWIST_AGE] == 0.0
        belief[AGREED] = belief[AGREED] + dt if own < 0.6 and speaks else 0.0
        if out in (NO_TWIST, NO_GYRO) and rate > 1.0:
            right, decided = _explain(constants, memory)
            if decided and right != out:  # the first verdict was wrong
                belief[OUT] = right
                belief[CONVICTIONS] += 1.0
                return int(right)
        if belief[AGREED] < constants.parole or belief[CONVICTIONS] >= constants.convictions:
            return int(out)
        belief[OUT] = ALL
        belief[DISPUTED] = 0.0
        _forget_lies(memory, out)
    odd = _odd_one_out(memory)
    if odd != ALL:
        belief[OUT] = odd
        belief[AGREED] = 0.0
        belief[CONVICTIONS] += 1.0
        return int(odd)
    if velocity < 1.0 and rate < 1.0:
        belief[DISPUTED] = max(belief[DISPUTED] - dt, 0.0)
        # While the twist changes otherwise than the specific force has it, it is taken as it is.
        age = belief[LAST_NS] - belief[TWIST_NS]
        return ALL if age > _AGED or _explains(constants, memory) else NO_FORCE
    if belief[DISPUTED] <= 0.0:  # only what is said from now on counts
        _acquit(memory)
    belief[DISPUTED] += dt
    better, decided = _verdict(constants, memory, rate >= velocity)
    if not decided and belief[DISPUTED] < constants.patience:
        return int(better)
    belief[OUT] = better if decided else NOBODY
    belief[AGREED] = 0.0
    belief[CONVICTIONS] += 1.0
    return int(belief[OUT])


@lean
def _forget_lies(memory: ObserverMemory, right: int) -> None:
    """Let the filters that have heard one who was wrong start anew from that which has not."""
    if right == NOBODY:
        return
    _acquit(memory)
    for k in range(FILTERS):
        if k != right:
            _copy(memory.state[right], memory.state[k])
            for i in range(STATES):
                _copy(memory.covariance[right, i], memory.covariance[k, i])
            row = memory.newest[0]
            for _ in range(_HISTORY):
                _copy(memory.past[row, right], memory.past[row, k])
                row = (row - 1) % _HISTORY


@lean
def _explains(constants: ObserverConstants, memory: ObserverMemory) -> bool:
    """Return whether the specific force explains how the twist changes, with either yaw rate."""
    course = memory.course
    with_gyro = course[CHANGE_X] ** 2 + course[CHANGE_Y] ** 2
    with_own = (course[CHANGE_X] - course[TURN_X]) ** 2 + (course[CHANGE_Y] - course[TURN_Y]) ** 2
    return bool(min(with_gyro, with_own) <= constants.proof * course[SPREAD])


@lean
def _odd_one_out(memory: ObserverMemory) -> int:
    """Return the filter that alone fits the wheels, ALL if there is none.

    It leaves out who is wrong by too little for a dispute, and pulls every other filter aside. No
    single wheel may carry the proof: it may be the one that lies.
    """
    score, blame = memory.score, memory.blame
    best = NO_TWIST
    for k in (NO_GYRO, NO_FORCE):
        if score[k] < score[best]:
            best = k
    if score[SPOKEN] < 4.0 or score[best] > 2.0 * score[SPOKEN]:
        return ALL
    for k in range(FILTERS):
        if k != best:
            proof = score[k] - 3.0 * score[best]
            for i in range(blame.shape[0]):
                proof = min(proof, score[k] - blame[i, k] - 3.0 * (score[best] - blame[i, best]))
            if proof <= _PROOF:
                return ALL
    return best


@lean
def _acquit(memory: ObserverMemory) -> None:
    """Forget what wheels have said against the filters."""
    memory.score[:FILTERS] = 0.0
    memory.score[SPOKEN] = 0.0
    memory.blame[:] = 0.0


@lean
def _explain(constants: ObserverConstants, memory: ObserverMemory) -> tuple[int, bool]:
    """Return the filter whose yaw rate explains how the twist changes, and whether it is proven.

    A twist that neither rate explains is wrong itself.
    """
    course = memory.course
    with_gyro = course[CHANGE_X] ** 2 + course[CHANGE_Y] ** 2
    with_own = (course[CHANGE_X] - course[TURN_X]) ** 2 + (course[CHANGE_Y] - course[TURN_Y]) ** 2
    right = NO_TWIST if with_gyro <= with_own else NO_GYRO
    if not _explains(constants, memory):
        return NO_TWIST, True
    return right, abs(with_gyro - with_own) > constants.proof * course[SPREAD]


@lean
def _verdict(
    constants: ObserverConstants, memory: ObserverMemory, about_rate: bool
) -> tuple[int, bool]:
    """Return the filter that is right in a dispute, and whether that is proven."""
    score, course = memory.score, memory.course
    if course[LEAPT] < _LEAP_MEMORY or course[SAME] > _STUCK_TIME:
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
        return right, memory.belief[DISPUTED] >= 0.5 * constants.patience
    return better, False


@lean
def _who_loses(constants: ObserverConstants, memory: ObserverMemory) -> tuple[int, bool]:
    """Return the filter whose loss of speed is that of a stop, and whether the other's is not.

    Brakes take energy, and no more than tires can: who sees none of the loss that the other sees
    is wrong, and who sees too much of it.
    """
    state = memory.state
    row = (memory.newest[0] - _LOSS) % _HISTORY
    past = memory.past[row]
    most = constants.walk * (memory.stamps[memory.newest[0]] - memory.stamps[row]) * 1e-9
    loss = memory.desk[_THEN]
    for k in (NO_TWIST, NO_FORCE):
        loss[k] = math.hypot(past[k, _U_X], past[k, _U_Y])
        loss[k] -= math.hypot(state[k, _U_X], state[k, _U_Y])
    more = NO_TWIST if loss[NO_TWIST] > loss[NO_FORCE] else NO_FORCE
    less = NO_FORCE if more == NO_TWIST else NO_TWIST
    if loss[more] > most:
        return less, True
    return more, bool(loss[more] > 0.15 and loss[less] < 0.3 * loss[more])


@lean
def _judge_alone(memory: ObserverMemory, dt: float, braking: bool) -> int:
    """Decide without an IMU: the twist must fit the wheels that roll, and lose speed."""
    belief = memory.belief
    row = memory.newest[0]
    before = memory.past[(row - _HISTORY + 2) % _HISTORY, ALL]
    now = memory.state[ALL]
    lost = math.hypot(before[_U_X], before[_U_Y]) - math.hypot(now[_U_X], now[_U_Y])
    filled = memory.stamps[(row + 1) % _HISTORY] >= 0
    heard = belief[TWIST_AGE] == 0.0
    moves = math.hypot(now[_U_X], now[_U_Y]) > _MOVES
    idle = braking and heard and filled and moves and lost < 0.05
    belief[IDLE] = belief[IDLE] + dt if idle else 0.0
    if braking and (memory.score[ALONE] > 60.0 or belief[IDLE] > 0.2):
        belief[OUT] = NOBODY
        belief[CONVICTIONS] += 1.0
    return NOBODY if belief[OUT] != ALL else ALL


@lean
def observe(
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
        now_ns: time of the step [ns].
        brakes: what they do.
        passed: the latest twist.
        sensed: what the other sensors say.
        answer: receives the twist of now [m/s, m/s, rad/s], shape (3,).

    Returns:
        The filter whose answer it is, or NOBODY where none can be believed.
    """
    braking, inertial, belief = brakes.pressed, sensed.inertial, memory.belief
    heard, twist_ns, twist, variance = passed
    dt = (now_ns - belief[LAST_NS]) * 1e-9
    belief[LAST_NS] = now_ns
    if belief[BEGUN] == 0.0 or not 0.0 <= dt <= constants.longest:
        if not heard:
            return NOBODY
        _begin(memory, now_ns, twist)
        dt = 0.0
    if braking and belief[PRESSED] == 0.0:
        memory.released[:] = 0.0
        memory.score[ALONE] = 0.0
    if not braking and belief[PRESSED] != 0.0:
        belief[OUT] = belief[DISPUTED] = belief[AGREED] = belief[CONVICTIONS] = 0.0
        _acquit(memory)
    if not braking:
        _copy(memory.state[ALL, _BIAS_RATE:], memory.course[STILL_RATE:APART])
        belief[TOP_SPEED] = math.hypot(memory.state[ALL, _U_X], memory.state[ALL, _U_Y])
    belief[PRESSED] = 1.0 if braking else 0.0
    _carry_on(constants, memory, now_ns, dt, inertial)
    disputed = belief[DISPUTED] > 0.0 or belief[OUT] != ALL
    fresh = heard and twist_ns > belief[TWIST_NS]
    if fresh and not (braking or disputed):
        _tell_apart(constants, memory, twist[2], variance[2], inertial[0])
    told = memory.desk[_TOLD]
    _copy(twist, told)
    told[2] -= memory.course[OFFSET]
    _hear_wheels(
        constants, memory, dt, brakes, sensed, disputed,
        PassedTwist(fresh, twist_ns, told, variance),
    )  # fmt: skip
    belief[TWIST_AGE] = 0.0 if heard else belief[TWIST_AGE] + dt
    memory.course[LEAPT] += dt
    if fresh:
        _notice_stuck(constants, memory, braking, PassedTwist(True, twist_ns, told, variance))
        belief[TWIST_NS] = twist_ns
        _hear_twist(constants, memory, twist_ns, told, variance)
    _remember(memory)  # as it is known now
    if fresh or now_ns - belief[TWIST_NS] > _LONG_HELD:  # in between the filters drift apart
        belief[APART_VELOCITY], belief[APART_RATE] = _differences(constants, memory)
    if belief[INERTIAL] == 0.0:
        return int(_judge_alone(memory, dt, braking))
    if not braking:
        _excuse_wheels(constants, memory, inertial)
    return int(_answer(constants, memory, _judge(constants, memory, dt), answer))


@lean
def _tell_apart(
    constants: ObserverConstants, memory: ObserverMemory, rate: float, variance: float, gyro: float
) -> None:
    """Learn by how much the yaw rates of twist and gyro differ [rad/s], and whose error that is.

    A gyro that has been calibrated is off by little; what is more is the twist's.
    """
    if not abs(gyro) < _FASTEST_TURN:
        return
    course = memory.course
    spread = course[APART_SPREAD] + _APART_WALK**2
    gain = spread / (spread + variance + constants.gyro**2)
    course[APART] += gain * (rate - gyro - course[APART])
    course[APART_SPREAD] = (1.0 - gain) * spread
    bias = min(max(-course[APART], -_LARGEST_BIAS), _LARGEST_BIAS)
    course[OFFSET] = course[APART] + bias
    for k in (ALL, NO_TWIST, NO_FORCE):
        memory.state[k, _BIAS_RATE] = bias
        for i in range(STATES):
            memory.covariance[k, _BIAS_RATE, i] = memory.covariance[k, i, _BIAS_RATE] = 0.0
        memory.covariance[k, _BIAS_RATE, _BIAS_RATE] = (0.1 * _LARGEST_BIAS) ** 2


@lean
def _excuse_wheels(
    constants: ObserverConstants, memory: ObserverMemory, inertial: FloatArray
) -> None:
    """Let the filter without twist start from it where driven wheels slip, pedal up.

    How fast the vehicle is, it knows from nobody else then; by how much they may slip, it doubts
    that, and wheels that roll correct it once the pedal is down.
    """
    state = memory.state[ALL]
    doubt = _driven_slip(memory, inertial) * math.hypot(state[_U_X], state[_U_Y])
    settled = memory.belief[OUT] == ALL and memory.course[MARKED] != 0.0
    slides = settled and doubt > constants.velocity_gate and _explains(constants, memory)
    if slides or _is_slipping(constants, memory):
        _copy(state, memory.state[NO_TWIST])
        for i in range(STATES):
            _copy(memory.covariance[ALL, i], memory.covariance[NO_TWIST, i])
        memory.covariance[NO_TWIST, _U_X, _U_X] += doubt**2
        memory.covariance[NO_TWIST, _U_Y, _U_Y] += doubt**2


@lean
def _is_slipping(constants: ObserverConstants, memory: ObserverMemory) -> bool:
    """Return whether driven wheels are what pulls twist and IMU apart, pedal up.

    These agree on how the velocity changes, and the filter without twist has its velocity from
    the wheels.
    """
    velocity, _ = _differences(constants, memory)
    settled = memory.belief[OUT] == ALL and memory.course[MARKED] != 0.0
    return bool(settled and velocity >= 1.0 and _explains(constants, memory))


@lean
def _carry_on(
    constants: ObserverConstants,
    memory: ObserverMemory,
    now_ns: int,
    dt: float,
    inertial: FloatArray,
) -> None:
    """Predict all filters, correct them by the gyro, and remember the states of now."""
    rate, f_x, f_y = inertial[0], inertial[1], inertial[2]
    # What no vehicle does is no reading.
    gyro = abs(rate) < _FASTEST_TURN
    force = abs(f_x) < _LARGEST_FORCE and abs(f_y) < _LARGEST_FORCE
    if gyro and force:
        memory.belief[INERTIAL] = 1.0
    _carry_path(memory, dt, rate if gyro else math.nan, f_x if force else math.nan, f_y)
    product, h = memory.desk[_PRODUCT : _PRODUCT + 2], memory.desk[_H]
    h[:] = 0.0
    h[_RATE] = h[_BIAS_RATE] = 1.0
    for k in range(FILTERS):
        state, covariance = memory.state[k], memory.covariance[k]
        measured = _Force(force and k != NO_FORCE, f_x, f_y)
        _predict(constants, state, covariance, dt, measured, product)
        if gyro and k != NO_GYRO:
            innovation = rate - state[_RATE] - state[_BIAS_RATE]
            filtered = _Filter(state, covariance)
            _correct(filtered, h, innovation, constants.gyro**2, memory.desk[_GAIN])
    row = (memory.newest[0] + 1) % _HISTORY
    memory.newest[0] = row
    memory.stamps[row] = now_ns
    _remember(memory)


@lean
def _carry_path(memory: ObserverMemory, dt: float, rate: float, f_x: float, f_y: float) -> None:
    """Turn the path by the gyro and add the specific force to it; no number where there is none."""
    path, course = memory.state[PATH], memory.course
    known = memory.state[ALL, _RATE]
    now = rate - course[STILL_RATE] if math.isfinite(rate) else known
    turn = 0.5 * dt * (now + path[_LAST_RATE])
    heading = path[_HEADING] + 0.5 * turn
    path[_HEADING] += turn
    path[_LAST_RATE] = now
    if math.isfinite(f_x):
        a_x, a_y = f_x - course[STILL_X], f_y - course[STILL_Y]
        c, s = math.cos(heading), math.sin(heading)
        path[_GAIN_X] += dt * (c * a_x - s * a_y)
        path[_GAIN_Y] += dt * (s * a_x + c * a_y)


@lean
def _answer(
    constants: ObserverConstants, memory: ObserverMemory, chosen: int, answer: FloatArray
) -> int:
    """Write the answer of a filter; return NOBODY where it is not good enough."""
    if chosen == NOBODY:
        return NOBODY
    state, covariance, score = memory.state[chosen], memory.covariance[chosen], memory.score
    if chosen != ALL and score[SPOKEN] > 4.0 and score[chosen] > 8.0 * score[SPOKEN]:
        memory.belief[OUT] = NOBODY  # the wheels contradict the one that is left
        return NOBODY
    answer[0] = state[_U_X] + state[_RATE] * constants.p_y
    answer[1] = state[_U_Y] - state[_RATE] * constants.p_x
    answer[2] = state[_RATE]
    spread = max(covariance[_U_X, _U_X], covariance[_U_Y, _U_Y])
    if (
        spread <= constants.velocity_deviation**2
        and covariance[_RATE, _RATE] <= constants.rate_deviation**2
        and math.isfinite(answer[0] + answer[1] + answer[2])
    ):
        return chosen
    return NOBODY
