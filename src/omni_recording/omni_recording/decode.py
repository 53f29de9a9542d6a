"""Decoding of recorded bytes into messages of ROS 2 Jazzy types, without ROS.

The definitions come from this installation and never from the recording, because rosbags converts a
definition to Python code and runs it. A recording with a different definition of a type is
rejected, because its bytes would be decoded incorrectly.
"""

import functools
from collections.abc import Collection, Iterator
from typing import Any

from omni_core.quantities import SECOND_NS
from omni_recording.error import BagError
from omni_recording.folder import Bag, bag_messages, in_time_order
from omni_recording.limits import LIMITS
from omni_recording.mcap import RecordedChannel, RecordedMessage

_ENCODING = "cdr"

# Encapsulation of a message: two bytes for the format, here plain CDR, and two unused bytes.
_BIG_ENDIAN, _LITTLE_ENDIAN = b"\0\0", b"\0\1"
_ENCAPSULATION_SIZE = 4  # [B]
_UNIT = 4  # a serialized message is padded to a multiple of this size [B]


class DecodeError(ValueError):
    """A message or topic cannot be decoded; the text states the reason."""


class MessageDecoder:
    """Decodes messages of standard types."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._problems: dict[tuple[str, ...], str] = {}

    def problem(self, channel: RecordedChannel) -> str:
        """Return the reason why a channel's messages cannot be decoded; empty if they can."""
        kind = (channel.type_name, channel.encoding, channel.definition_encoding)
        key = (*kind, channel.definition)
        if key not in self._problems:
            self._problems[key] = self._find_problem(channel)
        return self._problems[key]

    def decode(self, message: RecordedMessage) -> Any:
        """Return a message as an object with the fields of its type.

        Bytes after the message are ignored, as in ROS: `rmw_serialize` returns a buffer of the
        estimated size, and the estimate contains the alignment of the elements of empty arrays.

        Raises:
            DecodeError: the bytes are not a message of the channel's type.
        """
        name = message.channel.type_name
        problem = self.problem(message.channel)
        if problem:
            raise DecodeError(problem)
        # The generated code may raise any exception on invalid bytes.
        try:
            return self._deserialized(message.data, name)
        except Exception as error:
            words = " ".join(str(error).split())[:200]
            raise DecodeError(f"its bytes are not a {name} ({words})") from None

    def _deserialized(self, data: bytes, name: str) -> Any:
        if data[:2] not in (_BIG_ENDIAN, _LITTLE_ENDIAN):
            raise ValueError("it does not begin as plain CDR")
        kind: Any = self._store.get_msgdef(name)
        little = data[:2] == _LITTLE_ENDIAN
        deserialize = kind.deserialize_cdr_le if little else kind.deserialize_cdr_be
        content = data[_ENCAPSULATION_SIZE:]
        message, size = deserialize(content, 0, kind.cls, self._store)
        # The length field of an empty array has 4 bytes, and aligning its elements takes at most 4
        # further bytes. So the estimated size is at most twice the size of the message.
        if len(content) >= 2 * size + _UNIT:
            raise ValueError(f"{len(content) - size} bytes follow a message of {size} bytes")
        return message

    def is_known(self, type_name: str) -> bool:
        """Return whether a type belongs to ROS 2 Jazzy."""
        return type_name in self._store.fielddefs

    def fields(self, type_name: str) -> Any:
        """Return the fields of a known message type in the form that rosbags uses."""
        return self._store.fielddefs[type_name][1]

    def _find_problem(self, channel: RecordedChannel) -> str:
        if channel.encoding != _ENCODING:
            return f"its messages are encoded as {channel.encoding[:40]!r}, not as {_ENCODING}"
        if not self.is_known(channel.type_name):
            return f"its type {channel.type_name[:80]!r} does not belong to ROS 2 Jazzy"
        if channel.definition_encoding != "ros2msg" or not channel.definition.strip():
            return ""  # without a definition, only decoding shows whether the type is right
        if len(channel.definition) > LIMITS.definition:
            return f"the definition of its type is too long ({len(channel.definition)} characters)"
        return self._difference(channel)

    def _difference(self, channel: RecordedChannel) -> str:
        from rosbags.typesys import get_types_from_msg

        try:
            found = get_types_from_msg(channel.definition, channel.type_name)
        except Exception:
            return f"the definition of its type {channel.type_name} is invalid"
        for name, (_, fields) in found.items():
            if not self.is_known(name) or fields != self.fields(name):
                return f"its definition of {name} differs from that of ROS 2 Jazzy"
        return ""


@functools.cache
def _decoder() -> MessageDecoder:
    """Return the decoder of this process; it checks each definition only once."""
    return MessageDecoder()


def decoded_messages(
    bag: Bag, topics: Collection[str], *, ordered: bool = False
) -> Iterator[tuple[RecordedMessage, Any]]:
    """Yield each message of the given topics, as recorded and as decoded.

    Args:
        bag: the recording.
        topics: names of the topics.
        ordered: whether to yield the messages in the order of their log times; otherwise they are
            in the order of the file.

    Raises:
        BagError: the recording or a message cannot be read.
    """
    decoder = _decoder()
    chosen = (m for m in bag_messages(bag) if m.channel.topic in topics)
    for recorded in in_time_order(chosen) if ordered else chosen:
        try:
            message = decoder.decode(recorded)
        except DecodeError as error:
            raise BagError(bag.path, f"{recorded.channel.topic}: {error}") from None
        yield recorded, message


def header_stamp_ns(message: Any) -> int | None:
    """Return the stamp [ns] in a decoded message's header; None if there is no header."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return None if stamp is None else int(stamp.sec) * SECOND_NS + int(stamp.nanosec)
