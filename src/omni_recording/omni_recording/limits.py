"""Limits for reading recordings, which may be damaged or meant to exhaust the memory."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Limits:
    """Largest sizes and counts.

    Attributes:
        record: size of a record, and of a chunk when it is unpacked [B].
        description: size of all schemas and channels of a file together [B].
        definition: length of the definition of one type; the largest of ROS 2 have 20 KiB.
        chunks: number of chunks in an index.
        metadata: size of ``metadata.yaml`` [B].
        note: size of another file stored with the recording [B].
        qos: length of the quality of service of a channel.
        waiting: size of the messages that are held back to sort them by time [B].
        columns: number of columns of a table.
        label: length of a joint's name that becomes part of a column's name.
        topic: length of the name of an exported topic; a file name has at most 255 characters.
        topics: number of topics exported at once, each to an open file.
        rows: number of rows written to a table at once.
    """

    record: int = 1 << 28
    description: int = 1 << 26
    definition: int = 1 << 17
    chunks: int = 1 << 20
    metadata: int = 1 << 22
    note: int = 1 << 24
    qos: int = 1 << 16
    waiting: int = 1 << 27
    columns: int = 256
    label: int = 60
    topic: int = 200
    topics: int = 500
    rows: int = 4096


LIMITS = Limits()
