"""Reader for the messages of MCAP files, including damaged ones, with bounded memory.

`mcap.stream_reader.StreamReader` limits the size of a record, but neither the size of an unpacked
chunk nor the lengths inside a record, which may point beyond the record's end. The reader of this
module compares every length with the available bytes before it reads anything, and passes only
complete records to the parsers of the library ``mcap``. The reader starts at the front without an
index, so it can also read an unfinished recording.
"""

from __future__ import annotations

import dataclasses
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from omni_core.quantities import SECOND_NS
from omni_recording.chunks import unpacked
from omni_recording.error import McapError
from omni_recording.limits import LIMITS

MAGIC = MCAP0_MAGIC

_HEAD = struct.Struct("<BQ")
_FOOTER_SIZE = _HEAD.size + 20 + len(MAGIC)
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHANNEL_SIZE = 2  # number of the channel, at the beginning of a message [B]
_INDEX_HEAD = struct.Struct("<HI")  # number of the channel, and total size of the entries [B]
_INDEX_ENTRY_SIZE = 16  # log time and place of a message [B]


def is_possible(time_ns: int) -> bool:
    """Return whether a ROS stamp, which has 31 bits for the seconds, can represent a time [ns]."""
    return time_ns >> 31 < SECOND_NS


@dataclasses.dataclass(frozen=True)
class RecordedChannel:
    """A channel of a file, which contains the messages of one publisher of a topic.

    Attributes:
        topic: name of the topic.
        type_name: message type, such as ``sensor_msgs/msg/Image``; empty without a schema.
        definition: text of the type's definition.
        definition_encoding: language of the definition, such as ``ros2msg``.
        encoding: encoding of the messages, such as ``cdr``.
        metadata: further entries that the recorder wrote, such as ``offered_qos_profiles``.
    """

    topic: str
    type_name: str
    definition: str
    definition_encoding: str
    encoding: str
    metadata: dict[str, str]


@dataclasses.dataclass(frozen=True)
class RecordedMessage:
    """A message as it was recorded.

    Attributes:
        channel: channel of the message.
        log_ns: time of recording [ns].
        publish_ns: time of publication [ns].
        sequence: number that the recorder assigned to the message.
        data: serialized message.
    """

    channel: RecordedChannel
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


@dataclasses.dataclass(frozen=True)
class McapSummary:
    """Summary at the end of an MCAP file.

    Attributes:
        channels: all channels of the file.
        counts: number of messages, keyed by topic.
        first_ns: earliest log time [ns]; 0 without messages.
        last_ns: latest log time [ns]; 0 without messages.
        chunks: number of chunks.
        compressions: compression methods of the chunks, sorted; an empty text for no compression.
    """

    channels: tuple[RecordedChannel, ...]
    counts: dict[str, int]
    first_ns: int
    last_ns: int
    chunks: int
    compressions: tuple[str, ...]


class McapMessages:
    """Reads the messages of one file in the order of the file.

    Args:
        path: a regular file.
        on_damage: function that is called with the problem of a chunk that cannot be unpacked, or
            of a complete record of a message; this chunk or message is omitted. None to raise the
            error instead.
        namespace: namespace that is removed from the topics.

    Attributes:
        profile: profile of the file, such as ``ros2``.
        compressions: compression methods of the chunks read so far.
        chunks: number of chunks read so far.
        lost: number of omitted messages, keyed by topic (an empty text if it is unknown); messages
            of an omitted chunk are counted if the file contains their index.
    """

    def __init__(
        self, path: Path, on_damage: Callable[[str], None] | None = None, namespace: str = ""
    ) -> None:
        self._path = path
        self._on_damage = on_damage
        self._tables = _Tables(namespace)
        self.profile = ""
        self.compressions: set[str] = set()
        self.chunks = 0
        self.lost: Counter[str] = Counter()
        self._seen: Counter[int] = Counter()  # messages of this chunk, by number of the channel
        self._damaged = False

    @property
    def channels(self) -> tuple[RecordedChannel, ...]:
        """All channels that have been found in the file so far."""
        return tuple(self._tables.channels.values())

    def __iter__(self) -> Iterator[RecordedMessage]:
        """Yield the messages up to the end of the data.

        Raises:
            McapError: the file is damaged or incomplete at the next message, or has another format.
            OSError: the file cannot be read.
        """
        with self._path.open("rb") as file:
            for opcode, content in _file_records(file):
                if opcode == Opcode.HEADER:
                    self.profile = _parsed(records.Header, content).profile
                elif opcode == Opcode.CHUNK:
                    self._damaged = False
                    self._seen.clear()
                    try:
                        yield from self._chunk(content)
                    except McapError as error:
                        self._damaged = True
                        self._omit(error)
                elif opcode == Opcode.MESSAGE:
                    yield from self._message(content)
                elif opcode == Opcode.MESSAGE_INDEX:
                    self._add_index(content)
                else:
                    self._tables.add(opcode, content)

    def _omit(self, error: McapError) -> None:
        if self._on_damage is None:
            raise error
        self._on_damage(error.problem)

    def _message(self, content: bytes) -> Iterator[RecordedMessage]:
        number = int.from_bytes(content[:_CHANNEL_SIZE], "little")
        self._seen[number] += 1
        try:
            message = self._tables.message(content)
        except McapError as error:
            # The record is complete, so the next record can be read.
            self._lose(number, 1)
            self._omit(error)
        else:
            yield message

    def _add_index(self, content: bytes) -> None:
        """Read how many messages of a channel the chunk before this index contains."""
        if len(content) < _INDEX_HEAD.size:
            return  # other readers skip the index, too
        number, size = _INDEX_HEAD.unpack_from(content)
        entries = min(size, len(content) - _INDEX_HEAD.size) // _INDEX_ENTRY_SIZE
        if self._damaged:
            self._lose(number, entries - self._seen[number])

    def _lose(self, number: int, count: int) -> None:
        channel = self._tables.channels.get(number)
        if count > 0:
            self.lost[channel.topic if channel else ""] += count

    def _chunk(self, content: bytes) -> Iterator[RecordedMessage]:
        chunk = _parsed(records.Chunk, content)
        self.compressions.add(chunk.compression)
        self.chunks += 1
        raw = unpacked(chunk)
        for opcode, part in _chunk_records(raw):
            if opcode == Opcode.MESSAGE:
                yield from self._message(part)
            else:
                self._tables.add(opcode, part)


def read_summary(path: Path, namespace: str = "") -> McapSummary | None:
    """Return the summary of a file without reading its messages; None if there is no summary.

    Args:
        path: a regular file.
        namespace: namespace that is removed from the topics.

    Raises:
        McapError: the file is damaged or incomplete, or has another format.
        OSError: the file cannot be read.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        _check_head(file)
        end = size - _FOOTER_SIZE
        file.seek(max(end, 0))
        tail = file.read(_FOOTER_SIZE)
        if end < len(MAGIC) or not tail.endswith(MAGIC):
            raise McapError("is truncated, its recording was not finished", recoverable=True)
        opcode, length = _HEAD.unpack_from(tail)
        if opcode != Opcode.FOOTER or length != _FOOTER_SIZE - _HEAD.size - len(MAGIC):
            raise McapError("is damaged: its footer is not at its end")
        start = _parsed(records.Footer, tail[_HEAD.size :]).summary_start
        if start == 0:
            return None
        if not len(MAGIC) <= start <= end:
            raise McapError(f"is damaged: its footer gives byte {start} of {size} for the summary")
        file.seek(start)
        return _summary(_framed(file, end, wanted=_SUMMARY_RECORDS), _Tables(namespace))


def _summary(entries: Iterator[tuple[int, bytes]], tables: _Tables) -> McapSummary | None:
    statistics: Any = None
    compressions: set[str] = set()
    chunks = 0
    for opcode, content in entries:
        if opcode == Opcode.STATISTICS:
            statistics = _parsed(records.Statistics, content)
        elif opcode == Opcode.CHUNK_INDEX:
            compressions.add(_parsed(records.ChunkIndex, content).compression)
            chunks += 1
        else:
            tables.add(opcode, content)
    if statistics is None:
        return None
    counts = {channel.topic: 0 for channel in tables.channels.values()}
    for number, count in statistics.channel_message_counts.items():
        if number not in tables.channels:
            raise McapError(f"is damaged: its summary counts messages of no channel ({number})")
        counts[tables.channels[number].topic] += count
    extent = statistics.message_start_time, statistics.message_end_time
    channels, words = tuple(tables.channels.values()), tuple(sorted(compressions))
    return McapSummary(channels, counts, *extent, chunks, words)


_DATA_RECORDS = frozenset(
    {
        *(Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL),
        *(Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX),
    }
)
_SUMMARY_RECORDS = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX})


class _Tables:
    """Schemas and channels of a file, keyed by their numbers."""

    def __init__(self, namespace: str) -> None:
        self._namespace = namespace
        self.channels: dict[int, RecordedChannel] = {}
        self._schemas: dict[int, Any] = {}
        self._size = 0

    def add(self, opcode: int, content: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = _parsed(records.Schema, content)
            self._store("schema", self._schemas, schema.id, schema, content)
        elif opcode == Opcode.CHANNEL:
            channel = _parsed(records.Channel, content)
            self._store("channel", self.channels, channel.id, self._make(channel), content)

    def message(self, content: bytes) -> RecordedMessage:
        if len(content) < _MESSAGE_HEAD.size:
            raise McapError("is damaged: a message is shorter than its header")
        number, sequence, log_ns, publish_ns = _MESSAGE_HEAD.unpack_from(content)
        channel = self.channels.get(number)
        if channel is None:
            raise McapError(f"is damaged: a message belongs to no channel ({number})")
        if not is_possible(max(log_ns, publish_ns)):
            problem = f"is damaged: a message of {channel.topic} has an impossible time"
            raise McapError(problem, recoverable=True)
        return RecordedMessage(channel, log_ns, publish_ns, sequence, content[_MESSAGE_HEAD.size :])

    def _make(self, channel: Any) -> RecordedChannel:
        schema = self._schemas.get(channel.schema_id)
        if schema is None and channel.schema_id != 0:
            raise McapError(f"is damaged: {channel.topic!r} has no schema ({channel.schema_id})")
        name, text, language = "", "", ""
        if schema is not None:
            name, language = schema.name, schema.encoding
            text = schema.data.decode(errors="replace")
        topic = channel.topic.removeprefix(self._namespace)
        return RecordedChannel(
            topic, name, text, language, channel.message_encoding, channel.metadata
        )

    def _store(
        self, kind: str, table: dict[int, Any], number: int, entry: Any, content: bytes
    ) -> None:
        if number in table:  # chunks repeat schemas and channels
            if table[number] != entry:
                raise McapError(f"is damaged: {kind} {number} is described in two ways")
            return
        table[number] = entry
        self._size += len(content)
        if self._size > LIMITS.description:
            raise McapError(f"describes its topics in more than {LIMITS.description} bytes")


def _check_head(file: IO[bytes]) -> None:
    head = file.read(len(MAGIC))
    if not head:
        raise McapError("is empty")
    if not MAGIC.startswith(head):
        raise McapError("is not an MCAP file")
    if head != MAGIC:
        raise McapError("is truncated within its first bytes", recoverable=True)


def _file_records(file: IO[bytes]) -> Iterator[tuple[int, bytes]]:
    """Yield the records of the data section, and check the end of the file."""
    size = file.seek(0, 2)
    file.seek(0)
    _check_head(file)
    yield from _framed(file, size, wanted=_DATA_RECORDS)
    if file.read(len(MAGIC)) != MAGIC or file.read(1):
        raise McapError("is truncated, its recording was not finished", recoverable=True)


def _framed(file: IO[bytes], size: int, wanted: frozenset[int]) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of the wanted records, up to the footer or to byte `size`.

    Args:
        file: the file, at the beginning of a record.
        size: size of the file [B].
        wanted: opcodes of the records to read; all others are skipped.
    """
    place = file.tell()
    while True:
        head = file.read(_HEAD.size) if place < size else b""
        if not head and wanted is _SUMMARY_RECORDS:
            return
        if len(head) < _HEAD.size:
            raise McapError("is truncated, its recording was not finished", recoverable=True)
        opcode, length = _HEAD.unpack(head)
        end = place + _HEAD.size + length
        if opcode == 0:
            raise McapError(f"is damaged: there is no record at byte {place}")
        if end > size:
            raise McapError(
                f"is cut off: {size - place} bytes are left of the {length} of a record",
                recoverable=True,
            )
        if opcode in wanted:
            if length > LIMITS.record:
                raise McapError(
                    f"has a record of {length} bytes, more than the limit of {LIMITS.record}"
                )
            yield opcode, file.read(length)
        else:
            file.seek(end)
        if opcode == Opcode.FOOTER:
            return
        place = end


def _chunk_records(raw: bytes) -> Iterator[tuple[int, bytes]]:
    place = 0
    while place < len(raw):
        if place + _HEAD.size > len(raw):
            raise McapError("is damaged: a chunk ends within a record")
        opcode, length = _HEAD.unpack_from(raw, place)
        start = place + _HEAD.size
        place = start + length
        if place > len(raw):
            raise McapError("is damaged: a record is longer than its chunk")
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            yield opcode, raw[start:place]


def _parsed(kind: Any, content: bytes) -> Any:
    """Parse one complete record with the library ``mcap``."""
    try:
        return kind.read(ReadDataStream(BytesIO(content)))
    except (EndOfFile, struct.error, OverflowError, ValueError) as error:
        raise McapError(
            f"is damaged: a {kind.__name__.lower()} record is invalid ({str(error) or 'too short'})"
        ) from None
