"""The complete chunks of a killed recorder's file are recovered, and the command reports this."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.opcode import Opcode
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from omni_bringup.cli import main
from omni_core.commands.command_report import printable
from omni_recording.actions.check import check_bag
from omni_recording.actions.recover import Recovery, recover
from omni_recording.definitions import find_message_definition
from omni_recording.error import BagError
from omni_recording.mcap import MAGIC
from omni_recording.metadata import RecordedQos, RecordedTopic
from omni_recording.write import RecordingError, Rosbag2Writer

CLOCK, INFO = "/clock", "/line_scan/front/camera_info"
TOPICS = (
    RecordedTopic(CLOCK, find_message_definition("rosgraph_msgs/msg/Clock"), RecordedQos(200)),
    RecordedTopic(
        INFO,
        find_message_definition("sensor_msgs/msg/CameraInfo"),
        RecordedQos(1, durability="transient_local"),
    ),
)
ROLLED_OVER = 0xFFFFFFFFFAA3B800  # a negative time as an unsigned number [ns]
Records = list[tuple[str, int, bytes]]


def clock(k: int) -> bytes:
    return b"\0\1\0\0" + k.to_bytes(4, "little") + bytes(4)


def killed(folder: Path, steps: int, **options: Any) -> Records:
    """Write an unfinished recording, as a killed recorder leaves it; return its messages."""
    writer = Rosbag2Writer(folder, TOPICS, chunk_size=1000, **options)
    messages = [(CLOCK, k * 10**9, clock(k)) for k in range(steps)]
    for topic, stamp_ns, data in messages:
        writer.write(topic, stamp_ns, data)
    writer.flush()
    return messages


def mcap_file(folder: Path) -> Path:
    return folder / f"{folder.name}_0.mcap"


def without_checksums(whole: bytes) -> bytes:
    """Return an MCAP file whose chunks have no checksum, as some recorders write them."""
    raw, place = bytearray(whole), len(MAGIC)
    while place < len(raw) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", raw, place)
        if opcode == Opcode.CHUNK:
            struct.pack_into("<I", raw, place + 9 + 24, 0)  # after start, end and size
        place += 9 + length
    return bytes(raw)


def read_strictly(folder: Path) -> Records:
    with AnyReader([folder]) as reader:
        return [(link.topic, stamp, bytes(data)) for link, stamp, data in reader.messages()]


def saved(path: Path, folder: Path) -> Recovery:
    result = recover(path, folder)
    assert result is not None
    return result


def command(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["bag", *map(str, arguments)])
    return int(ended.value.code or 0)


# Recovery


@pytest.mark.parametrize("compression", ["none", "zstd", "lz4"])
def test_a_killed_recording_is_saved_byte_for_byte(tmp_path: Path, compression: str) -> None:
    path, folder = tmp_path / "run", tmp_path / "saved"
    messages = killed(path, 200, compression=compression)
    (path / "configuration.yaml").write_text("seed: 1\n")
    before = {file.name: file.read_bytes() for file in path.iterdir()}
    result = saved(path, folder)
    assert result.counts == {CLOCK: 200, INFO: 0}
    assert (result.first_ns, result.last_ns) == (0, 199 * 10**9)
    assert len(result.problems) == 1
    assert "truncated" in result.problems[0]
    assert read_strictly(folder) == messages
    assert not check_bag(folder).problems
    assert (folder / "configuration.yaml").read_text() == "seed: 1\n"
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before
    # The file has an index, and the topics are unchanged, including their QoS.
    with mcap_file(folder).open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary.statistics.message_count == 200
    with AnyReader([folder]) as reader:
        (info,) = [link for link in reader.connections if link.topic == INFO]
        assert info.digest == TOPICS[1].definition.type_hash
    assert "transient_local" in (folder / "metadata.yaml").read_text()
    assert recover(folder, tmp_path / "again") is None
    assert not (tmp_path / "again").exists()


def test_a_cut_anywhere_keeps_every_chunk_before_it(tmp_path: Path) -> None:
    path = tmp_path / "run"
    messages = killed(path, 120)
    whole = mcap_file(path).read_bytes()
    rng = np.random.default_rng(2)
    kept, refusals = [], []
    for number, cut in enumerate(sorted(rng.integers(7000, len(whole), 25).tolist())):
        mcap_file(path).write_bytes(whole[:cut])
        try:
            result = saved(path, tmp_path / str(number))
        except BagError as error:
            refusals.append(error.problem)
            kept.append(0)
            continue
        kept.append(result.counts[CLOCK])
        assert read_strictly(result.folder) == messages[: kept[-1]]
    assert kept == sorted(kept)
    assert len(set(kept)) > 3
    assert all(refusal.startswith("contains no complete message") for refusal in refusals)


def test_a_damaged_chunk_costs_no_other(tmp_path: Path) -> None:
    path = tmp_path / "run"
    messages = killed(path, 120)
    whole = bytearray(mcap_file(path).read_bytes())
    place = whole.index(clock(60))
    whole[place + 4] ^= 0xFF
    mcap_file(path).write_bytes(whole)
    result = saved(path, tmp_path / "saved")
    assert any("checksum of a chunk" in problem for problem in result.problems)
    found = read_strictly(tmp_path / "saved")
    assert set(found) < set(messages)
    assert 120 - 1000 // 30 <= len(found) < 120
    assert (CLOCK, 60 * 10**9, clock(60)) not in found
    assert found[-1] == messages[-1]


@pytest.mark.parametrize("size", [1000, 1 << 20])
def test_a_message_with_an_impossible_time_costs_no_other(tmp_path: Path, size: int) -> None:
    path = tmp_path / "run"
    with Rosbag2Writer(path, TOPICS, chunk_size=size, compression="none") as writer:
        messages = [(CLOCK, k * 10**9, clock(k)) for k in range(120)]
        for topic, stamp_ns, data in messages:
            writer.write(topic, stamp_ns, data)
    whole = mcap_file(path).read_bytes()
    for k in (0, 60, 61, 119):
        # The log time precedes the time of publication, and both precede the data.
        times = 2 * (k * 10**9).to_bytes(8, "little") + clock(k)
        assert times in whole
        wrong = ROLLED_OVER.to_bytes(8, "little") + times[8:]
        whole = whole.replace(times, wrong)
    mcap_file(path).write_bytes(without_checksums(whole))
    result = saved(path, tmp_path / "saved")
    assert read_strictly(tmp_path / "saved") == messages[1:60] + messages[62:119]
    assert dict(result.lost) == {CLOCK: 4}
    assert result.problems == (
        f"run_0.mcap is damaged: a message of {CLOCK} has an impossible time, 4 times",
    )


def test_an_impossible_end_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run"
    with Rosbag2Writer(path, TOPICS) as writer:
        writer.write(CLOCK, 10**9, clock(1))
        writer.write(CLOCK, ROLLED_OVER, clock(2), 0)
    assert command("info", path) == 1
    words = capsys.readouterr()
    assert "impossible times, from 1.000 s to 18446744073.620 s" in words.err
    assert "2 messages\n" in words.out
    assert command("check", path) == 2
    assert "has an impossible time; `omni bag recover` keeps" in capsys.readouterr().err
    assert command("recover", path) == 0
    assert "lost        1 /clock" in capsys.readouterr().out


def test_the_messages_of_an_omitted_chunk_are_counted_by_its_index(tmp_path: Path) -> None:
    path = tmp_path / "run"
    messages = killed(path, 120, compression="none")
    whole = bytearray(mcap_file(path).read_bytes())
    whole[whole.index(clock(60)) + 4] ^= 0xFF
    mcap_file(path).write_bytes(whole)
    result = saved(path, tmp_path / "saved")
    assert result.lost[CLOCK] == len(messages) - result.counts[CLOCK] > 0


def test_metadata_that_were_lost_are_made_again(tmp_path: Path) -> None:
    path = tmp_path / "run"
    messages = killed(path, 10)
    (path / "metadata.yaml").unlink()
    saved(path, tmp_path / "saved")
    assert read_strictly(tmp_path / "saved") == messages
    saved(mcap_file(path), tmp_path / "from_file")
    assert read_strictly(tmp_path / "from_file") == messages


def test_messages_of_a_missing_file_are_counted_as_lost(tmp_path: Path) -> None:
    path = tmp_path / "run"
    messages = killed(path, 10)
    saved(path, tmp_path / "saved")
    whole = tmp_path / "saved"
    document = yaml.safe_load((whole / "metadata.yaml").read_text())
    document["rosbag2_bagfile_information"]["relative_file_paths"] += ["saved_1.mcap"]
    document["rosbag2_bagfile_information"]["topics_with_message_count"][0]["message_count"] += 7
    (whole / "metadata.yaml").write_text(yaml.safe_dump(document))
    result = saved(whole, tmp_path / "again")
    assert result.problems == ("the file saved_1.mcap is missing",)
    assert sum(result.lost.values()) == 7
    assert read_strictly(tmp_path / "again") == messages


def test_what_holds_nothing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run"
    Rosbag2Writer(path, TOPICS)
    with pytest.raises(BagError, match=r"no complete message: run_0\.mcap is truncated"):
        recover(path, tmp_path / "saved")
    mcap_file(path).write_bytes(b"text")
    with pytest.raises(BagError, match="is not an MCAP file"):
        recover(path, tmp_path / "saved")
    with pytest.raises(BagError, match="no such folder"):
        recover(tmp_path / "nowhere", tmp_path / "saved")
    assert not (tmp_path / "saved").exists()


def test_nothing_is_ever_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run"
    killed(path, 10)
    with pytest.raises(RecordingError, match="is not empty"):
        recover(path, path)


# Command


def test_the_command_checks_and_recovers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run"
    killed(path, 10)
    assert command("check", path) == 2
    assert "`omni bag recover` keeps the complete messages" in capsys.readouterr().err
    assert command("recover", path) == 0
    words = capsys.readouterr().out
    assert "kept       10 /clock" in words
    assert f"from 0.000 s to 9.000 s in {path}_recovered" in words
    assert command("check", f"{path}_recovered") == 0
    assert "sound, 10 messages" in capsys.readouterr().out
    assert command("recover", f"{path}_recovered") == 0
    assert "undamaged" in capsys.readouterr().out
    assert command("recover", path) == 1  # its folder already exists
    assert "is not empty" in capsys.readouterr().err


def test_json_is_one_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run"
    killed(path, 10)
    documents = {}
    for action in ("recover", "info", "check", "export"):
        target = path if action == "recover" else f"{path}_recovered"
        assert command(action, target, "--json") == 0
        documents[action] = json.loads(capsys.readouterr().out)
        assert documents[action]["name"] == f"bag_{action}"
    for action in ("recover", "info", "check"):
        assert documents[action]["metrics"]["messages./clock"] == {"value": 10, "unit": "1"}
    assert documents["info"]["metrics"]["duration"] == {"value": 9.0, "unit": "s"}
    assert documents["info"]["topics"][CLOCK] == "rosgraph_msgs/msg/Clock"
    assert documents["export"]["metrics"]["rows./clock"]["value"] == 10


def test_an_export_that_omits_a_topic_names_it_and_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, folder = tmp_path / "run", tmp_path / "tables"
    other = RecordedTopic("/other", TOPICS[0].definition, TOPICS[0].qos)
    with Rosbag2Writer(path, (*TOPICS, other)) as writer:
        writer.write(CLOCK, 0, clock(0))
        writer.write("/other", 0, clock(0)[:-1])
    assert command("export", path, "--out", folder) == 1
    assert "left out /other: its bytes are not" in capsys.readouterr().err
    assert (folder / "clock.csv").exists()


def test_words_of_a_recording_do_not_steer_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    evil = "/clock\x1b[2J\x07[red]"
    writer = Rosbag2Writer(
        tmp_path / "run", [RecordedTopic(evil, TOPICS[0].definition, TOPICS[0].qos)]
    )
    writer.write(evil, 0, clock(0))
    writer.close()
    for action, code in (("info", 0), ("check", 0), ("export", 1)):
        assert command(action, tmp_path / "run") == code
        words = capsys.readouterr()
        assert "\x1b" not in words.out + words.err
        assert "\x07" not in words.out + words.err


@pytest.mark.parametrize("action", ["info", "check", "export", "recover"])
@pytest.mark.parametrize("content", [b"", b"text", b"\x89MCAP0\r\n" + bytes(1000)])
def test_what_is_no_recording_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], action: str, content: bytes
) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    assert command(action, path) == 2
    words = capsys.readouterr()
    assert not words.out
    assert words.err.startswith(f"omni bag {action}: {path}: ")
    assert words.err.count("\n") == 1


def test_no_ros_is_imported(tmp_path: Path) -> None:
    path = tmp_path / "run"
    killed(path, 10)
    shutil.rmtree(f"{path}_recovered", ignore_errors=True)
    script = (
        "import sys\n"
        "from omni_bringup.cli import main\n"
        "try: main(['bag', 'recover', sys.argv[1]])\n"
        "except SystemExit as end: code = end.code\n"
        "heavy = {'rclpy', 'sensor_msgs', 'numba', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(code or len(heavy))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], env=dict(os.environ), check=False
    )
    assert done.returncode == 0


def test_links_that_lead_nowhere_are_refused_by_name(tmp_path: Path) -> None:
    for name, target in (("lost", "nothing.mcap"), ("round", "round_0.mcap")):
        folder = tmp_path / name
        folder.mkdir()
        (folder / f"{name}_0.mcap").symlink_to(folder / target)
        with pytest.raises(BagError, match=rf"{name}_0\.mcap cannot be read"):
            recover(folder, tmp_path / "saved")


def test_a_link_to_nothing_beside_whole_files_costs_nothing_but_itself(tmp_path: Path) -> None:
    path, folder = tmp_path / "run", tmp_path / "saved"
    messages = killed(path, 20)
    (path / "stray_0.mcap").symlink_to(path / "nothing.mcap")
    result = saved(path, folder)
    assert any("stray_0.mcap cannot be read" in problem for problem in result.problems)
    assert read_strictly(folder) == messages


def test_a_name_without_end_does_not_fill_the_terminal() -> None:
    assert len(printable("/t" * 12_500)) < 1100
