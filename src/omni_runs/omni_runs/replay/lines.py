"""Writing of camera lines to recordings, and reading of lines from recordings."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from omni_core import topics
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch, Lines
from omni_recording import decode, metadata, write
from omni_recording.definitions import find_message_definition
from omni_recording.error import BagError
from omni_recording.folder import Bag, bag_summary
from omni_ros.line_images import line_batch_of, line_image

DEPTH = 200
"""Queue depth of the publishers, as stored in the metadata of recorded lines and outputs."""


def write_lines(
    folder: Path,
    lines: Mapping[str, Lines],
    sensors: Mapping[str, LineSensor],
    batch_time: float,
    start_ns: int,
) -> dict[str, int]:
    """Write lines as a recording; return the number of messages of each camera.

    Args:
        folder: rosbag2 folder to be created.
        lines: lines of each camera, oldest first, shape (m, n).
        sensors: cameras, keyed by name; only the line rates are used.
        batch_time: time that the lines in one message span [s].
        start_ns: stamp of the first line [ns].

    Raises:
        RecordingError: the recording cannot be written.
    """
    messages: list[tuple[int, str, Lines]] = []
    for name, own in lines.items():
        rate = sensors[name].line_rate
        size = max(1, round(batch_time * rate))
        for first in range(0, len(own), size):
            part = own[first : first + size]
            newest = start_ns + round(1e9 * (first + len(part) - 1) / rate)
            messages.append((newest, name, part))
    messages.sort(key=lambda message: message[0])
    definition, qos = find_message_definition(topics.IMAGE), metadata.RecordedQos(DEPTH)
    recorded = [metadata.RecordedTopic(topics.lines(name).path, definition, qos) for name in lines]
    with write.Rosbag2Writer(folder, recorded, compression="zstd") as writer:
        for stamp_ns, name, part in messages:
            writer.write(topics.lines(name).path, stamp_ns, line_image(stamp_ns, name, part))
    return {name: sum(own == name for _, own, _ in messages) for name in lines}


def recorded_cameras(bag: Bag, sensors: Iterable[str]) -> list[str]:
    """Return the names of the cameras whose lines are in a recording."""
    counts = bag_summary(bag).counts
    return [name for name in sensors if counts.get(topics.lines(name).path)]


def read_batches(
    bag: Bag, sensors: Iterable[str], start: float = 0.0, duration: float = float("inf")
) -> dict[str, list[LineBatch]]:
    """Return the recorded batches of lines, oldest first, keyed by camera name.

    Args:
        bag: the recording.
        sensors: names of the cameras.
        start: start of the part to read, as time since the first line of any camera [s].
        duration: duration of the part to read [s].

    Raises:
        BagError: a message cannot be read, or a camera has no lines in this part.
    """
    names = {topics.lines(name).path: name for name in sensors}
    batches: dict[str, list[LineBatch]] = {name: [] for name in names.values()}
    begin: int | None = None
    for recorded, message in decode.decoded_messages(bag, names, ordered=True):
        batch = line_batch_of(message)
        begin = batch.stamp_ns if begin is None else begin
        elapsed = 1e-9 * (batch.stamp_ns - begin)
        if elapsed > start + duration:
            break
        if elapsed >= start:
            batches[names[recorded.channel.topic]].append(batch)
    silent = [
        topic for topic, name in names.items() if not any(len(b.lines) for b in batches[name])
    ]
    if silent:
        raise BagError(bag.path, f"contains no lines in this period on {', '.join(silent)}")
    return batches
