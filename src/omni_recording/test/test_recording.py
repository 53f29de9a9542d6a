"""Log times are the stamps of the messages, in either byte order."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader

from omni_core.configuration import ConfigurationError
from omni_recording.definitions import find_message_definition
from omni_recording.metadata import RecordedQos, RecordedTopic
from omni_recording.plan import RecorderConfiguration, StampedRecording
from omni_recording.write import Rosbag2Writer
from omni_ros.messages import leading_stamp

# Encapsulation headers of plain CDR and XCDR2, by byte order.
LITTLE = (b"\0\1\0\0", b"\0\7\0\0")
BIG = (b"\0\0\0\0", b"\0\6\0\0")


def cdr(seconds: int, nanoseconds: int) -> bytes:
    return LITTLE[0] + struct.pack("<iI", seconds, nanoseconds) + b"rest"


@given(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1))
def test_the_stamp_is_read_in_either_byte_order(seconds: int, nanoseconds: int) -> None:
    expected = seconds * 10**9 + nanoseconds
    for layout, heads in (("<iI", LITTLE), (">iI", BIG)):
        for head in heads:
            assert leading_stamp(head + struct.pack(layout, seconds, nanoseconds)) == expected


@given(st.binary(max_size=40))
def test_no_bytes_break_it(data: bytes) -> None:
    stamp_ns = leading_stamp(data)
    assert stamp_ns is None or stamp_ns >= 0


def test_a_message_without_a_stamp_gets_the_latest_seen(tmp_path: Path) -> None:
    topics = [
        RecordedTopic(name, find_message_definition(kind), RecordedQos(10))
        for name, kind in (
            ("/stamped", "rosgraph_msgs/msg/Clock"),
            ("/plain", "std_msgs/msg/String"),
        )
    ]
    writer = Rosbag2Writer(tmp_path / "run", topics)
    recording = StampedRecording(writer, {t.name: t.definition for t in topics})
    looks_stamped = cdr(99, 0)
    recording.add("/plain", looks_stamped)  # the first message
    recording.add("/stamped", cdr(2, 5))
    recording.add("/stamped", cdr(1, 0))  # late, with its own stamp
    recording.add("/plain", looks_stamped)
    recording.add("/stamped", cdr(-1, 0))  # before zero
    recording.add("/stamped", b"\0\1\0\0")  # cut short
    writer.close()
    with AnyReader([tmp_path / "run"]) as reader:
        stamps = sorted((link.topic, stamp) for link, stamp, _ in reader.messages())
    late = 2_000_000_005
    assert stamps == [
        ("/plain", 0),
        ("/plain", late),
        ("/stamped", 1_000_000_000),
        *[("/stamped", late)] * 3,
    ]


def test_a_list_has_the_stamp_of_its_first_message(tmp_path: Path) -> None:
    kinds = {"/clock": "rosgraph_msgs/msg/Clock", "/markers": "visualization_msgs/msg/MarkerArray"}
    topics = [
        RecordedTopic(name, find_message_definition(kind), RecordedQos(10))
        for name, kind in kinds.items()
    ]
    writer = Rosbag2Writer(tmp_path / "run", topics)
    recording = StampedRecording(writer, {t.name: t.definition for t in topics})
    recording.add("/clock", cdr(0, 230_000_000))
    for seconds in (0, 5):  # late, with another time
        recording.add("/markers", b"\0\1\0\0" + struct.pack("<IiI", 1, seconds, 7))
    recording.add("/markers", b"\0\1\0\0" + struct.pack("<I", 0))
    writer.close()
    with AnyReader([tmp_path / "run"]) as reader:
        stamps = [stamp for link, stamp, _ in reader.messages() if link.topic == "/markers"]
    assert sorted(stamps) == [7, 230_000_000, 230_000_000]
    assert recording.problem is None


CLOCK, SHARED = "/clock", "/diagnostics"


def clocked(folder: Path) -> tuple[Rosbag2Writer, StampedRecording]:
    kinds = {CLOCK: "rosgraph_msgs/msg/Clock", SHARED: "diagnostic_msgs/msg/DiagnosticArray"}
    topics = [
        RecordedTopic(name, find_message_definition(kind), RecordedQos(10))
        for name, kind in kinds.items()
    ]
    writer = Rosbag2Writer(folder, topics)
    return writer, StampedRecording(writer, {t.name: t.definition for t in topics})


@pytest.mark.parametrize(
    ("second", "words"),
    [(1, "/clock decrease from 2 s to 1 s"), (-1, "/clock has a message with a stamp before zero")],
)
def test_time_that_runs_back_is_a_sign_of_another_run(
    second: int, words: str, tmp_path: Path
) -> None:
    writer, recording = clocked(tmp_path / "run")
    recording.add(SHARED, cdr(5, 0))  # nodes with different clocks publish it
    recording.add(SHARED, cdr(1, 0))
    for stamp in (0, 2, 2):
        recording.add(CLOCK, cdr(stamp, 0))
    assert recording.problem is None
    recording.add(CLOCK, cdr(second, 0))
    assert words in (recording.problem or "")
    writer.close()


def test_the_order_on_a_shared_topic_does_not_depend_on_who_is_faster(tmp_path: Path) -> None:
    def record(name: str, said: list[int]) -> list[bytes]:
        writer, recording = clocked(tmp_path / name)
        for second in range(6):
            recording.add(CLOCK, cdr(second, 0))
            if second == 3:
                for nanoseconds in said:
                    recording.add(SHARED, cdr(3, nanoseconds))
        recording.finish()
        writer.close()
        with AnyReader([tmp_path / name]) as reader:
            return [bytes(data) for link, _, data in reader.messages() if link.topic == SHARED]

    assert record("one", [1, 3, 2]) == record("other", [3, 2, 1])


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("folder", {"folder": ""}),
        ("topics", {"topics": (), "types": ()}),
        ("types", {"types": ("a", "b")}),
        ("latched_topics", {"latched_topics": ("/other",)}),
        ("compression", {"compression": "gzip"}),
        ("reliability", {"reliability": "mostly"}),
        ("queue_depth", {"queue_depth": 0}),
        ("flush_period", {"flush_period": 0.0}),
    ],
)
def test_what_does_not_fit_is_named(key: str, values: dict[str, Any]) -> None:
    good: dict[str, Any] = {"folder": "run", "topics": ("/clock",), "types": ("a/msg/B",)}
    with pytest.raises(ConfigurationError) as raised:
        RecorderConfiguration(**{**good, **values})
    assert raised.value.key == key
