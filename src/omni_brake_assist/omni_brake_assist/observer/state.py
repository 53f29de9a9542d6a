"""State and constants of the observer."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_platform.geometry import PlatformGeometry, cross
from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

IntArray = NDArray[np.int64]
Record = Any
"""One entry of a structured array, by reference."""

# Entries of the scores behind those of the filters: the twist against the wheels by itself, and the
# number of wheel readings in them.
ALONE, READINGS = 4, 5
SCORES = 6

WHEEL_GATE = 12.0
"""Gate of a squared normalized innovation: chi-square, 1 degree of freedom, 99.95 % [1]."""

# The filters, by the excluded source.
ALL, NO_TWIST, NO_GYRO, NO_FORCE = range(4)
FILTERS = 4
U_X, U_Y, RATE, BIAS_RATE, BIAS_X, BIAS_Y = range(6)
STATES = 6

# A fifth row of states is the path of the IMU alone: its heading by the gyro [rad], what the
# specific force has added to the velocity since in axes that do not turn [m/s], its last rate, and
# what the gyro has read [rad/s].
PATH = 4
HEADING, GAIN_X, GAIN_Y, LAST_RATE, GYRO = range(5)

# In place of a filter: there is no valid estimate.
NO_ESTIMATE = 4

HISTORY = 32
"""States of the past that a late twist can be compared with."""

KEPT = 256
"""Steps of which all sensors are kept for a twist that is known to be late."""

# Entries of what is kept of a step: whether the pedal was down, the IMU, speeds and enables of the
# wheels.
KEPT_PRESSED, KEPT_IMU, KEPT_WHEELS = 0, 1, 4

ISOLATION = np.dtype(
    [
        ("out", np.float64),  # the excluded source: a filter, or NO_ESTIMATE
        ("disputed", np.float64),  # time that the dispute has lasted [s]
        ("agreed", np.float64),  # for how long the one left out has agreed again [s]
        ("inertial", np.float64),  # whether there has been an IMU reading
        ("begun", np.float64),  # whether the filters have begun
        ("twist_age", np.float64),  # time since the last good twist [s]
        ("since_jump", np.float64),  # time since the gate refused a step of the twist [s]
        ("since_ns", np.float64),  # time from which on they know the motion [ns]
        ("last_ns", np.float64),  # time of the last step [ns]
        ("twist_ns", np.float64),  # time of the newest twist used [ns]
        ("pressed", np.float64),  # whether the pedal was down
        ("braked", np.float64),  # for how long it has been down [s]
        ("top_speed", np.float64),  # speed when the pedal went down [m/s]
        ("scale", np.float64),  # error of wheel radii, learned while the pedal was up [1]
        ("apart_velocity", np.float64),  # how far velocities were apart, see `differences` [1]
        ("apart_rate", np.float64),  # difference of yaw rates, see `differences` [1]
    ]
)
"""State of fault isolation."""

COURSE = np.dtype(
    [
        ("marked", np.float64),  # whether there is an earlier twist
        ("mark_x", np.float64),  # its velocity in the axes of the path [m/s]
        ("mark_y", np.float64),  # its velocity along y [m/s]
        ("mark_rate", np.float64),  # its yaw rate [rad/s]
        ("mark_ns", np.float64),  # its time [ns]
        ("mark_heading", np.float64),  # the path then [rad]
        ("mark_gain_x", np.float64),  # gain of the path then [m/s]
        ("mark_gain_y", np.float64),  # gain of the path then [m/s]
        ("change_x", np.float64),  # change beyond the specific force, gyro right [m/s]
        ("change_y", np.float64),  # the same change along y [m/s]
        ("turn_x", np.float64),  # what they would have with their own yaw rate [m/s]
        ("turn_y", np.float64),  # the same along y [m/s]
        ("spread", np.float64),  # variance of both [m^2/s^2]
        ("still_rate", np.float64),  # biases when the pedal went down [rad/s]
        ("still_x", np.float64),  # bias of the accelerometer then [m/s^2]
        ("still_y", np.float64),  # bias of the accelerometer then [m/s^2]
        ("apart", np.float64),  # how far yaw rates of twist and gyro differ, pedal up [rad/s]
        ("apart_spread", np.float64),  # variance of that [rad^2/s^2]
        ("offset", np.float64),  # how much of it is the twist's [rad/s]
    ]
)
"""Changes of the twist and their explanation by the specific force."""

FASTEST_TURN = 50.0  # [rad/s]
LARGEST_FORCE = 100.0  # [m/s^2]
LARGEST_BIAS = 0.01  # of a gyro that has been calibrated at rest [rad/s]
_APART = 0.05  # standard deviation of fault-free yaw rates of twist and gyro [rad/s]


class Brakes(NamedTuple):
    """Pedal and enables.

    Attributes:
        pressed: whether the pedal is down.
        enable: of the step before [1], shape (N,).
    """

    pressed: bool
    enable: FloatArray


class PassedTwist(NamedTuple):
    """A twist after the gate.

    Attributes:
        received: whether there is one that passed.
        jumped: whether the gate has refused it for its step from the last one.
        stamp_ns: its stamp [ns].
        value: the twist [m/s, m/s, rad/s], shape (3,).
        variance: of its components, shape (3,).
    """

    received: bool
    jumped: bool
    stamp_ns: int
    value: FloatArray
    variance: FloatArray


class Sensed(NamedTuple):
    """Readings of the other sensors, NaN where there are none.

    Attributes:
        inertial: yaw rate [rad/s] and specific force [m/s^2], shape (3,).
        speeds: of the wheels [rad/s], shape (N,).
    """

    inertial: FloatArray
    speeds: FloatArray


class Force(NamedTuple):
    """Specific force [m/s^2], and whether it is known."""

    known: bool
    x: float
    y: float


class ObserverConstants(NamedTuple):
    """What never changes.

    Attributes:
        n_x: active directions [1], shape (N,).
        n_y: components along y [1], shape (N,).
        lever: of the active directions about the mounting of the IMU [m], shape (N,).
        roll: speed along the active direction per wheel speed, ``R n_w . u_w`` [m], shape (N,).
        inverse: motion of the mounting by the speeds of all rims [1], [1], [1/m], shape (3, N).
        bias: standard deviation of the accelerometer's bias, and of what a slope adds [m/s^2].
        p_x: mounting of the IMU [m].
        p_y: lateral mounting of the IMU [m].
        force: uncertainty of the specific force [m/s^2].
        walk: acceleration that tires can make [m/s^2].
        turn: angular acceleration that they can make [rad/s^2].
        gyro: standard deviation of the gyro [rad/s].
        wheel: of the speed of a rolling wheel [m/s].
        scale: relative error of wheel radii and twist [1].
        velocity_gate: difference of velocities that is no dispute [m/s].
        rate_gate: difference of yaw rates that is no dispute [rad/s].
        patience: time within which a dispute must be isolated [s].
        recovery_time: time of agreement until an isolated source is used again [s].
        velocity_deviation: of the answer, largest [m/s].
        rate_deviation: largest standard deviation of the yaw rate [rad/s].
        spin_up: time since its release after which a wheel rolls [s].
        spinning: gain of a rim from which on it still spins up [m/s].
        rebound: how much faster than it rolls a wheel may spin after its release, while the tire
            springs back [m/s].
        blind_rebound: rebound where only wheels check the twist [m/s].
        rebound_time: for how long, then it fades [s].
        delay: by which a twist is older than its stamp [ns].
        longest: step across which the filters go on [s].
        memory: time over which changes of the twist are added up [s].
        proof: by how much two explanations of them must differ, in variances [1].
        no_isolation: a isolation to begin with, `ISOLATION`, shape (1,).
        no_course: a course to begin with, `COURSE`, shape (1,).
    """

    n_x: FloatArray
    n_y: FloatArray
    lever: FloatArray
    roll: FloatArray
    inverse: FloatArray
    bias: float
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
    recovery_time: float
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
    no_isolation: NDArray[np.void]
    no_course: NDArray[np.void]


class Workspace(NamedTuple):
    """Scratch buffers of a step, 6 numbers each: the state of a filter.

    Attributes:
        h: direction of a measurement.
        gain: of a correction.
        then: a state of the past.
        shift: by which it is corrected.
        corrected: a twist without its yaw-rate offset.
        innovation: of a measurement in each filter.
        spread: its variance in each filter.
        product: rows of a product of matrices, shape (2, 6).
    """

    h: FloatArray
    gain: FloatArray
    then: FloatArray
    shift: FloatArray
    corrected: FloatArray
    innovation: FloatArray
    spread: FloatArray
    product: FloatArray


class ObserverMemory(NamedTuple):
    """State of the observer from step to step.

    Attributes:
        state: of each filter and the path, shape (5, 6).
        covariance: of each filter, shape (4, 6, 6).
        isolation: `ISOLATION`, shape (1,).
        released: for how long each wheel's brake has been released [s], shape (N,).
        rim: the last speed of each rim along the active direction [m/s], shape (N,).
        gain: by how much each rim has lately become faster [m/s], shape (N,).
        slid: by how much each rim has lately become faster than the specific force explains, pedal
            up: a driven wheel that slips [m/s], shape (N,).
        off: by how much each has lately been faster than the twist says, pedal up [m/s],
            shape (N,).
        score: how badly wheels fit the filters, see the head of the module [1], shape (6,).
        wheel_ratio: test ratio of each wheel, NaN while it is not used [1], shape (N,).
        course: what explains the change of the twist, `COURSE`, shape (1,).
        past: states of the last stamps, a ring, shape (32, 5, 6).
        stamps: of them [ns], -1 where there is none, shape (32,).
        newest: row of the newest of them, shape (1,).
        kept: readings of the sensors, a ring, and in the last row those interpolated between
            two steps, shape (257, 4 + 2 N).
        kept_stamps: of it [ns], -1 where there is none, shape (256,).
        kept_newest: row of the newest of them, shape (1,).
        workspace: scratch buffers.
    """

    state: FloatArray
    covariance: FloatArray
    isolation: NDArray[np.void]
    released: FloatArray
    rim: FloatArray
    gain: FloatArray
    slid: FloatArray
    off: FloatArray
    score: FloatArray
    wheel_ratio: FloatArray
    course: NDArray[np.void]
    past: FloatArray
    stamps: IntArray
    newest: IntArray
    kept: FloatArray
    kept_stamps: IntArray
    kept_newest: IntArray
    workspace: Workspace


def observer_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> ObserverConstants:
    """Return the constants in the layout of the kernel.

    Args:
        configuration: of the assistant.
        geometry: of the wheels.
    """
    p_x, p_y = configuration.imu_x, configuration.imu_y
    return ObserverConstants(
        **_rims(geometry, p_x, p_y),
        bias=0.5,
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
        recovery_time=0.2,
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
        no_isolation=np.zeros(1, ISOLATION),
        no_course=np.zeros(1, COURSE),
    )


@lru_cache(maxsize=64)
def _rims(geometry: PlatformGeometry, p_x: float, p_y: float) -> dict[str, FloatArray]:
    """Return the kinematics of rims and IMU, once for all runs of a campaign."""
    n_x, n_y = np.ascontiguousarray(geometry.active.T)
    lever = cross(geometry.position, geometry.active) + n_x * p_y - n_y * p_x
    return {
        "n_x": n_x,
        "n_y": n_y,
        "lever": lever,
        "roll": geometry.radius * np.sum(geometry.active * geometry.rolling, axis=1),
        "inverse": np.ascontiguousarray(np.linalg.pinv(np.column_stack((n_x, n_y, lever)))),
    }


def observer_memory(wheels: int) -> ObserverMemory:
    """Return the memory of an observer that has received nothing."""
    return ObserverMemory(
        np.zeros((FILTERS + 1, STATES)),
        np.zeros((FILTERS, STATES, STATES)),
        np.zeros(1, ISOLATION),
        np.zeros(wheels),
        np.full(wheels, np.nan),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros(SCORES),
        np.full(wheels, np.nan),
        np.zeros(1, COURSE),
        np.zeros((HISTORY, FILTERS + 1, STATES)),
        np.full(HISTORY, -1, np.int64),
        np.zeros(1, np.int64),
        np.zeros((KEPT + 1, KEPT_WHEELS + 2 * wheels)),
        np.full(KEPT, -1, np.int64),
        np.zeros(1, np.int64),
        Workspace(*np.zeros((7, STATES)), np.zeros((2, STATES))),  # type: ignore[call-arg]
    )


@lean
def copy(values: FloatArray, target: FloatArray) -> None:
    """Write values into a target."""
    for i in range(values.size):
        target[i] = values[i]


@lean
def begin(
    constants: ObserverConstants, memory: ObserverMemory, now_ns: int, twist: FloatArray
) -> None:
    """Initialize all filters at a twist with large variances."""
    memory.released[:] = 0.0
    memory.rim[:] = math.nan
    memory.gain[:] = 0.0
    memory.slid[:] = memory.off[:] = 0.0
    memory.stamps[:] = -1
    memory.score[:] = 0.0
    memory.course[0] = constants.no_course[0]
    memory.course[0].apart_spread = _APART**2
    memory.isolation[0] = constants.no_isolation[0]
    isolation = memory.isolation[0]
    isolation.begun = 1.0
    isolation.since_ns = isolation.last_ns = now_ns
    isolation.twist_ns = -1.0
    isolation.since_jump = constants.recovery_time
    memory.state[:] = 0.0
    memory.covariance[:] = 0.0
    for k in range(FILTERS):
        for j in range(3):
            memory.state[k, j] = twist[j]
            memory.covariance[k, j, j] = 100.0
        memory.covariance[k, BIAS_RATE, BIAS_RATE] = LARGEST_BIAS**2
        memory.covariance[k, BIAS_X, BIAS_X] = constants.bias**2
        memory.covariance[k, BIAS_Y, BIAS_Y] = constants.bias**2
