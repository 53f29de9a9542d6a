"""A replay reproduces the recorded outputs, and reports differences."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from omni_bringup.cli import main
from omni_recording.actions.compare import compare_topics
from omni_recording.decode import MessageDecoder
from omni_recording.definitions import find_message_definition
from omni_recording.folder import bag_messages, in_time_order, open_bag
from omni_recording.mcap import RecordedChannel, RecordedMessage
from omni_recording.metadata import RecordedQos, RecordedTopic
from omni_recording.safe_yaml import in_yaml
from omni_recording.write import Rosbag2Writer
from omni_runs.graph.run_folder import VERSIONS, other_versions, versions

WORKSPACE = Path(__file__).resolve().parents[4]
SAMPLE = WORKSPACE / "bags/small_stop/assisted"
TWIST = "/odometry/twist"
_RECORDED = yaml.safe_load((SAMPLE / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
STEPS = next(
    topic["message_count"]
    for topic in _RECORDED["topics_with_message_count"]
    if topic["topic_metadata"]["name"] == "/clock"
)

Change = Callable[[RecordedMessage], bytes | None]


def command(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["replay", *map(str, arguments)])
    return int(ended.value.code or 0)


@pytest.fixture(autouse=True)
def workspace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMNI_WORKSPACE", str(WORKSPACE))


def is_published(message: RecordedMessage) -> bool:
    """Return whether a node published the message; the recorder itself adds the transforms."""
    return not message.channel.topic.startswith("/tf")


def copy(folder: Path, change: Change, *, configured: bool = True) -> Path:
    """Copy the sample, with changed messages, to a new recording and return its path.

    Args:
        folder: folder of the new recording.
        change: function that returns the bytes of a message; None to omit the message.
        configured: whether to copy the configuration too.
    """
    bag = open_bag(SAMPLE)
    messages = [m for m in bag_messages(bag) if is_published(m)]
    channels = {m.channel.topic: m.channel for m in messages}
    topics = [
        RecordedTopic(name, find_message_definition(channel.type_name), RecordedQos(10))
        for name, channel in channels.items()
    ]
    writer = Rosbag2Writer(folder, topics)
    for message in messages:
        data = change(message)
        if data is not None:
            writer.write(message.channel.topic, message.log_ns, data)
    writer.close()
    if configured:
        shutil.copy(SAMPLE / "configuration.yaml", folder)
    return folder


def test_an_offline_replay_gives_what_was_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nodes = ["--nodes", "linescan_odometry", "brake_assist"]
    assert command(SAMPLE, *nodes, "--check", "--json", "--out", tmp_path / "a") == 0
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    for topic in (TWIST, "/brake/enable", "/brake_assist/error"):
        assert metrics[f"recorded.{topic}"]["value"] == STEPS
        assert metrics[f"replayed.{topic}"]["value"] == STEPS
        assert metrics[f"replay_margin.{topic}"]["value"] <= 1.0
    assert (tmp_path / "a/configuration.yaml").is_file()
    # A second replay gives the same bits.
    assert command(SAMPLE, *nodes, "--offline", "--out", tmp_path / "b") == 0
    repeated = compare_topics(tmp_path / "a", tmp_path / "b", [TWIST])[TWIST]
    assert repeated.identical == repeated.first == STEPS


def test_another_parameter_is_noticed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changed = ["--set", "odometry.sensors.front.x=0.61"]
    assert command(SAMPLE, *changed, "--check", "--out", tmp_path / "a") == 1
    words = capsys.readouterr().out
    assert "the largest difference is" in words
    assert "not within the tolerance" in words
    assert command(SAMPLE, *changed, "--out", tmp_path / "b") == 0  # it was not asked to check
    assert command(SAMPLE, *changed, "--check", "--tolerance", 1, "--out", tmp_path / "c") == 0


def test_a_recording_of_another_version_is_named_if_the_results_differ(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = copy(tmp_path / "bag", lambda message: message.data)
    (bag / VERSIONS).write_text(in_yaml(versions() | {"numpy": "0.0.1", "commit": "a1b2c3d"}))
    changed = ["--set", "odometry.sensors.front.x=0.61", "--check"]
    assert command(bag, *changed, "--out", tmp_path / "out") == 1
    words = capsys.readouterr().out.splitlines()[-1]
    assert words.startswith("the recording was made by another version or processor: ")
    assert f"numpy 0.0.1 (here {np.__version__})" in words
    assert "a1b2c3d" in words
    assert "numba" not in words
    (bag / VERSIONS).write_text("numpy: [\n")
    assert command(bag, *changed, "--out", tmp_path / "again") == 2
    assert "versions.yaml" in capsys.readouterr().err


def test_versions_that_are_equal_or_unknown_are_not_named(tmp_path: Path) -> None:
    assert other_versions(tmp_path) == []
    (tmp_path / VERSIONS).write_text(in_yaml(versions() | {"another_package": "1"}))
    assert other_versions(tmp_path) == []


def test_a_commit_that_looks_like_a_number_is_a_text(tmp_path: Path) -> None:
    (tmp_path / VERSIONS).write_text(in_yaml(versions() | {"commit": "3e574327"}))
    (other,) = other_versions(tmp_path)
    assert other.startswith("commit 3e574327 (here ")


def test_sideslip_angles_come_with_the_twist(tmp_path: Path) -> None:
    wheel = {"sensor": "front", "x": 0.6, "y": 0.0, "minimum_speed": 2.0}
    sets = [f"--set=odometry.sideslip.nose.{key}={value}" for key, value in wheel.items()]
    assert command(SAMPLE, *sets, "--out", tmp_path / "out") == 0
    decoder = MessageDecoder()
    found: dict[str, dict[int, Any]] = {}
    for message in bag_messages(open_bag(tmp_path / "out")):
        found.setdefault(message.channel.topic, {})[message.log_ns] = decoder.decode(message)
    angles = found["/odometry/sideslip"]
    assert list(angles) == list(found[TWIST])
    measured = 0
    for stamp_ns, message in angles.items():
        twist = found[TWIST][stamp_ns].twist.twist
        (angle,) = message.position
        assert list(message.name) == ["nose"]
        assert math.isnan(angle) == (abs(twist.linear.x) < 2.0)
        if math.isfinite(angle):
            # Three cameras fit one twist exactly: the angle is that of the twist at this point.
            sideways = twist.linear.y + 0.6 * twist.angular.z
            assert angle == pytest.approx(-math.atan2(sideways, abs(twist.linear.x)), abs=1e-9)
            measured += 1
    assert 50 < measured < STEPS


def test_topics_that_overtook_each_other_are_put_in_order(tmp_path: Path) -> None:
    late: list[RecordedMessage] = []
    writer_order: list[RecordedMessage] = []
    for message in filter(is_published, bag_messages(open_bag(SAMPLE))):
        if message.channel.topic.endswith("left/lines"):
            late.append(message)
            if len(late) > 5:
                writer_order.append(late.pop(0))
        else:
            writer_order.append(message)
    kinds = {m.channel.topic: m.channel.type_name for m in writer_order}
    topics = [
        RecordedTopic(topic, find_message_definition(kind), RecordedQos(10))
        for topic, kind in kinds.items()
    ]
    writer = Rosbag2Writer(tmp_path / "bag", topics)
    for message in [*writer_order, *late]:
        writer.write(message.channel.topic, message.log_ns, message.data)
    writer.close()
    shutil.copy(SAMPLE / "configuration.yaml", tmp_path / "bag")
    assert command(tmp_path / "bag", "--check", "--out", tmp_path / "out") == 0


def test_a_silent_camera_is_no_hindrance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def without_left(message: RecordedMessage) -> bytes | None:
        silent = message.channel.topic == "/line_scan/left/lines" and message.log_ns > 10**9
        return None if silent else message.data

    bag = copy(tmp_path / "bag", without_left)
    assert command(bag, "--check", "--json", "--out", tmp_path / "out") == 1
    metrics = json.loads(capsys.readouterr().out)["metrics"]
    # The replay waits for the camera once; every step gets an answer.
    assert metrics[f"replayed.{TWIST}"]["value"] == STEPS


def test_what_cannot_be_replayed_is_refused_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def lines_only(message: RecordedMessage) -> bytes | None:
        return message.data if message.channel.topic.endswith("/lines") else None

    def no_lines(message: RecordedMessage) -> bytes | None:
        return None if message.channel.topic.endswith("left/lines") else message.data

    lines = copy(tmp_path / "lines", lines_only, configured=False)
    blind = copy(tmp_path / "blind", no_lines)
    twisted = copy(tmp_path / "twisted", lambda message: message.data)
    (twisted / "configuration.yaml").write_text("vehicle: [\n")
    out = ["--out", tmp_path / "out"]
    for arguments, words in (
        ([lines], "--experiment: there is no configuration.yaml"),
        ([lines, "--experiment", "straight_lin"], "did you mean 'straight_line'"),
        (
            [lines, "--experiment", "straight_line", "--check"],
            f"no recorded results on {TWIST}",
        ),
        ([blind], "contains no message on /line_scan/left/lines"),
        ([twisted], "configuration.yaml is not valid YAML"),
        ([SAMPLE, "--nodes", "simulator"], "'simulator' is not one of"),
        ([SAMPLE, "--rate", "2"], "`ros2 bag play --rate 2 BAG` publishes the recording"),
        ([SAMPLE, "--set", "odometry.median=1"], "odometry.median: is not a known key"),
        ([tmp_path / "nowhere"], "there is no such folder"),
    ):
        assert command(*arguments, *out) == 2
        printed = capsys.readouterr()
        assert words in printed.err
        assert printed.err.count("\n") == 1
        assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mine").touch()
    assert command(SAMPLE, *out) == 2
    assert "is not an empty folder" in capsys.readouterr().err


def test_lines_that_are_none_end_the_replay_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def spoilt(message: RecordedMessage) -> bytes:
        return message.data[:-200] if message.channel.topic.endswith("/lines") else message.data

    bag = copy(tmp_path / "bag", spoilt)
    assert command(bag, "--out", tmp_path / "out") == 1
    assert capsys.readouterr().err.startswith(f"omni replay: {bag}: /line_scan/")


# Order and comparison


def message(topic: str, log_ns: int) -> RecordedMessage:
    return RecordedMessage(RecordedChannel(topic, "", "", "", "cdr", {}), log_ns, 0, 0, b"")


def test_messages_come_by_time_and_then_in_the_order_of_the_file() -> None:
    found: list[Any] = [message("/a", 3), message("/b", 1), message("/c", 3), message("/d", 2)]
    found += [message("/e", 5 * 10**9), message("/f", 4 * 10**9)]
    assert [m.channel.topic for m in in_time_order(found)] == ["/b", "/d", "/a", "/c", "/f", "/e"]


def test_every_kind_of_difference_is_counted(tmp_path: Path) -> None:
    number = 0

    def changed(entry: RecordedMessage) -> bytes | None:
        nonlocal number
        if entry.channel.topic != TWIST:
            return entry.data
        number += 1
        data = bytearray(entry.data)
        if number == 10:
            return None
        if number == 20:
            data[data.index(b"base_link")] ^= 1
        if number == 30:
            data[28:36] = b"\0\0\0\0\0\0\xf8\x7f"  # v_x is NaN
        return bytes(data)

    result = compare_topics(SAMPLE, copy(tmp_path / "bag", changed), [TWIST])[TWIST]
    assert (result.first, result.second) == (STEPS, STEPS - 1)
    assert (result.unpaired, result.different_texts) == (1, 2)
    assert result.identical == STEPS - 3
    assert not result.agrees
    nothing = compare_topics(SAMPLE, SAMPLE, ["/nothing"])["/nothing"]
    assert not nothing.agrees
