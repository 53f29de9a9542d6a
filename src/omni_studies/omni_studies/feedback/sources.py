"""Error models of the sources of a body twist.

A model samples and delays the true twist, and adds white noise and a constant scale error. Above
its maximum speed, and for lost samples, a model gives no measurement. A comment at each model names
the source of its numbers. Wheel odometry has no error model, because it uses the simulated
encoders. Without a twist, the assistant estimates the motion from encoders and IMU.
"""

import dataclasses
import math
from collections import deque

import numpy as np

from omni_platform import quantities, signals
from omni_platform.kinematics import PlatformKinematics
from omni_sim.simulator import Observation
from omni_sim.velocity_sensor import SMALLEST_DEVIATION

MODEL, WHEELS, NOTHING = "model", "wheels", "nothing"
_UNMEASURED = signals.UNMEASURED_VARIANCE * np.eye(3)
_NEVER_NS = -(10**18)  # older than any timeout [ns]


@dataclasses.dataclass(frozen=True)
class Source:
    """A source of the body twist.

    Attributes:
        label: label for tables.
        kind: error model, wheel odometry, or no twist.
        linear: standard deviation of v_x and v_y [m/s].
        turning: standard deviation of the yaw rate [rad/s].
        relative: standard deviation of v_x and v_y as a share of the speed, in addition to `linear`
            [1].
        scale: standard deviation of the constant scale error [1].
        period: period of the samples [s].
        latency: time from the measurement to the message [s].
        lost: share of the samples that have no measurement [1].
        maximum_speed: limit on the measurable speed [m/s].
        cameras: file in ``config/sensors/`` with line cameras that replace the error model.
    """

    label: str
    kind: str = MODEL
    linear: float = 0.0
    turning: float = 0.0
    relative: float = 0.0
    scale: float = 0.0
    period: float = 0.01
    latency: float = 0.0
    lost: float = 0.0
    maximum_speed: float = math.inf
    cameras: str = ""


_CHIPS = {
    # Data sheet: 15-35 mm, 1.14 m/s; noise 2 % of the speed.
    "PAA5100JE": (0.01, 0.02, 1.14),
    # Data sheet: 80 mm and more, 7.4 rad/s: 0.74 m/s at 0.1 m; noise 3 % of the speed.
    "PMW3901": (0.02, 0.03, 0.74),
}
"""Properties of each chip type: constant standard deviation [m/s]; error relative to the speed [1],
used for noise and for the scale error; maximum speed [m/s]."""


def _chips(chip: str, count: int, lever: float = 0.4) -> Source:
    """Return a source made of several flow chips at a distance `lever` from the center [m]."""
    linear, share, fastest = _CHIPS[chip]
    shared = linear / math.sqrt(count)
    noise = shared, shared / lever, share, share
    return Source(f"{count} x {chip}", MODEL, *noise, maximum_speed=fastest)


# Numbers without a name: standard deviation of v_x and v_y, of the yaw rate, per speed, and of the
# scale.
SOURCES = {
    "ideal": Source("ideal, 100 Hz"),
    # Studies integrity (1024 px), accuracy and covariance (fewer): RMSE and availability.
    **{
        name: Source(f"3 line cameras, {pixels} px", MODEL, *noise, lost=lost, cameras=cameras)
        for name, pixels, noise, lost, cameras in (
            ("lines_coarse", 256, (0.03, 0.05), 0.1, "three_coarse"),
            ("lines", 335, (0.008, 0.015), 0.03, "lis_770i"),
            ("lines_fine", 1024, (0.005, 0.007), 0.1, "three_generic"),
        )
    },
    **{
        f"{chip.lower().removesuffix('je')}_{count}": _chips(chip, count)
        for chip in _CHIPS
        for count in (2, 3)
    },
    # Data sheet: 2.5 m/s, filtered with its IMU; the delay of the filter is assumed.
    "otos": Source("SparkFun OTOS", MODEL, 0.01, 0.02, 0.01, 0.01, latency=0.01, maximum_speed=2.5),
    # Data sheets of such sensors: 0.1 % of the speed, 250 Hz, 6 ms.
    "correvit": Source(
        "optical 2-D sensor (Correvit type) and gyro", MODEL, 0.01, 5e-3, 1e-3, 1e-3, latency=6e-3
    ),
    "encoders": Source("wheel encoders alone", WHEELS),
    "encoders_imu": Source("no twist: encoders and IMU", NOTHING),
    "late_20ms": Source("ideal, 20 ms late", latency=0.02),
    "late_50ms": Source("ideal, 50 ms late", latency=0.05),
    "late_100ms": Source("ideal, 100 ms late", latency=0.1),
    "rate_50hz": Source("ideal, 50 Hz", period=0.02),
    "rate_25hz": Source("ideal, 25 Hz", period=0.04),
}


class SourceEstimator:
    """Estimator that returns the simulated measurements of a source of the twist.

    Args:
        source: error model of the source.
        kinematics: kinematics of the wheels, for wheel odometry.
        seed: seed of the noise.
    """

    def __init__(self, source: Source, kinematics: PlatformKinematics, seed: int) -> None:
        self._source = source
        self._kinematics = kinematics
        self._random = np.random.default_rng(seed)
        self._scale = 1.0 + source.scale * float(self._random.standard_normal())
        self._waiting: deque[tuple[int, signals.TwistSample]] = deque()  # by arrival time [ns]
        self._last = signals.TwistSample(_NEVER_NS, np.zeros(3), _UNMEASURED)
        self._sampled_ns = _NEVER_NS

    def estimate(self, observation: Observation) -> signals.TwistSample:
        """Return the latest measurement that has arrived.

        Before the first arrival, the result is an unmeasured twist with a very old stamp.
        """
        now_ns, source = observation.stamp_ns, self._source
        due = now_ns - self._sampled_ns >= round(source.period * 1e9)
        if due and source.kind != NOTHING:
            self._sampled_ns = now_ns
            arrival_ns = now_ns + round(source.latency * 1e9)
            self._waiting.append((arrival_ns, self._measure(observation)))
        while self._waiting and self._waiting[0][0] <= now_ns:
            self._last = self._waiting.popleft()[1]
        return self._last

    def _measure(self, observation: Observation) -> signals.TwistSample:
        source, stamp_ns = self._source, observation.stamp_ns
        if source.kind == WHEELS:
            twist = self._kinematics.twist(observation.encoder_speed)
            return signals.TwistSample(stamp_ns, twist, np.diag([0.02, 0.02, 0.04]) ** 2)
        speed = math.hypot(*observation.twist[:2])
        lost = self._random.random() < source.lost
        noise = self._random.standard_normal(3)
        if lost or speed > source.maximum_speed:
            return signals.TwistSample(stamp_ns, np.zeros(3), _UNMEASURED)
        linear = max(math.hypot(source.linear, source.relative * speed), SMALLEST_DEVIATION)
        deviation = np.array([linear, linear, max(source.turning, SMALLEST_DEVIATION)])
        scale = np.array([self._scale, self._scale, 1.0])
        # The stated covariance includes the scale error, as in a data sheet.
        stated = deviation**2 + np.array([1.0, 1.0, 0.0]) * (source.scale * speed) ** 2
        value: quantities.FloatArray = scale * observation.twist + deviation * noise
        return signals.TwistSample(stamp_ns, value, np.diag(stated))
