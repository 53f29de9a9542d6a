"""Recordings that are damaged, foreign or hostile are refused in one line and little memory."""

from __future__ import annotations

import csv
import os
import resource
import shutil
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, Footer, Header, Message, Schema
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from omni_recording.actions.check import check_bag
from omni_recording.actions.export import FORMATS, ExportError, export_bag
from omni_recording.error import BagError
from omni_recording.folder import bag_files, bag_messages, bag_summary, open_bag
from omni_recording.limits import LIMITS
from omni_recording.mcap import MAGIC

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINTS, IMAGE = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image"
STEPS = 40
END = MAGIC
FRONT, REAR = "front", 'rear, "left"'

Build = Callable[[RecordBuilder], None]


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


def refusal(path: Path) -> str:
    """Return the words with which the tools refuse a recording, a line each."""
    words = []
    for tool in (check_bag, lambda p: export_bag(p, p.parent / "out")):
        with pytest.raises(BagError) as raised:
            tool(path)
        words.append(str(raised.value))
        assert "\n" not in words[-1]
        assert not (path.parent / "out").exists()
    return "; ".join(words)


def record(entry: Any) -> bytes:
    builder = RecordBuilder()
    entry.write(builder)
    return bytes(builder.end())


def mcap(path: Path, *records: bytes, end: bool = True) -> Path:
    """Write an MCAP file of these records; without an index."""
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


def chunk(
    raw: bytes, *, claimed: int | None = None, compression: str = "", packed: Any = None
) -> bytes:
    return record(
        Chunk(
            compression=compression,
            data=raw if packed is None else packed,
            message_end_time=0,
            message_start_time=0,
            uncompressed_crc=0,
            uncompressed_size=len(raw) if claimed is None else claimed,
        )
    )


# ---------------------------------------------------------------- what is sound


def test_a_sound_recording_is_sound(bag: Path) -> None:
    result = check_bag(bag)
    assert not result.problems
    assert not result.remarks
    assert result.counts == {"/wheel_states": STEPS, "/line_scan/front/lines": STEPS}


def test_the_summary_says_what_the_messages_say(bag: Path) -> None:
    found = open_bag(bag)
    summary = bag_summary(found)
    assert summary.counts == check_bag(bag).counts
    assert (summary.first_ns, summary.last_ns) == (0, (STEPS - 1) * 10**7)
    stamps = [m.log_ns for m in bag_messages(found)]
    assert sorted(stamps) == sorted([k * 10**7 for k in range(STEPS)] * 2)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_every_compression_and_a_file_without_index_is_read(
    tmp_path: Path, compression: CompressionType
) -> None:
    path = tmp_path / "one.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression, use_summary_offsets=False)
        writer.start(profile="ros2")
        channel = writer.register_channel("/a", "cdr", 0)
        for k in range(STEPS):
            writer.add_message(channel, k, joints(k), k, k)
        writer.finish()
    (reason,) = {m.data for m in bag_messages(open_bag(path)) if m.log_ns == 7}
    assert reason == joints(7)
    bare = mcap(tmp_path / "bare.mcap", described(), message(joints(3)))
    assert bag_summary(open_bag(bare)).counts == {"/wheel_states": 1}


@pytest.mark.parametrize("form", FORMATS)
def test_an_exported_table_holds_every_bit(bag: Path, tmp_path: Path, form: str) -> None:
    if form == "parquet":
        pytest.importorskip("pyarrow")
    result = export_bag(bag, tmp_path / "out", form)
    assert list(result.files) == ["/wheel_states"]
    assert "256 values" in result.skipped["/line_scan/front/lines"]
    path = result.files["/wheel_states"]
    assert path == tmp_path / "out" / f"wheel_states.{form}"
    if form == "csv":
        with path.open(newline="") as file:
            rows: list[Any] = list(csv.DictReader(file))
    else:
        import pyarrow.parquet

        table = pyarrow.parquet.read_table(path)
        assert str(table.schema.field("header.stamp_ns").type) == "int64"
        assert str(table.schema.field(f"velocity.{FRONT}").type) == "double"
        rows = table.to_pylist()
    assert len(rows) == result.rows["/wheel_states"] == STEPS
    for k, row in enumerate(rows):
        assert int(row["log_ns"]) == int(row["header.stamp_ns"]) == k * 10**7
        assert float(row[f"velocity.{FRONT}"]) == k / 3.0
        assert float(row[f"velocity.{REAR}"]) == -1e-300 * k
        assert row["header.frame_id"] == "base_link"


def test_only_the_topics_that_are_asked_for_are_exported(bag: Path, tmp_path: Path) -> None:
    assert list(export_bag(bag, tmp_path / "a", topics=["/wheel_states"]).files) == [
        "/wheel_states"
    ]
    with pytest.raises(ExportError, match=r"no topic /nothing"):
        export_bag(bag, tmp_path / "b", topics=["/nothing"])
    with pytest.raises(ExportError, match="is not an empty folder"):
        export_bag(bag, tmp_path / "a")


# ---------------------------------------------------------------- what is wrong in small


def test_counts_that_do_not_fit_are_reported(bag: Path) -> None:
    path = bag / "metadata.yaml"
    document = yaml.safe_load(path.read_text())
    information = document["rosbag2_bagfile_information"]
    information["message_count"] -= 1
    information["topics_with_message_count"][0]["message_count"] -= 1
    path.write_text(yaml.safe_dump(document))
    problems = check_bag(bag).problems
    assert problems == (
        f"metadata.yaml claims {2 * STEPS - 1} messages of {2 * STEPS}",
        f"/wheel_states: metadata.yaml claims {STEPS - 1} messages of {STEPS}",
    )


def test_missing_numbers_are_reported(tmp_path: Path) -> None:
    parts = [
        record(Message(channel_id=1, log_time=k, data=joints(k), publish_time=k, sequence=k))
        for k in range(STEPS)
        if k not in (5, 6, 20)
    ]
    path = mcap(tmp_path / "a.mcap", described(), *parts)
    assert check_bag(path).problems == ("/wheel_states: 3 messages are missing by their numbers",)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\0\1\0\0",
        b"\xff" * 100,
        # One joint name of 4 GB, then 4 billion names.
        joints(1)[:4] + struct.pack("<iII", 0, 0, 0xFFFFFFFF) + b"x" * 40,
        joints(1)[:24] + struct.pack("<I", 0xFFFFFFFF) + bytes(200),
        joints(1)[:-9],
    ],
)
def test_messages_that_cannot_be_decoded_are_counted(tmp_path: Path, data: bytes) -> None:
    path = mcap(tmp_path / "a.mcap", described(), message(joints(0)), message(data))
    (problem,) = check_bag(path).problems
    assert problem.startswith("/wheel_states: 1 messages cannot be decoded")
    result = export_bag(path, tmp_path / "out")
    assert not result.files
    assert "its bytes are no" in result.skipped["/wheel_states"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("float64 x\nfloat64 y\n", "differs from that of ROS 2 Jazzy"),
        ("7 = [no definition", "is invalid"),
        ("(" * 50_000, "is invalid"),
        ("x" * 200_000, "has 200000 characters"),
    ],
)
def test_a_definition_that_is_not_that_of_the_type_is_reported(
    tmp_path: Path, text: str, words: str
) -> None:
    path = mcap(tmp_path / "a.mcap", described(text=text), message(joints(0)))
    (problem,) = check_bag(path).problems
    assert words in problem
    assert words in export_bag(path, tmp_path / "out").skipped["/wheel_states"]


def test_a_type_of_another_package_is_noted_and_left_alone(tmp_path: Path) -> None:
    path = mcap(tmp_path / "a.mcap", described(kind="mine/msg/Own"), message(b"anything"))
    result = check_bag(path)
    assert not result.problems
    assert "'mine/msg/Own' does not belong to ROS 2 Jazzy" in result.remarks[0]


@pytest.mark.parametrize("topic", ["/../../etc/passwd", "/a/..", "relative", "/" + "a" * 300, "/"])
def test_no_topic_names_a_file_elsewhere(tmp_path: Path, topic: str) -> None:
    path = mcap(tmp_path / "a.mcap", described(topic), message(joints(0)))
    assert export_bag(path, tmp_path / "out").skipped == {
        topic: "it is not the name of a ROS topic"
    }
    assert not any((tmp_path / "out").iterdir())


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.01, 0.5, 0.99, 0.9999])
def test_a_cut_recording_is_refused_with_what_to_do(bag: Path, share: float) -> None:
    (path,) = bag_files(bag)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    words = refusal(bag)
    assert "is empty" in words if share == 0.0 else "omni bag recover" in words


def test_damage_anywhere_is_noticed_or_harmless(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=4096)
        writer.start(profile="ros2")
        text = STORE.generate_msgdef(JOINTS, ros_version=2)[0]
        schema = writer.register_schema(JOINTS, "ros2msg", text.encode())
        channel = writer.register_channel("/wheel_states", "cdr", schema)
        for k in range(100):
            writer.add_message(channel, k, joints(k), k, k)
        writer.finish()
    whole = path.read_bytes()
    sound = list(bag_messages(open_bag(path)))
    rng = np.random.default_rng(5)
    noticed = 0
    refusals = []
    for _ in range(200):
        damaged = bytearray(whole)
        place = int(rng.integers(0, len(whole) - 8))
        damaged[place : place + 8] = rng.bytes(8)
        path.write_bytes(damaged)
        try:
            if check_bag(path).problems:
                noticed += 1
            else:
                assert list(bag_messages(open_bag(path))) == sound
        except BagError as error:
            refusals.append(str(error))
    assert noticed + len(refusals) > 100
    assert not any("\n" in refusal for refusal in refusals)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"SQLite format 3\0" * 100, "is not an MCAP file"),
        (MAGIC + b"\0" * 1000 + MAGIC, "there is no record at byte 8"),
        (MAGIC + struct.pack("<BQ", 1, 2**63) + MAGIC, "is cut off"),
        (MAGIC + struct.pack("<BQ", 1, 2) + b"\xff\xff" + MAGIC, "header record is invalid"),
        (
            MAGIC + struct.pack("<BQI", 1, 8, 0xFFFFFFFF) + b"ros2" + record(Footer(0, 0, 0)) + END,
            "is invalid",
        ),
        (MAGIC + record(Footer(2**60, 0, 0)) + MAGIC, "its footer gives byte"),
    ],
)
def test_foreign_and_lying_files_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(BagError) as raised:
        bag_summary(open_bag(path))
    with pytest.raises(BagError) as other:
        check_bag(path)
    assert words in f"{raised.value} {other.value}"


@pytest.mark.parametrize(
    ("records", "words"),
    [
        ([message(b"x")], "belongs to no channel (1)"),
        ([described(), message(b"x", log_time=2**64 - 1)], "impossible time"),
        ([described(), message(b"x", log_time=2**31 * 10**9)], "impossible time"),
        ([described(), chunk(b"\x05" + struct.pack("<Q", 2**60))], "longer than its chunk"),
        ([described(), chunk(b"\x05abc")], "ends within a record"),
        ([chunk(b"", claimed=2**62)], f"more than {LIMITS.record} are not read"),
        (
            [chunk(b"")[:-8] + struct.pack("<Q", 2**64 - 1)],
            "a chunk record is invalid",
        ),
        ([chunk(b"", claimed=50)], "does not unpack to the 50 bytes"),
        ([chunk(b"", compression="rar")], "unknown compression ('rar')"),
        ([chunk(b"abc", compression="zstd")], "cannot be unpacked"),
        ([chunk(b"abc", compression="lz4")], "is damaged: a chunk"),
        ([described(), described("/other")], "described in two ways"),
        ([record(Channel(1, "/a", "cdr", {}, 9))], "has no schema (9)"),
    ],
)
def test_records_that_make_no_sense_are_refused(
    tmp_path: Path, records: list[bytes], words: str
) -> None:
    assert words in refusal(mcap(tmp_path / "a.mcap", *records))


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("claimed", [1000, LIMITS.record + 1])
def test_a_decompression_bomb_does_not_go_off(
    tmp_path: Path, compression: str, claimed: int
) -> None:
    size = 1 << 29
    if compression == "zstd":
        import zstandard

        packer = zstandard.ZstdCompressor(level=1).compressobj()
        block = bytes(1 << 22)
        packed = b"".join(packer.compress(block) for _ in range(size >> 22)) + packer.flush()
    else:
        import lz4.frame

        with lz4.frame.LZ4FrameCompressor() as press:
            block = bytes(1 << 22)
            parts = [press.begin(), *(press.compress(block) for _ in range(size >> 22))]
            packed = b"".join([*parts, press.flush()])
    path = mcap(
        tmp_path / "a.mcap", chunk(b"", claimed=claimed, compression=compression, packed=packed)
    )
    del packed
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tracemalloc.start()
    try:
        words = refusal(path)
        assert tracemalloc.get_traced_memory()[1] < 3e7
    finally:
        tracemalloc.stop()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # [KB]
    assert "does not unpack to" in words or "are not read" in words


def _metadata(bag: Path, **changes: Any) -> None:
    path = bag / "metadata.yaml"
    document = yaml.safe_load(path.read_text())
    document["rosbag2_bagfile_information"].update(changes)
    path.write_text(yaml.safe_dump(document))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"relative_file_paths": ["../secret.mcap"]}, "is not in the folder"),
        ({"relative_file_paths": ["/etc/passwd"]}, "is not in the folder"),
        ({"relative_file_paths": [".."]}, "is not in the folder"),
        ({"relative_file_paths": ["a\0b"]}, "is invalid"),
        ({"relative_file_paths": [7]}, "is invalid"),
        ({"relative_file_paths": "bag.mcap"}, "is invalid"),
        ({"relative_file_paths": []}, "names no file"),
        ({"relative_file_paths": ["gone.mcap"]}, "gone.mcap is missing"),
        ({"version": 10}, "version 10 is newer"),
        ({"version": "9"}, "version is missing or is invalid"),
        ({"storage_identifier": "sqlite3"}, "rosbags-convert"),
        ({"compression_mode": "file"}, "whole files or messages are compressed"),
        ({"message_count": None}, "message_count is missing"),
        ({"topics_with_message_count": [3]}, "is invalid"),
    ],
)
def test_metadata_that_lead_elsewhere_are_refused(
    bag: Path, changes: dict[str, Any], words: str
) -> None:
    shutil.copy(bag / "bag.mcap", bag.parent / "secret.mcap")
    _metadata(bag, **changes)
    assert words in refusal(bag)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "a: [",
        "\xff\xfe",
        "rosbag2_bagfile_information: 3",
        "[" * 2_000,
        "!!python/object/apply:os.system ['true']",
        # Each line doubles the last: a merge of 2^60 entries.
        "a0: &a0 {x: 1}\n"
        + "".join(f"a{k}: &a{k}\n  <<: [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 61)),
        "x: " + "9" * 10_000,
    ],
)
def test_foreign_metadata_are_refused(bag: Path, text: str) -> None:
    (bag / "metadata.yaml").write_text(text, encoding="latin-1")
    assert "metadata.yaml" in refusal(bag)


def test_large_metadata_are_not_even_read(bag: Path) -> None:
    with (bag / "metadata.yaml").open("ab") as file:
        file.truncate(1 << 33)
    assert "metadata.yaml is larger" in refusal(bag)


def test_a_pipe_is_not_waited_for(bag: Path) -> None:
    (path,) = bag_files(bag)
    path.unlink()
    os.mkfifo(path)
    assert "is not a regular file" in refusal(bag)
