"""Damaged, foreign or malicious recordings are rejected with one line and little memory."""

from __future__ import annotations

import os
import resource
import shutil
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from made_recordings import JOINTS, STORE, described, joints, mcap, message, record
from mcap.records import Channel, Chunk, Footer
from mcap.writer import Writer as McapWriter

from omni_recording.actions.check import check_bag
from omni_recording.actions.export import export_bag
from omni_recording.error import BagError
from omni_recording.folder import bag_files, bag_messages, bag_summary, open_bag
from omni_recording.limits import LIMITS
from omni_recording.mcap import MAGIC

END = record(Footer(0, 0, 0)) + MAGIC


def refusal(path: Path) -> str:
    """Return the messages with which the tools reject a recording, one per tool."""
    words = []
    for tool in (check_bag, lambda p: export_bag(p, p.parent / "out")):
        with pytest.raises(BagError) as raised:
            tool(path)
        words.append(str(raised.value))
        assert "\n" not in words[-1]
        assert not (path.parent / "out").exists()
    return "; ".join(words)


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
        (MAGIC + struct.pack("<BQ", 1, 2**63) + MAGIC, "is truncated"),
        (MAGIC + struct.pack("<BQ", 1, 2) + b"\xff\xff" + MAGIC, "header record is invalid"),
        (MAGIC + struct.pack("<BQI", 1, 8, 0xFFFFFFFF) + b"ros2" + END, "(too short)"),
        (MAGIC + record(Footer(2**60, 0, 0)) + MAGIC, "its footer gives byte"),
    ],
)
def test_foreign_and_inconsistent_files_are_refused(
    tmp_path: Path, content: bytes, words: str
) -> None:
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
        ([chunk(b"", claimed=2**62)], f"more than the limit of {LIMITS.record}"),
        (
            [chunk(b"")[:-8] + struct.pack("<Q", 2**64 - 1)],
            "a chunk record is invalid",
        ),
        ([chunk(b"", claimed=50)], "does not unpack to its 50 bytes"),
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
    assert "does not unpack to" in words or "more than the limit" in words


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
        ({"storage_identifier": "sqlite3"}, "--dst NEW --dst-storage mcap"),
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
        "!!timestamp x",
        "rosbag2_bagfile_information: &a {version: *a}",
        # Each line doubles the last: a merge of 2^60 entries.
        "a0: &a0 {x: 1}\n"
        + "".join(f"a{k}: &a{k}\n  <<: [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 61)),
        "x: " + "9" * 10_000,
    ],
)
def test_foreign_metadata_are_refused(bag: Path, text: str) -> None:
    (bag / "metadata.yaml").write_text(text, encoding="latin-1")
    words = refusal(bag)
    assert "metadata.yaml" in words
    assert "unicode string" not in words


def test_large_metadata_are_not_even_read(bag: Path) -> None:
    with (bag / "metadata.yaml").open("ab") as file:
        file.truncate(1 << 33)
    assert "metadata.yaml is larger" in refusal(bag)


def test_a_pipe_is_not_waited_for(bag: Path) -> None:
    (path,) = bag_files(bag)
    path.unlink()
    os.mkfifo(path)
    assert "is not a regular file" in refusal(bag)
