"""Reading of a run from its rosbag2 folder, without ROS.

Only the topics of a `RunHistory` are decoded. The line batches, which make up nearly all of a
recording, are skipped. `ground_truth/odom` gives the control stamps. Every other message is
assigned to the first control stamp that is not before the stamp of the message. A twist of the
odometry has the stamp of its newest line, which is up to one line period before the control stamp.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omni_core import topics
from omni_core.geometry import turned
from omni_core.quantities import FloatArray, IntArray
from omni_core.signals import UNMEASURED_VARIANCE
from omni_recording.error import BagError
from omni_runs.history import SOURCES, RunHistory

if TYPE_CHECKING:
    from omni_recording.folder import Bag
    from omni_recording.mcap import RecordedChannel

_TRUTH, _WHEELS, _ESTIMATE = (
    one.name for one in (topics.GROUND_TRUTH, topics.WHEEL_STATES, topics.TWIST)
)
_ASSISTANT = "brake_assist"  # name of the assistant's diagnostics status, after the namespace
# If a run has no odometry or no brake assistant, the values are NaN.
_REQUIRED = (topics.WHEEL_STATES, topics.PEDAL)

# Diagonal of a row-major 6 x 6 covariance: v_x, v_y, rotation about z.
_VARIANCES = [0, 7, 35]


@dataclasses.dataclass(frozen=True)
class Stream:
    """Messages of one topic, sorted by stamp."""

    stamp_ns: IntArray
    messages: tuple[Any, ...]

    @classmethod
    def of(cls, entries: Iterable[tuple[int, Any]]) -> Stream:
        """Create a stream from pairs of stamp [ns] and message, sorted by stamp."""
        ordered = sorted(entries, key=lambda entry: entry[0])
        stamps = np.array([stamp for stamp, _ in ordered], dtype=np.int64)
        return cls(stamps, tuple(message for _, message in ordered))


def read_run(bag_folder: Path | str) -> RunHistory:
    """Return the history of a run that is recorded in a rosbag2 folder.

    The vehicle may have any namespace. A value for which no message was recorded is NaN. If the
    recording has no ground truth, because the vehicle is real, the motion in the history is the
    integral of the measured twist.

    Args:
        bag_folder: folder with ``metadata.yaml`` and the recording.

    Raises:
        BagError: the recording is missing, empty, truncated or damaged, lacks a topic, or contains
            more than one run.
    """
    from omni_recording.folder import open_vehicle

    bag = open_vehicle(bag_folder)
    chosen = (*(topic for topic, _ in SOURCES.values()), topics.DIAGNOSTICS)
    streams = read_streams(bag, chosen, _REQUIRED)
    assistant = f"{bag.namespace}/{_ASSISTANT}".removeprefix("/")
    try:
        return _to_history(streams, assistant)
    except (ValueError, IndexError) as error:
        raise BagError(bag.path, f"is not the recording of a single run: {error}") from error


def read_streams(
    bag: Bag, chosen: Iterable[topics.Topic], required: Collection[topics.Topic] = ()
) -> dict[str, Stream]:
    """Return the messages of the chosen topics, keyed by topic name without the namespace.

    Args:
        bag: the recording of a vehicle.
        chosen: topics to read.
        required: topics that must exist.

    Raises:
        BagError: the recording cannot be read, or lacks a topic, or a topic has another type, or
            the clock jumped between two messages of a topic, or a message after the
            first ones has the stamp 0.
    """
    from omni_recording import clock, decode, folder

    known = {topic.path: topic for topic in chosen}
    channels = [entry for entry in folder.bag_summary(bag).channels if entry.topic in known]
    missing = {topic.path for topic in required} - {channel.topic for channel in channels}
    if missing:
        lacking = ", ".join(sorted(missing))
        raise BagError(bag.path, f"is not a recording of a run: it lacks {lacking}")
    for channel in channels:
        _require_type(bag, channel, known)
    messages: dict[str, list[tuple[int, Any]]] = {}
    clocks: dict[str, clock.ClockWatch] = {}
    for recorded, message in decode.decoded_messages(bag, known):
        _require_type(bag, recorded.channel, known)
        stamp_ns = decode.header_stamp_ns(message)
        if stamp_ns is None:
            raise BagError(bag.path, f"{recorded.channel.topic} has no stamp")
        topic = known[recorded.channel.topic]
        if not topic.shared:  # of several publishers, one that hung is late, not the clock
            watch = clocks.setdefault(topic.path, clock.ClockWatch())
            watch.add(stamp_ns, recorded.log_ns)
        messages.setdefault(topic.name, []).append((stamp_ns, message))
    for path, watch in clocks.items():
        if watch.unset:
            raise BagError(
                bag.path,
                f"is not the recording of a single run: {watch.unset} messages of {path} have the "
                "stamp 0 after later ones",
            )
        if watch.jumps:
            raise BagError(
                bag.path,
                f"is not the recording of a single run: {path}: {watch.jumps[0]}: "
                "split the recording there",
            )
    for topic in required:
        if topic.name not in messages:
            raise BagError(
                bag.path,
                f"there is no message on {topic.path}; topics that the vehicle must publish: "
                "docs/real_vehicle.md",
            )
    return {name: Stream.of(entries) for name, entries in messages.items()}


def _require_type(bag: Bag, channel: RecordedChannel, known: Mapping[str, topics.Topic]) -> None:
    needed = known[channel.topic].type
    if channel.type_name != needed:
        problem = f"{channel.topic} is of type {channel.type_name}, must be {needed}"
        raise BagError(bag.path, problem)


def _to_history(streams: Mapping[str, Stream], assistant: str) -> RunHistory:
    motion = _true_motion(streams[_TRUTH]) if _TRUTH in streams else _integrated(streams)
    streams = {name: one for name, one in streams.items() if name != _ESTIMATE or _TRUTH in streams}
    stamps = motion["stamp_ns"]
    if np.any(np.diff(stamps) == 0):
        source = _TRUTH if _TRUTH in streams else _WHEELS
        raise ValueError(f"several messages of {source} have the same stamp")
    # The states may also name other joints; the enables name exactly the wheels.
    wheel_names = tuple(streams[_WHEELS].messages[0].name)
    if topics.ENABLE.name in streams:
        named = set(streams[topics.ENABLE.name].messages[0].name)
        if named <= set(wheel_names):
            wheel_names = tuple(name for name in wheel_names if name in named)

    def sampled(name: str) -> FloatArray:
        """Return an array of the history, shape (T, K) or (T,); NaN where it is unknown."""
        topic, signal = SOURCES[name]
        width = len(wheel_names) if signal.columns == topics.PER_WHEEL else len(signal.columns)
        rows = np.full((len(stamps), width) if width else len(stamps), np.nan)
        if topic.name in streams:
            stream = streams[topic.name]
            # t_{k-1} < stamp <= t_k; of several messages in one period, the last one is used.
            places = np.searchsorted(stamps, stream.stamp_ns, side="left")
            for place, message in zip(places.tolist(), stream.messages, strict=True):
                if place < len(stamps):
                    rows[place] = values_of(message, name, wheel_names)
        return rows

    arrays: dict[str, Any] = {
        name: sampled(name) for name, (topic, _) in SOURCES.items() if topic != topics.GROUND_TRUTH
    }
    arrays["pedal"] = _held(arrays["pedal"])
    return RunHistory.from_quaternions(
        wheel_names=wheel_names,
        **motion,
        **arrays,
        assist_state=_assist_states(stamps, streams.get(topics.DIAGNOSTICS.name), assistant),
    )


def _held(values: FloatArray) -> FloatArray:
    """Return values of which each holds until the next known one; NaN before the first."""
    known = np.isfinite(values)
    newest = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    return values[newest]


def _true_motion(truth: Stream) -> dict[str, Any]:
    poses = [message.pose.pose for message in truth.messages]
    return {
        "stamp_ns": truth.stamp_ns,
        "position": [(pose.position.x, pose.position.y) for pose in poses],
        "orientation": [(pose.orientation.z, pose.orientation.w) for pose in poses],
        "twist": [planar_twist(message.twist.twist) for message in truth.messages],
    }


def _integrated(streams: Mapping[str, Stream]) -> dict[str, Any]:
    """Return the motion of a vehicle without ground truth: the integral of the measured twist.

    The motion starts at the origin and is sampled at the stamps of the wheel speeds. The result
    contains arguments of `RunHistory.from_quaternions`, keyed by name.

    Raises:
        ValueError: the twist is never measured.
    """
    stream = streams.get(_ESTIMATE)
    messages = stream.messages if stream else ()
    twists = np.reshape([measured_twist(message.twist) for message in messages], (-1, 3))
    known = np.all(np.isfinite(twists), axis=1)
    if stream is None or not np.any(known):
        raise ValueError(
            f"neither /{_TRUTH} nor a measured /{_ESTIMATE} is recorded; sources of the twist: "
            "docs/which_sensor.md"
        )
    stamp_ns = streams[_WHEELS].stamp_ns
    time, measured_at = (1e-9 * (one - stamp_ns[0]) for one in (stamp_ns, stream.stamp_ns[known]))
    twist = np.column_stack([np.interp(time, measured_at, values) for values in twists[known].T])
    steps = 0.5 * (twist[1:] + twist[:-1]) * np.diff(time)[:, np.newaxis]
    yaw = np.concatenate(([0.0], np.cumsum(steps[:, 2])))
    moves = turned(steps[:, :2], yaw[:-1] + 0.5 * steps[:, 2])
    return {
        "stamp_ns": stamp_ns,
        "position": np.concatenate((np.zeros((1, 2)), np.cumsum(moves, axis=0))),
        "orientation": np.column_stack((np.sin(0.5 * yaw), np.cos(0.5 * yaw))),
        "twist": twist,
    }


def _assist_states(stamps: IntArray, stream: Stream | None, assistant: str) -> list[str]:
    """Return the state of the brake assistant at each control stamp.

    The state is an empty text before the first report.

    Args:
        stamps: control stamps [ns], shape (T,).
        stream: messages on `/diagnostics`; None if there are none.
        assistant: name of the assistant's status in these messages.
    """
    states = [""] * len(stamps)
    for stamp_ns, message in zip(stream.stamp_ns, stream.messages, strict=True) if stream else ():
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if status.name == assistant and "state" in values:
                first = int(np.searchsorted(stamps, stamp_ns, side="left"))
                states[first:] = [values["state"]] * (len(stamps) - first)
    return states


def values_of(message: Any, name: str, wheel_names: Sequence[str]) -> Any:
    """Return the values of an array of the history in a message; NaN if they are missing.

    Args:
        message: message of the topic in `SOURCES`, which must not be that of the ground truth.
        name: name of the array.
        wheel_names: names of the wheels in the order of the result.

    Raises:
        ValueError: the message lacks a wheel, or has another number of values.
    """
    signal = SOURCES[name][1]
    if signal.field == "twist.twist":
        return planar_twist(message.twist.twist)
    if signal.field == "twist.covariance":
        return message.twist.covariance[_VARIANCES]
    # A vehicle that does not measure wheel angles or brake torques leaves the field empty.
    if not len(values := getattr(message, signal.field)):
        return np.nan
    if signal.columns == topics.PER_WHEEL:
        return ordered(message, signal.field, wheel_names)
    return values if signal.columns else values[0]


def ordered(message: Any, field: str, wheel_names: Sequence[str]) -> FloatArray:
    """Return a field of a JointState with its N values in the order of `wheel_names`, shape (N,).

    Raises:
        ValueError: the message lacks a wheel or names it twice, or has another number of values.
    """
    values: FloatArray = getattr(message, field)
    if len(values) != len(message.name):
        raise ValueError(f"{len(values)} values of {field} for {len(message.name)} joints")
    if list(message.name) == list(wheel_names):
        return values
    if any(message.name.count(name) != 1 for name in wheel_names):
        raise ValueError(f"wheels {', '.join(message.name)} are not {', '.join(wheel_names)}")
    order = [message.name.index(name) for name in wheel_names]
    return values[order]


def planar_twist(twist: Any) -> tuple[float, float, float]:
    """Return ``(v_x, v_y, yaw rate)`` [m/s, m/s, rad/s] of a geometry_msgs Twist."""
    return twist.linear.x, twist.linear.y, twist.angular.z


def measured_twist(twist: Any) -> FloatArray:
    """Return ``(v_x, v_y, yaw rate)`` [m/s, m/s, rad/s] of a TwistWithCovariance, shape (3,).

    Components that were not measured are NaN; their variance is `UNMEASURED_VARIANCE` or more.
    """
    variance = np.asarray(twist.covariance)[_VARIANCES]
    return np.where(variance < UNMEASURED_VARIANCE, planar_twist(twist.twist), np.nan)
