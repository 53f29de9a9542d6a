"""Recovery of the complete messages of an unfinished or partly damaged recording.

The original recording is never changed: its complete messages are copied to a new folder, with the
index and the metadata that readers require.
"""

import contextlib
import dataclasses
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from omni_recording import definitions, mcap, write
from omni_recording import folder as bags
from omni_recording.error import BagError, McapError
from omni_recording.limits import LIMITS
from omni_recording.metadata import RecordedQos, RecordedTopic


@dataclasses.dataclass(frozen=True)
class Recovery:
    """Result of a recovery.

    Attributes:
        folder: folder of the new recording.
        counts: number of recovered messages, keyed by topic.
        lost: number of messages that were not recovered, keyed by topic; an empty text stands for
            unknown topics. Messages that neither the metadata nor an index counts are missing.
        first_ns: earliest recovered log time [ns].
        last_ns: latest recovered log time [ns].
        problems: defects of the original recording, file by file; empty if there are none.
    """

    folder: Path
    counts: Mapping[str, int]
    lost: Mapping[str, int]
    first_ns: int
    last_ns: int
    problems: tuple[str, ...]


def recover(path: Path, folder: Path) -> Recovery | None:
    """Copy every complete message of a recording into a new one.

    A chunk that cannot be unpacked is omitted, and so is a message with an invalid field, and the
    rest of a file after any other invalid record. A file that cannot be opened, such as a broken
    link, is also omitted.

    Args:
        path: a rosbag2 folder, with or without metadata, or a single ``.mcap`` file.
        folder: folder of the new recording; must be empty if it exists.

    Returns:
        The result; None if the recording is undamaged, in which case nothing is written.

    Raises:
        BagError: the recording contains no complete message.
        RecordingError: the new recording cannot be written.
    """
    problems: list[str] = []
    channels: list[mcap.RecordedChannel] = []
    files = bags.bag_files(path, problems)
    bag: bags.Bag | None = None
    try:
        bag = bags.open_bag(path)
    except BagError as error:
        if (path / bags.METADATA).exists():  # metadata may be missing
            problems.append(error.problem)
    # The topics must be known before the first message is written, so the recording is read twice.
    count, first_ns, last_ns = 0, 1 << 63, 0
    lost: Counter[str] = Counter()
    for message in _whole_messages(files, problems, channels, lost):
        count += 1
        first_ns, last_ns = min(first_ns, message.log_ns), max(last_ns, message.log_ns)
    if not problems and bag is not None and bag.message_count in (None, count):
        return None
    if not count:
        words = "; ".join(problems) or "the files are empty"
        raise BagError(path, f"contains no complete message: {words}")
    with write.Rosbag2Writer(folder, _topics(path, channels)) as writer:
        for message in _whole_messages(files, [], [], Counter()):
            writer.write(message.channel.topic, message.log_ns, message.data, message.publish_ns)
    if path.is_dir():
        _copy_notes(path, folder)
    for topic, claimed in _claimed_counts(path, bag).items():
        lost[topic] = max(lost[topic], claimed - writer.counts.get(topic, 0))
    return Recovery(folder, writer.counts, +lost, first_ns, last_ns, tuple(problems))


def _topics(path: Path, channels: Iterable[mcap.RecordedChannel]) -> list[RecordedTopic]:
    by_topic: dict[str, mcap.RecordedChannel] = {}
    for channel in channels:
        known = by_topic.setdefault(channel.topic, channel)
        if known.type_name != channel.type_name:
            kinds = f"{known.type_name} and {channel.type_name}"
            raise BagError(path, f"{channel.topic} is of two types, {kinds}")
    return [_topic(path, channel) for channel in by_topic.values()]


def _whole_messages(
    files: tuple[Path, ...],
    problems: list[str],
    channels: list[mcap.RecordedChannel],
    lost: Counter[str],
) -> Iterator[mcap.RecordedMessage]:
    """Yield the readable messages of every file.

    Args:
        files: MCAP files of the recording.
        problems: list to which the defects of the files are added.
        channels: list to which the channels of a file are added after its messages are yielded.
        lost: count of omitted messages, keyed by topic, to which those of a file are added.
    """
    for file in files:
        times: Counter[str] = Counter()

        def note(problem: str, times: Counter[str] = times) -> None:
            times[problem] += 1

        reader = mcap.McapMessages(file, on_damage=note)
        try:
            yield from reader
        except McapError as error:
            note(error.problem)
        except OSError as error:
            note(f"cannot be read: {error.strerror or error}")
        for problem, count in times.items():
            problems.append(f"{file.name} {problem}" + (f", {count} times" if count > 1 else ""))
        channels.extend(reader.channels)
        lost += reader.lost


def _claimed_counts(path: Path, bag: bags.Bag | None) -> Mapping[str, int]:
    """Return the message counts of the metadata or of the index; empty without any."""
    with contextlib.suppress(BagError):  # a file is damaged, or the metadata is missing
        if bag is None:
            return bags.claimed_counts(path)
        return bag.counts or bags.bag_summary(bag).counts
    return {}


def _topic(path: Path, channel: mcap.RecordedChannel) -> RecordedTopic:
    if (channel.encoding, channel.definition_encoding) != ("cdr", "ros2msg"):
        raise BagError(path, f"{channel.topic} is not recorded as CDR with a ros2msg definition")
    definition = definitions.MessageDefinition(
        channel.type_name,
        channel.definition,
        channel.metadata.get("topic_type_hash", ""),
        stamped=False,  # log times are copied, not read from the messages
    )
    return RecordedTopic(channel.topic, definition, _qos(channel.metadata))


def _qos(metadata: Mapping[str, str]) -> RecordedQos:
    """Return the quality of service that the publisher of a channel offered.

    Args:
        metadata: metadata of the channel; without a valid QoS, rosbag2's default is returned.
    """
    text = metadata.get("offered_qos_profiles", "")
    try:
        profile = bags.read_plain_yaml(text)[0] if len(text) <= LIMITS.qos else {}
        return RecordedQos(
            depth=int(profile["depth"]),
            history=_word(profile["history"]),
            reliability=_word(profile["reliability"]),
            durability=_word(profile["durability"]),
        )
    except (ValueError, TypeError, KeyError, IndexError):
        return RecordedQos(10)


def _word(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError("older recordings have numbers")
    return value


def _copy_notes(path: Path, folder: Path) -> None:
    """Copy the YAML and JSON files next to a recording, such as the configuration of its run.

    Args:
        path: folder of the recording.
        folder: folder of the new recording.
    """
    for file in sorted(path.iterdir()):
        try:
            regular = file.is_file() and file.stat().st_size <= LIMITS.text
        except OSError:  # a circular link
            continue
        if regular and file.suffix in (".yaml", ".json") and file.name != bags.METADATA:
            try:
                shutil.copyfile(file, folder / file.name)
            except OSError as error:
                raise write.RecordingError(
                    f"cannot copy {file.name} to {folder}: {error.strerror}"
                ) from None
