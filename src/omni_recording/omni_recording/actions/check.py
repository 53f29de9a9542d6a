"""Check of a recording, which reads every byte and decodes every message of a known type."""

import dataclasses
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

from omni_recording import clock, decode, folder, mcap
from omni_recording.error import McapError

_LOGS, _STAMPS = "log times", "stamps in the headers"  # kinds of time


@dataclasses.dataclass(frozen=True)
class BagCheck:
    """Results of the check of a recording.

    Attributes:
        counts: number of messages found, keyed by topic.
        problems: defects, one line each; empty for a valid recording.
        remarks: parts that could not be checked, and unusual properties that are not defects.
    """

    counts: Mapping[str, int]
    problems: tuple[str, ...]
    remarks: tuple[str, ...]


def check_bag(path: Path | str) -> BagCheck:
    """Read a recording from end to end; return its message counts, defects and remarks.

    Args:
        path: a rosbag2 folder or a single ``.mcap`` file.

    Raises:
        BagError: the recording cannot be read to its end; the message names place and reason.
    """
    bag = folder.open_bag(path)
    findings = _Findings()
    for file in bag.files:
        try:
            findings.read(file)
        except (McapError, OSError) as error:
            raise folder.file_problem(bag.path, file, error) from None
    findings.compare_metadata(bag)
    return findings.result()


class _Findings:
    def __init__(self) -> None:
        self._decoder = decode.MessageDecoder()
        self._counts: dict[str, int] = {}
        self._problems: list[str] = []
        self._remarks: list[str] = []
        self._undecoded: dict[str, tuple[int, str]] = {}
        # By topic and kind of time.
        self._clocks: defaultdict[tuple[str, str], clock.ClockWatch] = defaultdict(clock.ClockWatch)

    def read(self, file: Path) -> None:
        reader = mcap.McapMessages(file)
        counts: dict[str, int] = {}
        sequences: dict[int, _Sequence] = {}  # by id(channel); the reader keeps the channels alive
        for message in reader:
            topic = message.channel.topic
            counts[topic] = counts.get(topic, 0) + 1
            sequences.setdefault(id(message.channel), _Sequence(topic)).add(message.sequence)
            self._decode(message)
            self._clocks[topic, _LOGS].add(message.log_ns, message.log_ns)
        for sequence in sequences.values():
            if sequence.missing:
                self._problems.append(
                    f"{sequence.topic}: {sequence.missing} messages are missing by their numbers"
                )
        if reader.profile != "ros2":
            self._problems.append(
                f"{file.name} has the profile {reader.profile[:40]!r}, not that of ROS 2"
            )
        for channel in reader.channels:
            self._look_at(channel)
            counts.setdefault(channel.topic, 0)
        self._compare_summary(file, counts)
        for topic, count in counts.items():
            self._counts[topic] = self._counts.get(topic, 0) + count

    def compare_metadata(self, bag: folder.Bag) -> None:
        if bag.message_count is None:
            return
        total = sum(self._counts.values())
        if bag.message_count != total:
            self._problems.append(
                f"metadata.yaml lists {bag.message_count} messages, but {total} were found"
            )
        for topic in sorted({*bag.counts, *self._counts}):
            claimed, found = bag.counts.get(topic, 0), self._counts.get(topic, 0)
            if claimed != found:
                self._problems.append(
                    f"{topic}: metadata.yaml lists {claimed} messages, but {found} were found"
                )

    def result(self) -> BagCheck:
        for topic, (count, words) in self._undecoded.items():
            self._problems.append(f"{topic}: {count} messages cannot be decoded: {words}")
        for topic in self._counts:
            of_logs, of_stamps = self._clocks[topic, _LOGS], self._clocks[topic, _STAMPS]
            found = {
                jump.number: f"{topic}: {jump} by the {kind}: split the recording there"
                for kind, jumps in (
                    (_LOGS, (*of_logs.jumps, *of_stamps.log_jumps)),
                    (_STAMPS, of_stamps.jumps),
                )
                for jump in jumps
            }
            self._problems.extend(found.values())
            if unset := max(of_logs.unset, of_stamps.unset):
                self._problems.append(f"{topic}: {unset} messages have the time 0 after later ones")
        if not any(self._counts.values()):
            self._problems.append("the recording contains no messages")
        return BagCheck(self._counts, tuple(self._problems), tuple(self._remarks))

    def _look_at(self, channel: mcap.RecordedChannel) -> None:
        problem = self._decoder.problem(channel)
        if not problem:
            return
        line = f"{channel.topic}: {problem}"
        known = self._decoder.is_known(channel.type_name)
        found = self._problems if known else self._remarks
        if line not in found:
            found.append(line)

    def _decode(self, message: mcap.RecordedMessage) -> None:
        if self._decoder.problem(message.channel):
            return  # reported once per channel
        topic = message.channel.topic
        try:
            decoded = self._decoder.decode(message)
        except decode.DecodeError as error:
            count, words = self._undecoded.get(topic, (0, str(error)))
            self._undecoded[topic] = count + 1, words
            return
        stamp_ns = decode.header_stamp_ns(decoded)
        # Of several publishers, one that hung is late, not the clock.
        if stamp_ns is not None and topic not in clock.SHARED_TOPICS:
            self._clocks[topic, _STAMPS].add(stamp_ns, message.log_ns)

    def _compare_summary(self, file: Path, counts: Mapping[str, int]) -> None:
        summary = mcap.read_summary(file)
        if summary is None:
            self._remarks.append(f"{file.name} has no index; its recording ended early")
        elif {**dict.fromkeys(counts, 0), **summary.counts} != dict(counts):
            self._problems.append(f"{file.name} contains other messages than its summary lists")


class _Sequence:
    """Checks that the sequence numbers of a channel are consecutive."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._gaps = 0
        self._previous: int | None = None
        self._numbered = False

    @property
    def missing(self) -> int:
        """Number of missing sequence numbers; 0 if the recorder did not number the messages."""
        return self._gaps if self._numbered else 0

    def add(self, number: int) -> None:
        self._numbered = self._numbered or number != 0
        if self._previous is not None:
            # Numbers have 32 bits. A smaller number begins a new count and is not a gap.
            step = (number - self._previous) % 2**32
            if step < 2**31:
                self._gaps += max(step - 1, 0)
        self._previous = number
