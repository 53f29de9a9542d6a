"""Comparison of two recordings of the same topics, message by message."""

import dataclasses
import math
from collections.abc import Collection, Iterator
from pathlib import Path

from omni_recording import decode, folder, mcap, table
from omni_recording.error import BagError


@dataclasses.dataclass
class TopicComparison:
    """Differences between the messages of a topic in two recordings.

    Messages with equal stamps form a pair, which is compared.

    Attributes:
        topic: name of the topic.
        first: number of messages in the first recording.
        second: number of messages in the second recording.
        identical: number of message pairs with the same bytes.
        unpaired: number of messages whose stamp does not occur in the other recording.
        different_texts: number of message pairs that differ in a text, in the names or types of
            their plain values, or in a value that is NaN in only one of the messages.
        largest_difference: largest absolute difference between two values, in the unit of their
            field.
        worst: name of the value with the largest difference, and stamp of its messages [ns]; empty
            if all values agree.
    """

    topic: str
    first: int = 0
    second: int = 0
    identical: int = 0
    unpaired: int = 0
    different_texts: int = 0
    largest_difference: float = 0.0
    worst: str = ""

    def agrees(self, tolerance: float) -> bool:
        """Return whether both recordings have the same messages in this topic, and at least one.

        Numbers may differ by up to `tolerance`; stamps and texts must be equal.

        Args:
            tolerance: limit on the absolute difference, in the unit of the values.
        """
        paired = not self.unpaired and not self.different_texts and self.first > 0
        return paired and self.largest_difference <= tolerance


def compare_topics(
    first: Path | str, second: Path | str, topics: Collection[str]
) -> dict[str, TopicComparison]:
    """Return the comparison of each topic in two recordings, keyed by topic.

    Args:
        first: first recording.
        second: second recording.
        topics: topics to compare; their messages must have a header with a stamp.

    Raises:
        BagError: a recording or a message in it cannot be read.
    """
    return {topic: _compare(Path(first), Path(second), topic) for topic in topics}


def _compare(first: Path, second: Path, topic: str) -> TopicComparison:
    """Return the comparison of a topic in two recordings.

    The messages of both recordings are read side by side in the order of their stamps, so that only
    one message of each recording is in memory.
    """
    decoder = decode.MessageDecoder()
    result = TopicComparison(topic)
    streams = _stamped(decoder, first, topic), _stamped(decoder, second, topic)
    one, other = next(streams[0], None), next(streams[1], None)
    while one is not None or other is not None:
        if one is not None and other is not None and one[0] == other[0]:
            _compare_pair(result, one, other)
        use_one = other is None or (one is not None and one[0] <= other[0])
        use_other = one is None or (other is not None and other[0] <= one[0])
        result.unpaired += use_one != use_other
        result.first += use_one
        result.second += use_other
        if use_one:
            one = next(streams[0], None)
        if use_other:
            other = next(streams[1], None)
    return result


_Stamped = tuple[int, mcap.RecordedMessage, list[table.Cell]]


def _stamped(decoder: decode.MessageDecoder, path: Path, topic: str) -> Iterator[_Stamped]:
    """Yield stamp [ns], raw message and flattened values of each message of a topic."""
    for message, decoded in decode.decoded_messages(folder.open_vehicle(path), (topic,)):
        try:
            cells = table.flatten(decoder, message.channel.type_name, decoded)
        except table.TooWideError as error:
            raise BagError(path, f"{topic}: {error}") from None
        stamp_ns = decode.header_stamp_ns(decoded)
        if stamp_ns is None:
            raise BagError(path, f"{topic} has no stamp")
        yield stamp_ns, message, cells


def _compare_pair(result: TopicComparison, one: _Stamped, other: _Stamped) -> None:
    """Compare two messages with the same stamp, and add the differences to `result`."""
    if one[1].data == other[1].data:
        result.identical += 1
        return
    if [cell[:2] for cell in one[2]] != [cell[:2] for cell in other[2]]:
        result.different_texts += 1
        return
    for (name, _, left), (_, _, right) in zip(one[2], other[2], strict=True):
        if isinstance(left, str) or isinstance(right, str):
            different = left != right
        else:
            values = float(left), float(right)
            same = values[0] == values[1] or all(map(math.isnan, values))  # equal infinities too
            difference = 0.0 if same else abs(values[0] - values[1])
            different = math.isnan(difference)  # exactly one value is NaN
            if difference > result.largest_difference:
                result.largest_difference = difference
                result.worst = f"{name} at {one[0]} ns"
        if different:
            result.different_texts += 1
            return
