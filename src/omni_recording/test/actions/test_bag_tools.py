"""Recordings are checked, summarized and exported, and small defects are reported."""

from __future__ import annotations

import csv
import struct
from pathlib import Path
from typing import Any

import pytest
import yaml
from made_recordings import FRONT, REAR, STEPS, described, joints, mcap, message, record
from mcap.records import Message
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from omni_core.configuration import WorkError
from omni_recording.actions.check import check_bag
from omni_recording.actions.export import ExportError, export_bag
from omni_recording.folder import bag_messages, bag_summary, open_bag

# Valid recordings


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


@pytest.mark.parametrize("form", ["csv", "parquet"])
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


def test_a_topic_that_should_have_a_table_is_named_as_failed(bag: Path, tmp_path: Path) -> None:
    images = "/line_scan/front/lines"
    whole = export_bag(bag, tmp_path / "whole")
    assert (set(whole.skipped), set(whole.failed)) == ({images}, set())
    chosen = export_bag(bag, tmp_path / "chosen", topics=[images])
    assert set(chosen.failed) == {images}
    path = mcap(tmp_path / "a.mcap", described(), message(b"\0\1\0\0"))
    assert set(export_bag(path, tmp_path / "damaged").failed) == {"/wheel_states"}


def test_a_folder_that_cannot_be_written_is_a_failure_and_no_refusal(
    bag: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(WorkError, match="cannot write to"):
        export_bag(bag, tmp_path / "file/below")


# Small defects


def test_counts_that_do_not_fit_are_reported(bag: Path) -> None:
    path = bag / "metadata.yaml"
    document = yaml.safe_load(path.read_text())
    information = document["rosbag2_bagfile_information"]
    information["message_count"] -= 1
    information["topics_with_message_count"][0]["message_count"] -= 1
    path.write_text(yaml.safe_dump(document))
    problems = check_bag(bag).problems
    assert problems == (
        f"metadata.yaml lists {2 * STEPS - 1} messages, but {2 * STEPS} were found",
        f"/wheel_states: metadata.yaml lists {STEPS - 1} messages, but {STEPS} were found",
    )


def test_missing_numbers_are_reported(tmp_path: Path) -> None:
    parts = [
        record(Message(channel_id=1, log_time=k, data=joints(k), publish_time=k, sequence=k))
        for k in range(STEPS)
        if k not in (5, 6, 20)
    ]
    path = mcap(tmp_path / "a.mcap", described(), *parts)
    assert check_bag(path).problems == ("/wheel_states: 3 messages are missing by their numbers",)


def test_a_clock_that_is_set_back_is_reported(tmp_path: Path) -> None:
    parts = [message(joints(k), log_time=k * 10**7) for k in (*range(100, 200), *range(1, 100))]
    problems = check_bag(mcap(tmp_path / "a.mcap", described(), *parts)).problems
    assert problems == (
        "/wheel_states: the clock jumped back by 1.980 s after 1.990 s (message 100 of the topic) "
        "by the stamps in the headers: split the recording there",
    )


def test_a_late_publisher_of_a_shared_topic_is_no_jump_of_the_clock(tmp_path: Path) -> None:
    stamps = (*range(100, 200), 20, 21, 22)  # the last three by a process that hung
    parts = [message(joints(k), log_time=(100 + n) * 10**7) for n, k in enumerate(stamps)]
    for topic, found in (("/diagnostics", 0), ("/wheel_states", 1)):
        path = mcap(tmp_path / f"{found}.mcap", described(topic), *parts)
        assert len(check_bag(path).problems) == found


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
    assert "its bytes are not a" in result.skipped["/wheel_states"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("float64 x\nfloat64 y\n", "differs from that of ROS 2 Jazzy"),
        ("7 = [no definition", "is invalid"),
        ("(" * 50_000, "is invalid"),
        ("x" * 200_000, "too long (200000 characters)"),
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
