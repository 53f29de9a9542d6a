"""Error models of the sources of a body twist.

A model samples and delays the true twist, and adds white noise and a constant scale error. Above
its maximum speed, and for lost samples, a model gives no measurement. A comment at each model
states the origin of its numbers. Flow chips count how far the ground has moved between two images,
and each chip takes its images at its own times. Wheel odometry has no error model, because it uses
the simulated encoders. If no twist is available, the assistant estimates the motion from encoders
and IMU.
"""

import dataclasses
import math
from collections import deque

import numpy as np

from omni_core import quantities, signals
from omni_core.kinematics import PlatformKinematics
from omni_core.sensors import COUNT_DEVIATION, FlowSensor, sensor_matrix
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
        lost: share of the samples, or of each flow chip's images, without a measurement [1].
        maximum_speed: limit on the measurable speed [m/s].
        cameras: file in ``config/sensors/`` with line cameras that replace the error model.
        chips: number of flow chips, whose counts replace the white noise of an error model.
        counts: counts of a flow chip per distance [1/m].
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
    chips: int = 0
    counts: float = 0.0


_CHIPS = {
    # Data sheet: 15-35 mm, 1.14 m/s; noise 2 % of the speed.
    "PAA5100JE": (0.025, 0.02, 1.14),
    # Data sheet: 80 mm and more, 7.4 rad/s: 0.74 m/s at 0.1 m; noise 3 % of the speed.
    "PMW3901": (0.1, 0.03, 0.74),
}
"""Properties of each chip type: height above the ground [m]; error relative to the speed [1], used
for noise and for the scale error; maximum speed [m/s]."""

_COUNTS_PER_RADIAN = 385.0
"""Counts of a flow chip per angle by which the ground moves, from PX4's driver of the PMW3901; the
PAA5100JE is assumed to have the same optics [1/rad]."""
_IMAGE_PERIOD = 1.0 / 121.0
"""Time between two images of a flow chip, from the seller of the PMW3901; users have measured the
same value. The PAA5100JE, whose data sheet states none, is assumed to have the same [s]."""
_LEVER = 0.4
"""Distance of each flow chip from the center of the vehicle [m]."""


def _chips(chip: str, count: int) -> Source:
    height, share, fastest = _CHIPS[chip]
    return Source(
        f"{count} x {chip}",
        relative=share,
        scale=share,
        period=_IMAGE_PERIOD,
        maximum_speed=fastest,
        chips=count,
        counts=_COUNTS_PER_RADIAN / height,
    )


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
    # No data sheet states how many images of a chip are invalid; 5 % are assumed.
    "paa5100_2_lost": dataclasses.replace(
        _chips("PAA5100JE", 2), label="2 x PAA5100JE, 5 % of images invalid", lost=0.05
    ),
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


class SourceModel:
    """Simulated measurements of a source of the twist.

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
        self._chips = FlowChips(source, self._random) if source.chips else None

    def measure(
        self, now_ns: int, twist: quantities.FloatArray, wheel_speed: quantities.FloatArray
    ) -> signals.TwistSample:
        """Return the latest measurement that has arrived.

        Before the first arrival, the result is an unmeasured twist with a very old stamp.

        Args:
            now_ns: time since the start of the run [ns], increasing.
            twist: true body twist at this time [m/s, m/s, rad/s], shape (3,).
            wheel_speed: speeds that the encoders measure [rad/s], shape (N,).
        """
        source = self._source
        due = now_ns - self._sampled_ns >= round(source.period * 1e9)
        if due and source.kind != NOTHING:
            self._sampled_ns = now_ns
            arrival_ns = now_ns + round(source.latency * 1e9)
            self._waiting.append((arrival_ns, self._sample(now_ns, twist, wheel_speed)))
        while self._waiting and self._waiting[0][0] <= now_ns:
            self._last = self._waiting.popleft()[1]
        return self._last

    def _sample(
        self, stamp_ns: int, twist: quantities.FloatArray, wheel_speed: quantities.FloatArray
    ) -> signals.TwistSample:
        source = self._source
        if self._chips is not None:
            return self._chips.measure(stamp_ns, twist)
        if source.kind == WHEELS:
            rolling = self._kinematics.twist(wheel_speed)
            return signals.TwistSample(stamp_ns, rolling, np.diag([0.02, 0.02, 0.04]) ** 2)
        speed = math.hypot(*twist[:2])
        lost = self._random.random() < source.lost
        noise = self._random.standard_normal(3)
        if lost or speed > source.maximum_speed:
            return signals.TwistSample(stamp_ns, np.zeros(3), _UNMEASURED)
        linear = max(math.hypot(source.linear, source.relative * speed), SMALLEST_DEVIATION)
        deviation = np.array([linear, linear, max(source.turning, SMALLEST_DEVIATION)])
        scale = np.array([self._scale, self._scale, 1.0])
        # The stated covariance includes the scale error, as in a data sheet.
        stated = deviation**2 + np.array([1.0, 1.0, 0.0]) * (source.scale * speed) ** 2
        value: quantities.FloatArray = scale * twist + deviation * noise
        return signals.TwistSample(stamp_ns, value, np.diag(stated))


class FlowChips:
    """Flow chips around the center of a vehicle, and the twist that their counts give.

    Each chip integrates the motion along its axes. At each of its images, it writes the count,
    rounded down to an integer, to its register. The sensor driver divides the difference between
    the counts of two images by the time between the images.

    Args:
        source: properties of the chips.
        random: source of the noise and of the times of the images.
    """

    def __init__(self, source: Source, random: np.random.Generator) -> None:
        self._source, self._random = source, random
        angles = math.tau / source.chips * np.arange(source.chips)
        places = _LEVER * np.column_stack((np.cos(angles), np.sin(angles)))
        self._matrix = sensor_matrix(
            {str(place): FlowSensor(x=place[0], y=place[1], heading_deg=0.0) for place in places}
        )
        self._scale = 1.0 + source.scale * np.repeat(random.standard_normal(source.chips), 2)
        self._phase = np.repeat(random.uniform(0.0, 1.0, source.chips), 2)
        self._path = random.uniform(0.0, 1.0, 2 * source.chips)  # [counts]
        self._counted = self._velocity = np.zeros(2 * source.chips)  # at the last image [1], [m/s]
        self._before: tuple[int, quantities.FloatArray] | None = None

    def measure(self, stamp_ns: int, twist: quantities.FloatArray) -> signals.TwistSample:
        """Return the twist computed from the latest images of all chips.

        Args:
            stamp_ns: time since the start of the run [ns], increasing.
            twist: true body twist at this time [m/s, m/s, rad/s], shape (3,).
        """
        source, true = self._source, self._matrix @ twist
        if self._before is None:
            self._before, self._velocity = (stamp_ns, true), self._scale * true
            since = source.counts * source.period * self._phase * self._velocity
            self._counted = np.floor(self._path - since)
        (before_ns, earlier), self._before = self._before, (stamp_ns, true)
        elapsed = 1e-9 * (stamp_ns - before_ns)
        moved = source.counts * self._scale * 0.5 * (earlier + true) * elapsed
        moved *= 1.0 + source.relative * self._random.standard_normal(len(moved))
        passed = self._phase + elapsed / source.period  # since the last image [image periods]
        for number in range(1, int(np.max(passed)) + 1):
            share = (number - self._phase) * source.period / elapsed  # of this step, before it
            counted = np.where(share <= 1.0, np.floor(self._path + share * moved), self._counted)
            velocity = (counted - self._counted) / (source.counts * source.period)
            self._velocity = np.where(share <= 1.0, velocity, self._velocity)
            self._counted = counted
        self._path, self._phase = self._path + moved, passed % 1.0
        newest_ns = stamp_ns - round(1e9 * source.period * float(np.min(self._phase)))
        speed = math.hypot(*twist[:2])
        valid = np.repeat(self._random.random(source.chips) >= source.lost, 2)
        # One chip alone cannot measure the yaw rate.
        if speed > source.maximum_speed or np.count_nonzero(valid) < 4:
            return signals.TwistSample(newest_ns, np.zeros(3), _UNMEASURED)
        rounding = COUNT_DEVIATION / (source.counts * source.period)
        deviation = math.hypot(rounding, source.relative * speed, source.scale * speed)
        rows = self._matrix[valid]
        spread = np.asarray(np.linalg.inv(rows.T @ rows), np.float64)
        value = spread @ (rows.T @ self._velocity[valid])
        return signals.TwistSample(newest_ns, value, deviation**2 * spread)
