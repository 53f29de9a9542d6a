"""Recordings with known content, and records of MCAP files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Footer, Header, Message, Schema
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from omni_recording.mcap import MAGIC

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINTS, IMAGE = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image"
STEPS = 40
FRONT, REAR = "front", 'rear, "left"'


def header(stamp_ns: int) -> Any:
    stamp = STORE.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    return STORE.types["std_msgs/msg/Header"](stamp, "base_link")


def joints(k: int) -> bytes:
    speeds = np.array([k / 3.0, -1e-300 * k])
    nothing = np.zeros(0)
    message = STORE.types[JOINTS](header(k * 10**7), [FRONT, REAR], nothing, speeds, nothing)
    return bytes(STORE.serialize_cdr(message, JOINTS))


def image(k: int) -> bytes:
    pixels = np.full(5000, k, dtype=np.uint8)
    message = STORE.types[IMAGE](header(k * 10**7), 5, 1000, "mono8", 0, 1000, pixels)
    return bytes(STORE.serialize_cdr(message, IMAGE))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    folder = tmp_path / "bag"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        wheels = writer.add_connection("/wheel_states", JOINTS, typestore=STORE)
        lines = writer.add_connection("/line_scan/front/lines", IMAGE, typestore=STORE)
        for k in range(STEPS):
            writer.write(wheels, k * 10**7, joints(k))
            writer.write(lines, k * 10**7, image(k))
    return folder


def record(entry: Any) -> bytes:
    builder = RecordBuilder()
    entry.write(builder)
    return bytes(builder.end())


def mcap(path: Path, *records: bytes, end: bool = True) -> Path:
    """Write an MCAP file of these records, without an index."""
    tail = record(Footer(0, 0, 0)) + MAGIC if end else b""
    path.write_bytes(MAGIC + record(Header("ros2", "test")) + b"".join(records) + tail)
    return path


def described(topic: str = "/wheel_states", kind: str = JOINTS, text: str = "") -> bytes:
    schema = Schema(id=1, name=kind, encoding="ros2msg" if text else "", data=text.encode())
    channel = Channel(id=1, topic=topic, message_encoding="cdr", metadata={}, schema_id=1)
    return record(schema) + record(channel)


def message(data: bytes, channel: int = 1, log_time: int = 0) -> bytes:
    return record(
        Message(channel_id=channel, log_time=log_time, data=data, publish_time=0, sequence=0)
    )
