"""State and constants of the filter bank."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_core.geometry import PlatformGeometry
from omni_core.kernels import by_reference, lean
from omni_core.quantities import FloatArray, IntArray
from omni_core.signals import VALID, TwistSample

# Hypotheses on which source is faulty. Each hypothesis except NO_ESTIMATE has a filter that does
# not use this source.
ALL, NO_TWIST, NO_VELOCITY, NO_RATE, NO_GYRO, NO_FORCE, NO_IMU, NO_ESTIMATE = range(8)
FILTERS, HYPOTHESES = NO_ESTIMATE, NO_ESTIMATE + 1
DEAD_RECKONING = NO_TWIST, NO_VELOCITY
"""Hypotheses under which only the IMU and the wheels measure the velocity."""
TWIST_FAULTS = *DEAD_RECKONING, NO_RATE
"""Hypotheses under which the twist, only its velocity, or only its yaw rate is faulty."""

# Components of the state: velocity at the mounting point of the IMU, yaw rate, biases of gyro and
# accelerometer, relative error of the wheel radii, offset of the twist's yaw rate.
U_X, U_Y, RATE, BIAS_RATE, BIAS_X, BIAS_Y, SCALE, OFFSET, STATES = range(9)

GYRO = 3
"""Index of the gyro in `BankMemory.spread`; the components of the twist precede it."""

WINDOW_NS = 100_000_000
"""Time over which the variance of readings and the decrease of the speed are measured; also the
time constant with which filters follow the best one [ns]."""

DEAD = 0.5
"""Share of the faulty encoders that read 0, because power, cable or pulse wheel is lost [1]."""

FAULTY = 0.5
"""Probability that an encoder is faulty above which the encoder is isolated [1]."""

WHEEL = 0.03  # standard deviation of a rolling rim's speed and a fault-free twist's velocity [m/s]
SHARE = 0.005  # additional standard deviation of these speeds and of yaw rates, per reading [1]
MODEL_ERROR = 2.0  # largest error of the ratio of nominal brake torque to wheel inertia [1]
RELEASED = 0.05  # a brake with at most this enable counts as released [1]
UNKNOWN_LAG = 0.05  # dead time of brakes that is assumed while there is no estimate of it [s]
LEAST_FRICTION = 3.0  # deceleration with a friction coefficient of 0.3 if all wheels brake [m/s^2]
# Prior probability that a source is faulty, that a driven wheel slides, or that a wheel rolls while
# its brake acts [1]; the prior probability of two faults is the square of this number.
PRIOR = 0.05

BANK = np.dtype(
    [
        ("begun", "?"),
        ("received", "?"),  # whether a twist has been received since the start
        ("known", "?"),  # whether the motion is known, so that likelihoods are valid
        ("equipped", "?"),  # whether a complete IMU reading has been received since the start
        ("inertial", "?"),  # whether the last IMU reading is present and complete
        ("pressed", "?"),  # whether the pedal was down in the last step
        ("horizon_ns", "i8"),  # time at which the filter states are valid [ns]
        ("twist_ns", "i8"),  # time of validity of the newest twist [ns]
        ("gyro", "f8"),  # last reading of the gyro [rad/s], NaN if there is none
        ("unmeasured", "f8"),  # time since the last reading of the gyro [s]
        # Time for which the newest IMU reading is held [s]. The next reading corrects
        # the error of the velocity, so this error is not part of the state's variance.
        ("held", "f8"),
        ("braked", "f8"),  # time since the pedal was pressed [s]
        ("lag", "f8"),  # estimated dead time of the brakes in excess of the configured one [s]
        ("best", "i8"),  # most probable hypothesis
        ("kept", "i8"),  # hypothesis whose estimate `BankMemory.precise` corrects
    ]
)

_ROW = np.dtype(
    [
        ("stamp_ns", "i8"),  # stamp of the step, -1 before the start [ns]
        ("pedal", "f8"),  # these fields are those of `Readings`
        ("inertial", "f8", 3),
        ("fresh", "?"),
        ("age", "f8"),
        # `filters.speeds_of` each filter minus `BankConstants.swing`, at least 0 [m/s].
        ("speed", "f8", (FILTERS, 2)),
    ]
)


class Readings(NamedTuple):
    """Pedal, enables and sensor readings of a step, NaN where a reading is missing.

    Attributes:
        pedal: the driver's brake demand, 0 while the pedal is up [1].
        enable: brake enables of the previous step [1], shape (N,).
        inertial: yaw rate [rad/s] and specific force [m/s^2], shape (3,).
        speeds: wheel speeds [rad/s], shape (N,).
        fresh: whether the yaw rate has not been used in an earlier step.
        age: time since the newest IMU reading [s].
        lag: estimated dead time of the brakes in excess of the configured one [s].
        stuck: whether a reading is missing from now on, because it has not changed for long.
    """

    pedal: float
    enable: FloatArray
    inertial: FloatArray
    speeds: FloatArray
    fresh: bool = True
    age: float = 0.0
    lag: float = UNKNOWN_LAG
    stuck: bool = False


@by_reference
class BankConstants(NamedTuple):
    """Constants of the filter bank.

    Attributes:
        n_x: active directions, x component [1], shape (N,).
        n_y: active directions, y component [1], shape (N,).
        lever: levers of the active directions about the mounting of the IMU [m], shape (N,).
        roll: speed of the rim along the active direction per wheel speed [m], shape (N,).
        p_x: position of the IMU, x [m].
        p_y: position of the IMU, y [m].
        reach: root mean square of the distances of the wheels from their center [m].
        spin_up: time from the release of a brake until its wheel rolls [s].
        delay: latency of a twist that its stamp does not include [ns].
        twist_wait: limit on the time for which the filters wait for a late twist [ns].
        longest: limit on the time step; after a longer step the filters are initialized again [s].
        prior: probabilities of the hypotheses [1], shape (8,).
        initial: standard deviations of the states at the start, in the units of the states, shape
            (8,).
        nothing: initial record of the memory, which is copied for a reset, shape (1,).
        rate_deviation: limit on the standard deviation of the yaw rate of a valid estimate [rad/s].
        least_loss: smallest deceleration of a braked vehicle, see `least_loss` [m/s^2].
        force: random walk of the velocity when the specific force is used [m/s/sqrt(s)].
        walk: random walk of the velocity without the specific force, equal to an acceleration of
            1 g for 0.01 s [m/s/sqrt(s)].
        turn: random walk of the yaw rate, equal to 30 rad/s^2 for 0.01 s [rad/s/sqrt(s)].
        rate: standard deviation of the yaw rate of a fault-free gyro or twist [rad/s].
        rebound: standard deviation of a rim's speed while the tire springs back after a release of
            the brake [m/s]. With critical damping, the root mean square of the rim's excess speed
            over the time T is F / sqrt(4 c m w T), for the friction force F = 2000 N, the tire's
            stiffness c = 2e5 N/m, the rim's mass m = 25 kg, w = sqrt(c / m) and T = `rebound_time`.
        overshoot: largest excess speed of a rim while the tire springs back [m/s]. It is the peak
            of the same oscillation with half of the critical damping, 0.55 F / sqrt(c m). A law
            that switches a brake in every step repeats this peak at every release.
        swing: speed up to which a vehicle on locked tires swings back at the end of a stop [m/s].
            It is F / sqrt(c m) for the mass m = 375 kg per wheel, c as above, and a friction force
            F of 0.7 times the wheel load.
        rebound_time: time in which the rim speeds up and the tire springs back [s].
        correlation_time: time over which the errors of gyro and twist are correlated [s]. A reading
            that follows the last one sooner contains less new information, so the exponent of its
            likelihood is the share of this time that has passed. The time is half a period of the
            tire's oscillation, pi / w with the w of `rebound`.
        wheel_correlation_time: time over which the errors of the wheel speeds are correlated [s],
            which is longer because a wheel also has to speed up.
        drift: random walk of the constant states (biases, scale, offset), as a share of their
            initial standard deviation [1/sqrt(s)].
        transition_rate: probability of a transition between hypotheses per time [1/s].
        velocity_deviation: limit on the standard deviation of the velocity of a valid estimate
            [m/s].
        period: control period [s].
        rows: number of control steps whose readings are stored.
        drop: largest deceleration of the rim of each wheel by its brake, inf if the configuration
            need not describe brakes and wheels [m/s^2], shape (N,).
        pushes: whether the brakes are drives, which also accelerate a wheel that is slower than its
            command.
        dead: `DEAD`, or 0 with the law `sliding_mode`, which can leave a brake released that is
            stuck [1].
    """

    n_x: FloatArray
    n_y: FloatArray
    lever: FloatArray
    roll: FloatArray
    p_x: float
    p_y: float
    reach: float
    spin_up: float
    delay: int
    twist_wait: int
    longest: float
    prior: FloatArray
    initial: FloatArray
    nothing: NDArray[np.void]
    rate_deviation: float
    least_loss: float
    period: float
    rows: int
    drop: FloatArray
    pushes: bool
    dead: float
    force: float = 0.02
    walk: float = 1.0
    turn: float = 3.0
    rate: float = 0.01
    rebound: float = 0.12
    overshoot: float = 0.49
    swing: float = 0.3
    rebound_time: float = 0.15
    correlation_time: float = 1.0 / 30.0
    wheel_correlation_time: float = 0.05
    drift: float = 0.1
    transition_rate: float = 0.1
    velocity_deviation: float = 0.4


@by_reference
class BankMemory(NamedTuple):
    """State of the filter bank between two steps; R is `BankConstants.rows`.

    Attributes:
        state: state of each filter, columns `U_X` to `OFFSET`, shape (7, 8).
        covariance: covariance of each filter, shape (7, 8, 8).
        posterior: log probabilities of the hypotheses, shape (8,).
        evidence: log likelihood of the readings of a step under each hypothesis, shape (8,).
        record: stamps and flags, a record of `BANK`, shape (1,).
        twist: last received twist [m/s, m/s, rad/s], shape (3,).
        released: time for which each brake has been released [s], shape (N,).
        rim: last speed of each rim along the active direction [m/s], shape (N,).
        mark: largest speed of the rim of each released wheel since its release, as a share of its
            speed in rolling [1], shape (N,).
        idle: time for which the rim of each released wheel has not exceeded that share [s], shape
            (N,).
        share: last speed of each braked rim, as a share of its speed in rolling [1], shape (N,).
        torque: filtered command of each brake since the slip changes slowly, as a share of the
            largest torque [1], shape (N,).
        most: largest torque of each brake since the slip changes slowly, as a share of the largest
            possible torque [1], shape (N,).
        slip: slip of each wheel at that torque, as a share of the rim's speed in rolling [1],
            shape (N,).
        pressure: largest possible torque of each brake, as a share of the largest torque [1],
            shape (N,).
        slowest: lowest speed of each rim that the torque of its brake permits after the last
            readings [m/s], shape (N,).
        faulty: probability under each hypothesis that the encoder of a wheel is faulty [1],
            shape (8, N); 0 under NO_ESTIMATE.
        wheel_ratio: test ratio of each wheel, NaN while it slides [1], shape (N,).
        precise: last precise twist minus the estimate at its time [m/s, m/s, rad/s], shape (3,).
        ratio: test ratios of the components of the twist in the filter of all sources [1],
            shape (3,).
        spread: mean squares of the changes of the twist's components [m^2/s^2, m^2/s^2, rad^2/s^2]
            and of the gyro [rad^2/s^2] between two readings, over about `WINDOW_NS`, shape (4,).
        rows: readings of the past steps except those of the wheels, a ring buffer, shape (R,).
        wheel_rows: wheel speeds [rad/s] and enables [1] of these steps, shape (R, 2, N).
        newest: row of the newest reading, and row of the newest reading that the filters have used,
            shape (2,).
        h: direction in the state space that a measurement observes, shape (8,).
        gain: Kalman gain of a correction, shape (8,).
    """

    state: FloatArray
    covariance: FloatArray
    posterior: FloatArray
    evidence: FloatArray
    record: NDArray[np.void]
    twist: FloatArray
    released: FloatArray
    rim: FloatArray
    mark: FloatArray
    idle: FloatArray
    share: FloatArray
    torque: FloatArray
    most: FloatArray
    slip: FloatArray
    pressure: FloatArray
    slowest: FloatArray
    faulty: FloatArray
    wheel_ratio: FloatArray
    precise: FloatArray
    ratio: FloatArray
    spread: FloatArray
    rows: NDArray[np.void]
    wheel_rows: FloatArray
    newest: IntArray
    h: FloatArray
    gain: FloatArray


def least_loss(wheels: int) -> float:
    """Return the deceleration on slippery ground with half of the wheels braked [m/s^2].

    In motion along a diagonal, only half of the wheels can brake, and of three wheels possibly only
    one.
    """
    return LEAST_FRICTION * (wheels // 2) / wheels


def bank_constants(
    configuration: BrakeAssistConfiguration, geometry: PlatformGeometry
) -> BankConstants:
    """Return the constants of the filter bank for a configuration and wheel geometry."""
    p_x, p_y, period = configuration.imu_x, configuration.imu_y, configuration.control_period
    n_x, n_y = np.ascontiguousarray(geometry.active.T)
    modeled = configuration.law == "allocation"  # which needs torque and inertia
    torque = MODEL_ERROR * configuration.brake.max_torque if modeled else math.inf
    return BankConstants(
        n_x=n_x,
        n_y=n_y,
        lever=geometry.lever + n_x * p_y - n_y * p_x,
        roll=geometry.rim,
        p_x=p_x,
        p_y=p_y,
        reach=math.sqrt(np.mean(np.sum(geometry.position**2, axis=1))),
        spin_up=0.03 + configuration.brake.releasing_time,
        delay=round(configuration.feedback_delay * 1e9),
        twist_wait=round((configuration.feedback_delay + configuration.feedback_timeout) * 1e9),
        longest=configuration.maximum_time_step,
        prior=np.array([1.0 - 5.0 * PRIOR - 2.0 * PRIOR**2, *[PRIOR] * 5, *[PRIOR**2] * 2]),
        initial=np.array([10.0, 10.0, 10.0, 0.01, 0.3, 0.3, 0.015, 0.03]),
        nothing=np.zeros(1, BANK),
        rate_deviation=configuration.maximum_yaw_rate_deviation,
        least_loss=least_loss(geometry.rim.size),
        period=period,
        rows=configuration.steps_until_twist + math.ceil(WINDOW_NS * 1e-9 / period) + 2,
        drop=np.abs(geometry.rim) * torque / configuration.wheel_inertia,
        pushes=configuration.brake.is_ramped,
        dead=DEAD if modeled else 0.0,
    )


def bank_memory(constants: BankConstants) -> BankMemory:
    """Return the initial memory of the filter bank, without any reading."""
    wheels, rows = constants.roll.size, constants.rows
    return BankMemory(
        np.zeros((FILTERS, STATES)),
        np.zeros((FILTERS, STATES, STATES)),
        np.zeros(HYPOTHESES),
        np.zeros(HYPOTHESES),
        np.zeros(1, BANK),
        np.zeros(3),
        np.zeros(wheels),
        np.full(wheels, np.nan),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros(wheels),
        np.zeros((HYPOTHESES, wheels)),
        np.full(wheels, np.nan),
        np.zeros(3),
        np.zeros(3),
        np.zeros(GYRO + 1),
        np.zeros(rows, _ROW),
        np.zeros((rows, 2, wheels)),
        np.zeros(2, np.int64),
        np.zeros(STATES),
        np.zeros(STATES),
    )


@lean
def begin(constants: BankConstants, memory: BankMemory, now_ns: int, twist: TwistSample) -> None:
    """Initialize all filters with large variances, and with the twist if one has been received.

    Without a twist, the wheels determine the velocity. They roll, because the pedal is up.
    """
    memory.record[0] = constants.nothing[0]
    bank = memory.record[0]
    bank.begun = True
    bank.horizon_ns = now_ns
    bank.twist_ns = now_ns - 1
    bank.received = twist.validity == VALID
    for j in range(memory.twist.size):
        memory.twist[j] = twist.value[j] if bank.received else 0.0
    bank.kept = NO_ESTIMATE
    bank.gyro, bank.unmeasured = math.nan, constants.period
    memory.newest[1] = memory.newest[0]
    memory.released[:] = 0.0
    memory.rim[:] = math.nan
    memory.idle[:] = memory.mark[:] = memory.torque[:] = memory.most[:] = 0.0
    memory.pressure[:] = memory.slowest[:] = 0.0
    memory.faulty[:FILTERS] = PRIOR
    memory.rows["stamp_ns"][:] = -1
    memory.spread[:] = 0.0
    memory.covariance[:] = 0.0
    memory.state[:] = 0.0
    reset_posterior(constants, memory)
    for k in range(FILTERS):
        memory.state[k, U_X] = memory.twist[0] - memory.twist[RATE] * constants.p_y
        memory.state[k, U_Y] = memory.twist[1] + memory.twist[RATE] * constants.p_x
        memory.state[k, RATE] = memory.twist[RATE]
        for j in range(STATES):
            memory.covariance[k, j, j] = constants.initial[j] ** 2


@lean
def reset_posterior(constants: BankConstants, memory: BankMemory) -> None:
    """Set the probabilities of the hypotheses to their priors."""
    for k in range(HYPOTHESES):
        memory.posterior[k] = math.log(constants.prior[k])
