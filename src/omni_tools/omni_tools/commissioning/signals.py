"""Signals of a recorded commissioning drive: three slow motions and some stops.

The vehicle is driven forward, to the left and counter-clockwise, each time from rest to rest over a
measured distance or angle. It is then driven and braked in several directions. If a velocity
command of zero brakes, the three motions end with braking, too.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from omni_core import topics
from omni_core.configuration import ConfigurationError
from omni_core.quantities import CONTROL_PERIOD, FloatArray, IntArray
from omni_recording.folder import open_vehicle
from omni_runs.recorded_run import Stream, measured_twist, read_streams, values_of

MOTIONS = ("forward", "left", "counter-clockwise")
TOPICS = tuple(one for one in topics.OF_REAL_VEHICLE if one != topics.DIAGNOSTICS)
"""Topics that are read from a recording; wheel speeds and pedal are required."""

_WHEELS, _PEDAL, _ENABLE, _TWIST, _IMU = (topic.name for topic in TOPICS)

_SHORTEST = 0.3
"""Minimum duration of a motion, and of a rest between two motions [s]."""

_LARGEST = 1e6
"""Magnitude at or above which a reading counts as missing [unit of its topic]."""

# Speed above which a wheel counts as moving, and minimum peak speed of a motion, both as a share
# of the largest speed [1].
_MOVES = (0.01, 0.03)


class Signals(NamedTuple):
    """Signals of a commissioning drive at T equally spaced times, N wheels; missing values are NaN.

    Attributes:
        time: times of the rows [s], shape (T,).
        wheel_speed: rotational speed of each wheel [rad/s], shape (T, N).
        twist: measured body twist [m/s, m/s, rad/s], shape (T, 3).
        imu: yaw rate [rad/s] and specific force [m/s^2], shape (T, 3).
        pedal: braking demand [1], shape (T,).
        enable: brake enables [1], shape (T, N).
        upwards: median specific force of the IMU along z [m/s^2]; NaN without an IMU.
        inverse_pedal: whether the pedal was received inverted; `pedal` is corrected.
    """

    time: FloatArray
    wheel_speed: FloatArray
    twist: FloatArray
    imu: FloatArray
    pedal: FloatArray
    enable: FloatArray
    upwards: float = math.nan
    inverse_pedal: bool = False

    @property
    def period(self) -> float:
        """Time between two rows [s]."""
        return float(self.time[1] - self.time[0])


class Motions(NamedTuple):
    """Quantities measured in the three motions of a commissioning drive, with N wheels.

    Attributes:
        angle: angle by which each wheel turned [rad], shape (3, N).
        twist: integral of the measured twist [m, m, rad], shape (3, 3).
        gyro: integral of the gyro's yaw rate [rad], shape (3,).
        force: acceleration along x and y that the IMU measures at the start of each motion [m/s^2],
            shape (3, 2).
        stop: rows of all stops, from the start of the fourth motion to the end of the last stop.
    """

    angle: FloatArray
    twist: FloatArray
    gyro: FloatArray
    force: FloatArray
    stop: slice


def read_signals(
    recording: Path, wheels: Sequence[str], imu_axes: FloatArray | None = None
) -> Signals:
    """Return the signals in a recording of a commissioning drive.

    Args:
        recording: rosbag2 folder.
        wheels: names of the vehicle's wheels, in the order of the columns.
        imu_axes: as in `signals_of`.

    Raises:
        BagError: the recording cannot be read.
        ConfigurationError: the messages are not those of a commissioning drive of this vehicle;
            `signals_of` lists the reasons.
    """
    return signals_of(read_streams(open_vehicle(recording), TOPICS, TOPICS[:2]), wheels, imu_axes)


def signals_of(
    streams: Mapping[str, Stream], wheels: Sequence[str], imu_axes: FloatArray | None = None
) -> Signals:
    """Return the signals of a commissioning drive, sampled at equally spaced times.

    Wheel speeds are interpolated; all other signals hold their newest value.

    Args:
        streams: messages keyed by topic name, including at least those of wheels and pedal.
        wheels: names of the vehicle's wheels, in the order of the columns.
        imu_axes: matrix from the axes of the IMU to those of `base_link`, (3, 3); None if equal.

    Raises:
        ConfigurationError: the wheels of the messages have other names; a gap between wheel speeds
            is so long that a motion or a rest may be missed; the recording is shorter than a
            motion; a wheel has no speeds; or a braking demand is outside [0, 1].
    """
    nothing = Stream(np.zeros(0, np.int64), ())
    streams = {topic.name: streams.get(topic.name, nothing) for topic in TOPICS}
    states = streams[_WHEELS]
    _check_completeness(states, wheels)
    time = np.arange(states.stamp_ns[0], states.stamp_ns[-1], round(CONTROL_PERIOD * 1e9))

    def sampled(topic: str, rows: Any, columns: int) -> FloatArray:
        return _newest_values(time, streams[topic].stamp_ns, rows, columns)

    speeds = _by_wheel(states, "velocity", wheels)
    speeds[~(np.abs(speeds) < _LARGEST)] = math.nan
    unmeasured = [w for w, lost in zip(wheels, np.isnan(speeds.T), strict=True) if lost.all()]
    if unmeasured:
        raise ConfigurationError(
            _WHEELS, f"has no speed of {', '.join(unmeasured)}; the check needs wheel encoders"
        )
    vectors = _imu_vectors(streams[_IMU], imu_axes)
    demands = [values_of(m, "pedal", wheels) for m in streams[_PEDAL].messages]
    pedal = sampled(_PEDAL, demands, 1)[:, 0]
    if not np.all(np.isnan(pedal) | ((pedal >= 0.0) & (pedal <= 1.0))):
        raise ConfigurationError(
            _PEDAL, f"is {np.nanmin(pedal):g} to {np.nanmax(pedal):g}, must be a share from 0 to 1"
        )
    wheel_speed = np.stack([np.interp(time, states.stamp_ns, s) for s in speeds.T], axis=1)
    # Brakes reduce the speed of the wheels.
    gained = np.diff(np.sum(np.abs(wheel_speed), axis=1), append=0.0)
    inverse = float(np.nansum(pedal * gained)) > 0.0
    twists = [measured_twist(message.twist) for message in streams[_TWIST].messages]
    return Signals(
        time=(time - time[0]) * 1e-9,
        wheel_speed=wheel_speed,
        twist=sampled(_TWIST, twists, 3),
        imu=sampled(_IMU, vectors[:, (0, 1, 1), (2, 0, 1)], 3),
        pedal=1.0 - pedal if inverse else pedal,
        enable=sampled(_ENABLE, _by_wheel(streams[_ENABLE], "effort", wheels), len(wheels)),
        upwards=float(np.median(vectors[:, 1, 2])) if len(vectors) else math.nan,
        inverse_pedal=inverse,
    )


def _imu_vectors(stream: Stream, axes: FloatArray | None) -> FloatArray:
    """Return angular velocity and specific force in `base_link`, shape (messages, 2, 3)."""
    vectors = (v for m in stream.messages for v in (m.angular_velocity, m.linear_acceleration))
    rows = np.array([(one.x, one.y, one.z) for one in vectors], np.float64).reshape(-1, 2, 3)
    return rows if axes is None else np.asarray(rows @ axes.T)


def _newest_values(time: IntArray, stamps: IntArray, rows: Any, columns: int) -> FloatArray:
    """Return the newest row at each time, shape (T, columns); NaN without a usable value.

    Args:
        time: times [ns], shape (T,).
        stamps: stamps of the rows [ns], shape (m,).
        rows: values of m messages.
        columns: number of values of a message.
    """
    if not len(stamps):
        return np.full((len(time), columns), math.nan)
    newest = np.searchsorted(stamps, time, side="right") - 1
    values = np.array(rows, np.float64).reshape(len(stamps), columns)
    usable = (newest >= 0)[:, np.newaxis] & (np.abs(values[newest]) < _LARGEST)
    return np.where(usable, values[newest], math.nan)


def _check_completeness(states: Stream, wheels: Sequence[str]) -> None:
    """Raise `ConfigurationError` for wrong wheels, a long gap, or a recording that is too short."""
    names = list(states.messages[0].name)
    if not set(wheels) <= set(names):
        raise ConfigurationError(
            "wheels", f"the recording names {', '.join(names)}, the vehicle {', '.join(wheels)}"
        )
    gaps = np.diff(states.stamp_ns, append=states.stamp_ns[-1]) * 1e-9
    if np.max(gaps) > _SHORTEST:
        at = (states.stamp_ns[np.argmax(gaps)] - states.stamp_ns[0]) * 1e-9
        raise ConfigurationError(
            "recording",
            f"has no wheel speeds for {np.max(gaps):.2g} s after {at:.1f} s: "
            "messages are missing, or the clock jumped ahead",
        )
    if np.sum(gaps) < _SHORTEST:
        raise ConfigurationError(
            "recording", f"has wheel speeds of {np.sum(gaps):.2g} s by their stamps; record the run"
        )


def _by_wheel(stream: Stream, field: str, wheels: Sequence[str]) -> FloatArray:
    """Return a field of all messages, shape (messages, wheels); NaN if a message omits a wheel."""
    found = [
        dict(zip(message.name, getattr(message, field), strict=False))
        for message in stream.messages
    ]
    rows = [[row.get(wheel, math.nan) for wheel in wheels] for row in found]
    return np.array(rows, np.float64).reshape(-1, len(wheels))


def unchecked(drive: Signals, motions: Motions) -> dict[str, str]:
    """Return the parts of the vehicle that cannot be checked, keyed by the topic lacking values."""
    nothing = np.zeros(0)
    needs = {
        _TWIST: (motions.twist, drive.twist, "twist sensor and brakes"),
        _IMU: (motions.gyro, drive.imu, "IMU"),
        _ENABLE: (nothing, drive.enable, "order of the brakes"),
    }
    return {
        topic: what
        for topic, (moved, values, what) in needs.items()
        if np.any(np.isnan(moved)) or np.any(np.all(np.isnan(values[motions.stop]), axis=0))
    }


def motions_of(drive: Signals, wheels: Sequence[str] = ()) -> Motions:
    """Return the quantities measured in the three motions of a run, and the rows of its stops.

    Args:
        drive: signals of the run.
        wheels: names of the wheels, for messages.

    Raises:
        ConfigurationError: the run does not contain three motions, followed by a stop; or brakes
            end some of the motions, but not all.
    """
    # The mean over 0.1 s removes the encoder steps of a wheel that moves slowly.
    smooth = uniform_filter1d(np.nan_to_num(drive.wheel_speed), round(0.1 / drive.period), axis=0)
    speed = np.max(np.abs(smooth), axis=1)
    found = _runs(speed, drive.period)
    turning = np.max(np.abs(np.nan_to_num(drive.wheel_speed)), axis=1) > _MOVES[0] * np.max(speed)
    pressed = turning & (np.nan_to_num(drive.pedal) > 0.0)
    stops = [bool(np.any(pressed[row][np.argmax(speed[row]) :])) for row in found]
    if not any(stops):
        raise ConfigurationError(
            _PEDAL, "is 0 or unknown in all motions; brake after the three motions"
        )
    free = stops.index(True)
    if free != len(MOTIONS) and not (all(stops) and len(stops) > len(MOTIONS)):
        _check_rest(smooth[: found[free].stop], np.max(speed), wheels)
        raise ConfigurationError(
            "recording",
            f"has {free} motions before the first stop, must have three: drive "
            f"{', '.join(MOTIONS)}, with a pause after each, then drive and brake",
        )
    rows, first = found[: len(MOTIONS)], found[len(MOTIONS)].start
    after = np.flatnonzero(speed[first:] > 0.02 * np.max(speed))
    last = first + int(after[-1]) + 1
    begun = [slice(row.start, row.start + max((row.stop - row.start) // 5, 5)) for row in rows]
    dt = drive.period
    return Motions(
        angle=np.array([_integral(drive.wheel_speed[row], dt) for row in rows]),
        twist=np.array([_integral(drive.twist[row], dt) for row in rows]),
        gyro=np.array([_integral(drive.imu[row, :1], dt)[0] for row in rows]),
        # From rest to rest, the mean is the error by a tilt or an offset of the accelerometer.
        force=np.array(
            [
                np.mean(drive.imu[start, 1:], axis=0) - np.mean(drive.imu[row, 1:], axis=0)
                for start, row in zip(begun, rows, strict=True)
            ]
        ),
        stop=slice(first, last),
    )


def _check_rest(speed: FloatArray, fastest: float, wheels: Sequence[str]) -> None:
    """Raise `ConfigurationError` if wheels never rest.

    Args:
        speed: speed of each wheel until the first stop [rad/s], shape (T, N).
        fastest: largest wheel speed of the run [rad/s].
        wheels: names of the wheels.
    """
    # A wheel rests during the pauses, which last longer than a tenth of the time.
    slowest = np.quantile(np.abs(speed), 0.1, axis=0)
    creeping = np.flatnonzero(slowest > _MOVES[0] * fastest).tolist()
    if creeping:
        named = wheels or [f"wheel {row}" for row in range(len(slowest))]
        names = ", ".join(f"{named[row]} {slowest[row]:.2g} rad/s" for row in creeping)
        raise ConfigurationError(
            _WHEELS,
            f"wheels turn at rest, too: {names}: stop the controller between the motions, or "
            "correct the zero of drives and encoders",
        )


def _integral(values: FloatArray, dt: float) -> FloatArray:
    """Return the integral of each column; a missing value is replaced by the column's mean."""
    known = np.isfinite(values)
    sums, counts = np.sum(np.where(known, values, 0.0), axis=0), np.sum(known, axis=0)
    return np.where(counts, sums * dt * len(values) / np.maximum(counts, 1), math.nan)


def _runs(speed: FloatArray, period: float) -> list[slice]:
    """Return the rows of each motion.

    A short rest does not end a motion, and short or slow motions are omitted.

    Args:
        speed: largest wheel speed [rad/s], shape (T,).
        period: period of the rows [s].
    """
    fastest = float(np.max(speed, initial=1e-9))
    moving = (speed > _MOVES[0] * fastest).astype(int)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], moving, [0]))))
    joined: list[list[int]] = []
    for first, last in edges.reshape(-1, 2):
        if joined and (first - joined[-1][1]) * period < _SHORTEST:
            joined[-1][1] = last
        else:
            joined.append([first, last])
    # Without this margin, the threshold would cut off the start and the end of a motion.
    edge = round(0.1 / period)
    return [
        slice(max(first - edge, 0), last + edge)
        for first, last in joined
        if (last - first) * period >= _SHORTEST and np.max(speed[first:last]) > _MOVES[1] * fastest
    ]
