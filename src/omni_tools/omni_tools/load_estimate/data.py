"""Motion of a drive as data for the estimate of the load: twist, wheel speeds, brake torques."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from omni_core import configuration, quantities, topics
from omni_core.geometry import WheelMount, turned
from omni_runs.recorded_run import Stream, measured_twist, ordered, values_of

_WHEELS, _PEDAL = topics.WHEEL_STATES, topics.PEDAL
REQUIRED = (_WHEELS, _PEDAL)
"""Topics that a drive must contain, in addition to that of the twist."""

# Tangent of the largest direction of motion from a steered wheel's heading. Its cosine changes a
# measured radius of 0.2 m by less than 0.01 mm.
_STRAIGHT = math.tan(math.radians(0.5))


class LoadDataError(configuration.InputError):
    """A drive does not determine the load; the message states why."""


class DriveData(NamedTuple):
    """A drive with K samples of N wheels.

    Attributes:
        time: time of the samples [s], increasing, shape (K,).
        twist: twist of `base_link` in the body frame [m/s, m/s, rad/s], shape (K, 3).
        wheel_speed: rotational speed of each wheel [rad/s], shape (K, N).
        torque: size of the torque of each brake [N m], NaN if it is not measured, shape (K, N).
        pedal: position of the pedal [1], shape (K,).
    """

    time: quantities.FloatArray
    twist: quantities.FloatArray
    wheel_speed: quantities.FloatArray
    torque: quantities.FloatArray
    pedal: quantities.FloatArray


def drive_data(streams: Mapping[str, Stream], wheels: Sequence[str], twist_topic: str) -> DriveData:
    """Return the samples at the stamps of the wheel speeds for which a twist is known.

    Args:
        streams: messages keyed by topic name, including those of `REQUIRED` and the twist.
        wheels: names of the wheels, in the order of the columns.
        twist_topic: topic of the twist.

    Raises:
        LoadDataError: the messages name other wheels, or contain no twist or no pedal.
    """
    states, twists, pedal = (streams[name] for name in (_WHEELS.name, twist_topic, _PEDAL.name))
    try:
        speed = np.array([ordered(message, "velocity", wheels) for message in states.messages])
        rows = [values_of(message, "brake_torque", wheels) for message in states.messages]
    except ValueError as error:
        raise LoadDataError(f"{error}; is it a drive of this vehicle?") from None
    moved = np.array([measured_twist(message.twist) for message in twists.messages])
    known = np.all(np.isfinite(moved), axis=1)
    demand = np.array([values_of(message, "pedal", wheels) for message in pedal.messages])
    if not np.any(known) or not np.all(np.isfinite(demand)):
        lacking = "a finite demand on brake/pedal" if np.any(known) else f"a twist on {twist_topic}"
        raise LoadDataError(f"the drive does not have {lacking}")
    stamps, moved = twists.stamp_ns[known], moved[known]
    inside = (states.stamp_ns >= stamps[0]) & (states.stamp_ns <= stamps[-1])
    at = states.stamp_ns[inside]
    held = np.clip(np.searchsorted(pedal.stamp_ns, at, side="right") - 1, 0, None)
    torque = np.array([np.broadcast_to(row, (len(wheels),)) for row in rows], np.float64)
    return DriveData(
        time=1e-9 * (at - states.stamp_ns[0]).astype(np.float64),
        twist=np.column_stack([np.interp(at, stamps, column) for column in moved.T]),
        wheel_speed=speed[inside],
        torque=np.abs(torque)[inside],
        pedal=demand[held],
    )


def joined(parts: Sequence[DriveData]) -> DriveData:
    """Return several drives as one; a missing second separates them."""
    times, start = [], 0.0
    for part in parts:
        times.append(part.time + start)
        start = float(times[-1][-1]) + 1.0 if len(part.time) else start
    columns = zip(*(part[1:] for part in parts), strict=True)
    return DriveData(np.concatenate(times), *(np.concatenate(column) for column in columns))


def unsteered(drive: DriveData, wheels: Mapping[str, WheelMount], duration: float) -> DriveData:
    """Return the samples in which steered wheels roll in the direction of their heading.

    The wheel speeds are evaluated for a steering angle of 0, which these samples have.

    Args:
        drive: the drive.
        wheels: wheels of the vehicle.
        duration: duration of the moving mean of the twist, which reduces its noise [s].
    """
    if len(drive.time) < 2 or not any(mount.is_steered for mount in wheels.values()):
        return drive
    window = np.ones(max(1, round(duration / float(np.median(np.diff(drive.time))))))
    x, y, turn = (np.convolve(column, window, mode="same") for column in drive.twist.T)
    straight = np.ones(len(drive.time), np.bool_)
    for mount in (one for one in wheels.values() if one.is_steered):
        heading = math.radians(mount.heading_deg)
        velocity = np.column_stack((x - turn * mount.y, y + turn * mount.x))
        along, across = turned(velocity, -heading).T
        straight &= np.abs(across) < _STRAIGHT * np.abs(along)
    return DriveData(*(column[straight] for column in drive))


def free_blocks(drive: DriveData, duration: float, slowest: float, largest: float) -> list[slice]:
    """Return the rows of consecutive time spans in which the vehicle rolls freely.

    A span is used if all wheels turn without braking and the speed is nearly constant, in this span
    and in both of its neighbors.

    Args:
        drive: the drive.
        duration: duration of a span [s].
        slowest: smallest speed of a turning wheel [rad/s].
        largest: limit on the angular acceleration of each wheel [rad/s^2].
    """
    if len(drive.time) < 2:
        return []
    edges = np.arange(drive.time[0], drive.time[-1] + duration, duration)
    cuts = np.searchsorted(drive.time, edges)
    rows = [slice(int(one), int(two)) for one, two in itertools.pairwise(cuts)]
    free = [_rolls(drive, row, duration, slowest, largest) for row in rows]
    padded = [True, *free, True]
    return [row for k, row in enumerate(rows) if all(padded[k : k + 3])]


def _rolls(drive: DriveData, row: slice, duration: float, slowest: float, largest: float) -> bool:
    time, speed = drive.time[row], drive.wheel_speed[row]
    whole = len(time) > 2 and float(np.max(np.diff(time))) < 0.5 * duration
    if not whole or np.any(drive.pedal[row] > 0.0) or np.min(np.abs(speed)) < slowest:
        return False
    half = len(time) // 2
    gain = np.mean(speed[half:], axis=0) - np.mean(speed[:half], axis=0)
    elapsed = float(np.mean(time[half:]) - np.mean(time[:half]))
    turns_back = bool(np.any(np.sign(speed) != np.sign(speed[0])))
    return not turns_back and float(np.max(np.abs(gain))) < largest * elapsed
