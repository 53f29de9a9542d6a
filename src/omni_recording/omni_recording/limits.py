"""Limits for reading recordings, which may be damaged or designed to exhaust the memory."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class RecordingLimits:
    """Limits on sizes and counts of the content of a recording; a length is a number of characters.

    Attributes:
        record: size of a record, and of an unpacked chunk [B].
        description: total size of all schemas and channels of a file [B].
        definition: length of the definition of a type; the longest definition in ROS 2 has 20 KiB.
        text: size of a YAML or JSON file of a recording, such as ``metadata.yaml`` [B].
        qos: length of the text that gives the quality of service of a channel.
        waiting: total size of the messages that are buffered to sort them by time [B].
        columns: number of columns of a table.
        label: length of a joint name that becomes part of a column name.
        topic: length of the name of an exported topic; a file name has at most 255 characters.
        topics: number of topics that are exported at once, each to an open file.
        rows: number of rows that are written to a table at once.
    """

    record: int = 1 << 28
    description: int = 1 << 26
    definition: int = 1 << 17
    text: int = 1 << 24
    qos: int = 1 << 16
    waiting: int = 1 << 27
    columns: int = 256
    label: int = 60
    topic: int = 200
    topics: int = 500
    rows: int = 4096


LIMITS = RecordingLimits()
