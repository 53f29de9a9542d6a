"""The recording is a valid rosbag2 folder, and stays readable after any failure."""

from __future__ import annotations

import contextlib
import io
import os
import resource
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import CRCValidationError, StreamReader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import (
    ConnectionExtRosbag2,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.rosbag2 import Writer as ReferenceWriter
from rosbags.typesys import Stores, get_typestore

from omni_recording.definitions import find_message_definition
from omni_recording.metadata import RecordedQos, RecordedTopic
from omni_recording.write import COMPRESSIONS, RecordingError, Rosbag2Writer

LINES = RecordedTopic(
    "/line_scan/front/lines", find_message_definition("sensor_msgs/msg/Image"), RecordedQos(200)
)
INFO = RecordedTopic(
    "/line_scan/front/camera_info",
    find_message_definition("sensor_msgs/msg/CameraInfo"),
    RecordedQos(1, durability="transient_local"),
)
CLOCK = RecordedTopic(
    "/clock", find_message_definition("rosgraph_msgs/msg/Clock"), RecordedQos(200)
)
TOPICS = (LINES, INFO, CLOCK)

Records = list[tuple[str, int, bytes]]


def some_messages(count: int, size: int = 500) -> Records:
    """Return (topic, stamp, payload) with random bytes, which the writer does not interpret."""
    rng = np.random.default_rng(7)
    names = [topic.name for topic in TOPICS]
    return [
        (names[k % 3], 10_000_000 * k, rng.bytes(int(rng.integers(0, size)))) for k in range(count)
    ]


def write_all(writer: Rosbag2Writer, messages: Records) -> None:
    for topic, stamp_ns, data in messages:
        writer.write(topic, stamp_ns, data)


def read_strictly(folder: Path) -> Records:
    with AnyReader([folder]) as reader:
        return [(link.topic, stamp, bytes(data)) for link, stamp, data in reader.messages()]


def read_stream(data: bytes) -> tuple[Records, bool]:
    """Read a recording after a hard stop; also return whether the file is complete."""
    topics: dict[int, str] = {}
    messages: Records = []
    try:
        for record in StreamReader(io.BytesIO(data), validate_crcs=True).records:
            if isinstance(record, Message):
                messages.append((topics[record.channel_id], record.log_time, record.data))
            elif hasattr(record, "topic"):
                topics[record.id] = record.topic
    except (EndOfFile, CRCValidationError, struct.error):  # depends on the position of the cut
        return messages, False
    return messages, True


def mcap_file(folder: Path) -> Path:
    return folder / f"{folder.name}_0.mcap"


def offered(reader: Reader) -> dict[str, list[Qos]]:
    return {
        link.topic: link.ext.offered_qos_profiles
        for link in reader.connections
        if isinstance(link.ext, ConnectionExtRosbag2)
    }


def information(folder: Path) -> dict[str, Any]:
    document = yaml.safe_load((folder / "metadata.yaml").read_text(encoding="utf-8"))
    return dict(document["rosbag2_bagfile_information"])


@contextlib.contextmanager
def files_limited_to(size: int) -> Iterator[None]:
    """Make every write beyond a file size [B] fail, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextlib.contextmanager
def without_privileges() -> Iterator[None]:
    """Change to an unprivileged user if the tests run as root, who may write anywhere."""
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(user)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_strict_readers_get_back_every_byte(tmp_path: Path, compression: str) -> None:
    folder = tmp_path / "run"
    messages = some_messages(300)
    writer = Rosbag2Writer(folder, TOPICS, chunk_size=4096, compression=compression)
    write_all(writer, messages)
    writer.close()

    assert read_strictly(folder) == messages
    with mcap_file(folder).open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
        assert found == messages
        assert reader.get_header().profile == "ros2"


def test_the_metadata_are_those_of_an_independent_writer(tmp_path: Path) -> None:
    messages = some_messages(30)
    writer = Rosbag2Writer(tmp_path / "run", TOPICS)
    write_all(writer, messages)
    writer.close()

    forever = QosTime(9223372036, 854775807)
    reference = ReferenceWriter(tmp_path / "other", version=9, storage_plugin=StoragePlugin.MCAP)
    with reference:
        links = {
            topic.name: reference.add_connection(
                topic.name,
                topic.definition.type_name,
                msgdef=topic.definition.text,
                rihs01=topic.definition.type_hash,
                offered_qos_profiles=[
                    Qos(
                        QosHistory.KEEP_LAST,
                        topic.qos.depth,
                        QosReliability.RELIABLE,
                        QosDurability[topic.qos.durability.upper()],
                        forever,
                        forever,
                        QosLiveliness.AUTOMATIC,
                        forever,
                        False,
                    )
                ],
            )
            for topic in TOPICS
        }
        for topic, stamp_ns, data in messages:
            reference.write(links[topic], stamp_ns, data)

    expected = information(tmp_path / "other")
    expected["relative_file_paths"] = ["run_0.mcap"]
    expected["files"][0]["path"] = "run_0.mcap"
    expected["ros_distro"] = "jazzy"
    assert information(tmp_path / "run") == expected


def test_the_file_alone_explains_itself(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](3, 4), "front")
    pixels = np.arange(12, dtype=np.uint8)
    image = types["sensor_msgs/msg/Image"](header, 3, 4, "mono8", 0, 4, pixels)
    writer = Rosbag2Writer(folder, TOPICS)
    writer.write(
        LINES.name, 3_000_000_004, bytes(store.serialize_cdr(image, "sensor_msgs/msg/Image"))
    )
    writer.close()

    with AnyReader([folder]) as reader:
        link, _, data = next(reader.messages())
        # Without a default store the reader has only the types that the file describes.
        decoded: Any = reader.deserialize(data, link.msgtype)
    assert (decoded.header.stamp.sec, decoded.header.frame_id) == (3, "front")
    assert (decoded.height, decoded.encoding, decoded.data.tolist()) == (3, "mono8", [*range(12)])

    with mcap_file(folder).open("rb") as file:
        summary = make_reader(file).get_summary()
    for channel in summary.channels.values():
        topic = next(topic for topic in TOPICS if topic.name == channel.topic)
        schema = summary.schemas[channel.schema_id]
        assert (schema.name, schema.encoding) == (topic.definition.type_name, "ros2msg")
        assert channel.message_encoding == "cdr"
        assert channel.metadata["topic_type_hash"] == store.hash_rihs01(schema.name)


def test_quality_of_service_is_read_the_same_from_both_files(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    Rosbag2Writer(folder, TOPICS).close()
    with Reader(folder) as beside, Reader(mcap_file(folder)) as inside:
        profiles = offered(beside)
        assert offered(inside) == profiles
    (latched,) = profiles[INFO.name]
    assert (latched.durability, latched.depth) == (QosDurability.TRANSIENT_LOCAL, 1)
    (lines,) = profiles[LINES.name]
    assert (lines.durability, lines.reliability) == (
        QosDurability.VOLATILE,
        QosReliability.RELIABLE,
    )


def test_a_recording_without_messages_is_readable(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    Rosbag2Writer(folder, TOPICS).close()
    assert read_strictly(folder) == []
    with Reader(folder) as reader:
        assert {link.topic for link in reader.connections} == {topic.name for topic in TOPICS}


def test_both_files_exist_before_the_first_message(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    writer = Rosbag2Writer(folder, TOPICS)
    begun = information(folder)
    assert begun["message_count"] == 0
    assert begun["relative_file_paths"] == [mcap_file(folder).name]
    assert mcap_file(folder).stat().st_size > 0
    writer.close()


def test_a_cut_anywhere_leaves_every_whole_chunk(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    messages = some_messages(200)
    writer = Rosbag2Writer(folder, TOPICS, chunk_size=4096)
    write_all(writer, messages)
    writer.flush()
    data = mcap_file(folder).read_bytes()  # as a killed process leaves it
    assert read_stream(data) == (messages, False)

    sizes = [0]  # bytes, and the messages in them, up to the end of each chunk
    ends = [0]
    stream = io.BytesIO(data)
    with contextlib.suppress(EndOfFile):
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                sizes.append(stream.tell())
                ends.append(len(read_stream(data[: stream.tell()])[0]))
    assert len(set(ends)) == len(ends) > 5
    assert ends[-1] == len(messages)
    for cut in range(100, sizes[-1], 97):
        whole = max(end for end, size in zip(ends, sizes, strict=True) if size <= cut)
        assert read_stream(data[:cut]) == (messages[:whole], False)
    writer.close()


def test_flush_hands_over_everything_written(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    messages = some_messages(20)
    writer = Rosbag2Writer(folder, TOPICS, synchronize=True)
    for number in range(20):
        write_all(writer, messages[number : number + 1])
        writer.flush()
        assert read_stream(mcap_file(folder).read_bytes())[0] == messages[: number + 1]
    assert sum(writer.counts.values()) == 20
    writer.close()


def test_every_flush_waits_for_the_disk_on_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_disk: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda file: on_disk.append(os.fstat(file).st_size))
    for synchronize in (False, True):
        writer = Rosbag2Writer(tmp_path / f"run{synchronize}", TOPICS, synchronize=synchronize)
        on_disk.clear()
        write_all(writer, some_messages(5))
        writer.flush()
        size = mcap_file(tmp_path / f"run{synchronize}").stat().st_size
        assert on_disk == ([size] if synchronize else [])
        writer.close()


def test_an_existing_recording_is_never_touched(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    Rosbag2Writer(folder, TOPICS).close()
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(RecordingError, match="is not empty"):
        Rosbag2Writer(folder, TOPICS)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_an_empty_folder_is_used(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    Rosbag2Writer(folder, TOPICS).close()
    assert read_strictly(folder) == []


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(RecordingError, match=r"cannot record to .*/file/run: Not a directory"):
        Rosbag2Writer(tmp_path / "file" / "run", TOPICS)


def test_a_read_only_folder_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with without_privileges(), pytest.raises(RecordingError, match="Permission denied"):
        Rosbag2Writer(tmp_path / "run", TOPICS)


@pytest.mark.parametrize("room", [50_000, *range(51_000, 51_040, 3)])
def test_a_full_disk_leaves_a_readable_recording(room: int, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    messages = some_messages(400)
    writer = Rosbag2Writer(folder, TOPICS, chunk_size=4096)
    with files_limited_to(room):
        with pytest.raises(RecordingError, match="cannot record to"):
            write_all(writer, messages)
        with pytest.raises(RecordingError, match="cannot record to"):
            writer.write(*messages[0])
    writer.close()  # has already been closed

    kept = read_strictly(folder)
    assert kept == messages[: len(kept)]
    assert room - 3 * 4096 < mcap_file(folder).stat().st_size <= room
    assert sum(writer.counts.values()) == len(kept) == information(folder)["message_count"]
    with mcap_file(folder).open("rb") as file:
        found = [message.data for _, _, message in make_reader(file).iter_messages()]
    assert found == [data for _, _, data in kept]


def test_a_disk_that_is_full_at_the_end_loses_no_message(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    messages = some_messages(40)
    writer = Rosbag2Writer(folder, TOPICS)
    write_all(writer, messages)
    writer.flush()
    # Room for a minimal end and the metadata, but not for the summary.
    room = mcap_file(folder).stat().st_size + 100
    with files_limited_to(room), pytest.raises(RecordingError):
        writer.close()
    assert read_strictly(folder) == messages


def test_a_stamp_before_zero_is_refused_without_harm(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    messages = some_messages(5)
    writer = Rosbag2Writer(folder, TOPICS)
    write_all(writer, messages)
    with pytest.raises(ValueError, match="must not be negative"):
        writer.write(LINES.name, -1, b"x")
    writer.close()
    assert read_strictly(folder) == messages


def test_a_closed_recording_takes_no_more(tmp_path: Path) -> None:
    writer = Rosbag2Writer(tmp_path / "run", TOPICS)
    writer.close()
    with pytest.raises(RecordingError, match="is closed"):
        writer.write(CLOCK.name, 0, b"")


def test_a_topic_given_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="twice"):
        Rosbag2Writer(tmp_path / "run", (CLOCK, CLOCK))
