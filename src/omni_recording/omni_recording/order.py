"""Recorded messages in the order in which a replay hands them out."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator

from omni_recording.mcap import RecordedMessage

_WINDOW_NS = 1_000_000_000  # [ns] by which a message may lie too late in the file
_MOST_WAITING = 1 << 27  # [B] of messages held back at a time


def in_time_order(messages: Iterable[RecordedMessage]) -> Iterator[RecordedMessage]:
    """Return messages by their log time, those of one time in the order of the file.

    A recorder writes what arrives, and topics overtake each other. Messages are held back for a
    second of recorded time, or until 128 MiB of them wait.
    """
    waiting: list[tuple[int, int, RecordedMessage]] = []
    size, newest_ns = 0, 0
    for number, message in enumerate(messages):
        heapq.heappush(waiting, (message.log_ns, number, message))
        size += len(message.data)
        newest_ns = max(newest_ns, message.log_ns)
        while waiting[0][0] < newest_ns - _WINDOW_NS or size > _MOST_WAITING:
            _, _, oldest = heapq.heappop(waiting)
            size -= len(oldest.data)
            yield oldest
            if not waiting:
                break
    while waiting:
        yield heapq.heappop(waiting)[2]


def in_rounds(messages: Iterable[RecordedMessage]) -> Iterator[list[RecordedMessage]]:
    """Group messages so that each topic speaks at most once in a round.

    Where topics are sampled together, a round is one sample of each.
    """
    group: dict[str, RecordedMessage] = {}
    for message in messages:
        if message.channel.topic in group:
            yield list(group.values())
            group = {}
        group[message.channel.topic] = message
    if group:
        yield list(group.values())
