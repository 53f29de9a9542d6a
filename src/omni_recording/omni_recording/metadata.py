"""Metadata of a recording in the format of rosbag2 (version 9)."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from omni_recording.definitions import MessageDefinition

SERIALIZATION = "cdr"
VERSION = 9
UNSET_TIME = 2**63 - 1  # [ns] start time that rosbag2 writes if there are no messages


@dataclasses.dataclass(frozen=True)
class RecordedQos:
    """Quality of service that a topic's publisher offers, in rosbag2's terms."""

    depth: int
    history: str = "keep_last"
    reliability: str = "reliable"
    durability: str = "volatile"


@dataclasses.dataclass(frozen=True)
class RecordedTopic:
    """A topic of a recording: full name, type definition, and offered QoS."""

    name: str
    definition: MessageDefinition
    qos: RecordedQos


@dataclasses.dataclass(frozen=True)
class Extent:
    """Extent of a recording: number of messages of each topic, and first and last stamp [ns]."""

    counts: Mapping[str, int]
    first_ns: int = UNSET_TIME
    last_ns: int = 0

    def information(self) -> dict[str, Any]:
        """Return the extent as entries of rosbag2's metadata about a file or a whole recording."""
        return {
            "starting_time": {"nanoseconds_since_epoch": self.first_ns},
            "duration": {"nanoseconds": max(0, self.last_ns - self.first_ns)},
            "message_count": sum(self.counts.values()),
        }


def bag_information(
    file_name: str, topics: Sequence[RecordedTopic], extent: Extent
) -> dict[str, Any]:
    """Return the entry ``rosbag2_bagfile_information`` of a recording with a single file."""
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        **extent.information(),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.definition.type_name,
                    "serialization_format": SERIALIZATION,
                    "offered_qos_profiles": qos_information(topic.qos),
                    "type_description_hash": topic.definition.type_hash,
                },
                "message_count": extent.counts[topic.name],
            }
            for topic in topics
        ],
        # These two entries describe compressed files and messages; chunks are internal to MCAP.
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, **extent.information()}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def qos_information(qos: RecordedQos) -> list[dict[str, Any]]:
    """Return the QoS profile of a topic's only publisher, as a list in the format of rosbag2."""
    return [
        {
            "history": qos.history,
            "depth": qos.depth,
            "reliability": qos.reliability,
            "durability": qos.durability,
            "deadline": _forever(),
            "lifespan": _forever(),
            "liveliness": "automatic",
            "liveliness_lease_duration": _forever(),
            "avoid_ros_namespace_conventions": False,
        }
    ]


def _forever() -> dict[str, int]:
    # The largest signed 64-bit number of nanoseconds; a new dict each time, because YAML would
    # write aliases for a shared one.
    return {"sec": 9223372036, "nsec": 854775807}
