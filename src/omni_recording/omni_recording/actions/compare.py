"""Comparison of two recordings of the same topics, message by message."""

import dataclasses
import itertools
import math
import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from omni_recording import decode, folder, table
from omni_recording.actions.tolerances import TOLERANCES, Tolerance, Values, absolute
from omni_recording.error import BagError

# A number in a sentence; digits in a name, such as `wheel_1`, are part of the name.
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(\.\d+)?(e[-+]?\d+)?(?![\w.]*\w)")


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
        different_texts: number of message pairs that differ in a text (apart from the numbers in
            it), in the names or types of their plain values, or in a value that is NaN in only one
            of the messages.
        outside: number of message pairs with a value that differs by more than its tolerance.
        moved_switches: number of values that switch one message earlier or later in the second
            recording; these differences are not counted as `outside`.
        margin: largest share of a tolerance that a difference uses [1]; above 1, the tolerance is
            exceeded, and infinite if values differ whose tolerance is 0.
        difference: absolute difference that uses this share, in the unit of its value.
        worst: name of the value with this difference, and stamp of its messages [ns]; empty if all
            values agree.
    """

    topic: str
    first: int = 0
    second: int = 0
    identical: int = 0
    unpaired: int = 0
    different_texts: int = 0
    outside: int = 0
    moved_switches: int = 0
    margin: float = 0.0
    difference: float = 0.0
    worst: str = ""

    @property
    def agrees(self) -> bool:
        """Whether both recordings have the same messages within the tolerance, and at least one."""
        paired = not self.unpaired and not self.different_texts and self.first > 0
        return paired and self.margin <= 1.0


def compare_topics(
    first: Path | str, second: Path | str, topics: Collection[str], tolerance: float | None = None
) -> dict[str, TopicComparison]:
    """Return the comparison of each topic in two recordings, keyed by topic.

    Args:
        first: first recording; its values determine the tolerances.
        second: second recording.
        topics: topics to compare; their messages must have a header with a stamp.
        tolerance: limit on the difference of any value, in the unit of the value; None for the
            tolerances of the signals, `tolerances.TOLERANCES`.

    Raises:
        BagError: a recording or a message in it cannot be read.
    """
    given = None if tolerance is None else absolute(tolerance)
    return {
        topic: _compare(
            Path(first), Path(second), topic, given or TOLERANCES.get(topic, absolute(0.0))
        )
        for topic in topics
    }


class _Stamped(NamedTuple):
    """A message with its stamp [ns], its bytes and its plain values."""

    stamp_ns: int
    data: bytes
    cells: list[table.Cell]

    @property
    def values(self) -> Values:
        """Numbers of the message, keyed by name."""
        return {name: float(value) for name, _, value in self.cells if not isinstance(value, str)}

    @property
    def texts(self) -> list[tuple[str, str, str]]:
        """Names and kinds of all values, and the texts among the values without their numbers."""
        return [
            (name, kind, _NUMBER.sub("", value) if isinstance(value, str) else "")
            for name, kind, value in self.cells
        ]


_Pair = tuple[_Stamped | None, _Stamped | None]  # messages with the same stamp; None: missing
_NONE: _Pair = (None, None)


def _compare(first: Path, second: Path, topic: str, tolerance: Tolerance) -> TopicComparison:
    """Return the comparison of a topic in two recordings.

    The messages of both recordings are read side by side in the order of their stamps, so that only
    three messages of each recording are in memory.
    """
    decoder = decode.MessageDecoder()
    result = TopicComparison(topic)
    pairs = _pairs(_stamped(decoder, first, topic), _stamped(decoder, second, topic))
    copies = itertools.tee(itertools.chain((_NONE,), pairs, (_NONE,)), 3)
    shifted = (itertools.islice(copy, start, None) for start, copy in enumerate(copies))
    for before, (one, other), after in zip(*shifted, strict=False):
        result.first += one is not None
        result.second += other is not None
        if one is None or other is None:
            result.unpaired += 1
        else:
            _compare_pair(result, tolerance, one, other, (before, after))
    return result


def _stamped(decoder: decode.MessageDecoder, path: Path, topic: str) -> Iterator[_Stamped]:
    """Yield the messages of a topic."""
    for message, decoded in decode.decoded_messages(folder.open_vehicle(path), (topic,)):
        try:
            cells = table.flatten(decoder, message.channel.type_name, decoded)
        except table.TooWideError as error:
            raise BagError(path, f"{topic}: {error}") from None
        stamp_ns = decode.header_stamp_ns(decoded)
        if stamp_ns is None:
            raise BagError(path, f"{topic} has no stamp")
        yield _Stamped(stamp_ns, message.data, cells)


def _pairs(first: Iterator[_Stamped], second: Iterator[_Stamped]) -> Iterator[_Pair]:
    """Yield the messages of two recordings in the order of their stamps."""
    one, other = next(first, None), next(second, None)
    while one is not None or other is not None:
        use_one = other is None or (one is not None and one.stamp_ns <= other.stamp_ns)
        use_other = one is None or (other is not None and other.stamp_ns <= one.stamp_ns)
        yield one if use_one else None, other if use_other else None
        if use_one:
            one = next(first, None)
        if use_other:
            other = next(second, None)


def _compare_pair(
    result: TopicComparison,
    tolerance: Tolerance,
    one: _Stamped,
    other: _Stamped,
    neighbors: tuple[_Pair, _Pair],
) -> None:
    """Compare two messages with the same stamp, and add the differences to `result`."""
    if one.data == other.data:
        result.identical += 1
        return
    if one.texts != other.texts:
        result.different_texts += 1
        return
    limits, values, outside = tolerance.limits(one.values), other.values, False
    for name, left in one.values.items():
        right = values[name]
        if left == right or (math.isnan(left) and math.isnan(right)):  # equal infinities too
            continue
        difference, limit = abs(left - right), limits.get(name, 0.0)
        if math.isnan(difference):  # exactly one value is NaN
            result.different_texts += 1
            return
        share = difference / limit if limit > 0.0 else math.inf
        if share > 1.0 and tolerance.moved_switches and _moved(name, limit, left, right, neighbors):
            result.moved_switches += 1
            share = result.moved_switches / tolerance.moved_switches
        else:
            outside |= share > 1.0
        if share > result.margin:
            result.margin, result.difference = share, difference
            result.worst = f"{name} at {one.stamp_ns} ns"
    result.outside += outside


def _moved(
    name: str, limit: float, left: float, right: float, neighbors: tuple[_Pair, _Pair]
) -> bool:
    """Return whether a value switches at this message in one recording, at the next in the other.

    Args:
        name: name of the value.
        limit: largest difference between values that count as equal.
        left: value in the first recording.
        right: value in the second recording.
        neighbors: pairs of messages before and after this one.
    """

    def near(one: float, other: float) -> bool:
        return abs(one - other) <= limit  # False for NaN

    (old, old_too), (new, new_too) = (
        [message.values.get(name, math.nan) if message else math.nan for message in pair]
        for pair in neighbors
    )
    switches = near(old, old_too) and near(new, new_too) and not near(old, new)
    return switches and (
        (near(left, old) and near(right, new)) or (near(left, new) and near(right, old))
    )
