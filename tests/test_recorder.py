"""The recorder over topics: complete, ordered and byte-identical, however it ends."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import os
import resource
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message
from mcap.stream_reader import CRCValidationError, StreamReader
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import CameraInfo, Image
from visualization_msgs.msg import MarkerArray

from omni_recording.folder import bag_messages, open_bag
from omni_ros.environment import PARENT_PID_VARIABLE, REPORT_VARIABLE, node_environment
from omni_ros.qos import RELIABLE
from omni_runs.graph.domain import reserved_domain

TIMEOUT = 60.0  # [s] only ends a test that hangs
STEP = 10_000_000  # [ns] of simulated time
CAMERAS = ("/line_scan/front/lines", "/line_scan/left/lines", "/line_scan/right/lines")
INFO = "/line_scan/front/camera_info"
MARKERS = "/markers"
TYPES = {
    **dict.fromkeys(CAMERAS, "sensor_msgs/msg/Image"),
    INFO: "sensor_msgs/msg/CameraInfo",
    MARKERS: "visualization_msgs/msg/MarkerArray",
}
NODE = ("-m", "omni_recording.recorder_node")
# A recorder that creates its subscriptions and then waits in its constructor for the file `path`.
UNDER_CONSTRUCTION = """
import pathlib, sys, time
from omni_ros.process import run_process
from omni_recording.recorder_node import RecorderNode, record

class SlowlyConstructed(RecorderNode):
    def __init__(self):
        super().__init__()
        while not pathlib.Path({path!r}).exists():
            time.sleep(0.01)

sys.exit(run_process(SlowlyConstructed, record))
"""
MAGIC = b"\x89MCAP0\r\n"

STORE = get_typestore(Stores.ROS2_JAZZY)


def serialized_image(sequence: int, lines: int = 50, pixels: int = 512) -> bytes:
    """Return a batch of noisy lines as exact CDR; 50 lines of 512 pixels make 25 KB."""
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](*divmod(sequence * STEP, 10**9))
    header = types["std_msgs/msg/Header"](stamp, f"frame_{sequence}")
    noise = np.random.default_rng(sequence).integers(0, 256, lines * pixels, dtype=np.uint8)
    image = types["sensor_msgs/msg/Image"](header, lines, pixels, "mono8", 0, pixels, noise)
    return bytes(STORE.serialize_cdr(image, "sensor_msgs/msg/Image"))


def wait_until(condition: Callable[[], Any], what: str) -> None:
    deadline = time.monotonic() + TIMEOUT
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain until {what}"
        time.sleep(0.01)


class Graph:
    """A separate ROS domain with one publishing node in this process."""

    def __init__(self, domain: int) -> None:
        self.environment = node_environment(domain)
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=int(self.environment["ROS_DOMAIN_ID"]))
        self._node = Node("publishers", context=self._context, enable_rosout=False)

    def publisher(self, kind: Any, topic: str, *, depth: int, latched: bool = False) -> Publisher:
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        # The queue holds all messages, so a reliable topic loses none at any speed.
        qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability)
        return self._node.create_publisher(kind, topic, qos)

    def close(self) -> None:
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    with reserved_domain() as domain:
        for key, value in node_environment(domain).items():
            monkeypatch.setenv(key, value)
        made = Graph(domain)
        yield made
        made.close()


@dataclasses.dataclass
class Recorder:
    """A recorder process and its folder."""

    process: subprocess.Popen[str]
    folder: Path

    @property
    def file(self) -> Path:
        return self.folder / f"{self.folder.name}_0.mcap"

    def end(self, number: signal.Signals | None = signal.SIGTERM) -> tuple[int, str, str]:
        """Signal the process; return its exit code and its output on stdout and stderr.

        The middleware's own messages on stderr are omitted. If processes of another graph were
        killed or halted, the middleware reports that a port in shared memory is in use, and uses
        the next one.
        """
        if number is not None:
            self.process.send_signal(number)
        out, err = self.process.communicate(timeout=TIMEOUT)
        own = [line for line in err.splitlines(keepends=True) if "RTPS_" not in line]
        return self.process.returncode, out, "".join(own)

    def streamed(self) -> list[tuple[str, bytes]]:
        """Return the messages that a reader finds without the end of the file."""
        return read_stream(self.file.read_bytes()) if self.file.exists() else []


def command(
    scratch: Path, parameters: Mapping[str, object], program: Sequence[str] = NODE
) -> list[str]:
    path = scratch / "recorder.yaml"
    path.write_text(yaml.safe_dump({"recorder": {"ros__parameters": dict(parameters)}}))
    # It reports on standard output here.
    start = ["env", f"{REPORT_VARIABLE}=1", sys.executable, *program]
    return [*start, "--ros-args", "--params-file", str(path)]


def parameters(path: Path, topics: Sequence[str]) -> dict[str, object]:
    return {
        "folder": str(path),
        "topics": list(topics),
        "types": [TYPES[topic] for topic in topics],
        "queue_depth": 10_000,
    }


@contextlib.contextmanager
def recording(
    graph: Graph,
    path: Path,
    topics: Sequence[str],
    /,
    program: Sequence[str] = NODE,
    **others: Any,
) -> Iterator[Recorder]:
    process = subprocess.Popen(
        command(path.parent, parameters(path, topics) | others, program),
        env=graph.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield Recorder(process, path)
    finally:
        process.kill()
        process.communicate()


def wait_for_match(publishers: Sequence[Publisher]) -> None:
    wait_until(
        lambda: all(publisher.get_subscription_count() for publisher in publishers),
        "the recorder listens",
    )


def send(publisher: Publisher, messages: Sequence[bytes]) -> None:
    for message in messages:
        publisher.publish(message)


def read_bag(folder: Path) -> list[tuple[str, int, bytes]]:
    with AnyReader([folder]) as reader:
        return [(link.topic, stamp, bytes(data)) for link, stamp, data in reader.messages()]


def read_stream(data: bytes) -> list[tuple[str, bytes]]:
    topics: dict[int, str] = {}
    messages: list[tuple[str, bytes]] = []
    with contextlib.suppress(EndOfFile, CRCValidationError, struct.error):
        for record in StreamReader(io.BytesIO(data), validate_crcs=True).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                messages.append((topics[record.channel_id], record.data))
    return messages


def test_every_message_is_recorded_in_order_and_unchanged(graph: Graph, tmp_path: Path) -> None:
    count = 400
    sent = [serialized_image(k) for k in range(count)]
    publishers = [graph.publisher(Image, topic, depth=count) for topic in CAMERAS]
    markers = graph.publisher(MarkerArray, MARKERS, depth=count)
    info = graph.publisher(CameraInfo, INFO, depth=1, latched=True)
    described = CameraInfo(width=512, distortion_model="plumb_bob")
    described.header.stamp.sec = 1
    info.publish(described)  # before the recorder starts

    with recording(graph, tmp_path / "run", list(TYPES), latched_topics=[INFO]) as recorder:
        wait_for_match([*publishers, markers, info])
        for message in sent:
            for publisher in publishers:
                publisher.publish(message)
            markers.publish(MarkerArray())
        for publisher in (*publishers, markers, info):
            publisher.wait_for_all_acked(Duration(seconds=TIMEOUT))
        code, out, err = recorder.end(signal.SIGTERM)

    assert (code, err) == (0, "")
    expected = {**dict.fromkeys(CAMERAS, count), INFO: 1, MARKERS: count}
    assert json.loads(out) == {"recorded": expected}
    assert out.count("\n") == 1

    found = read_bag(tmp_path / "run")
    for topic in CAMERAS:
        assert [data for name, _, data in found if name == topic] == sent
        assert [stamp for name, stamp, _ in found if name == topic] == [
            sequence * STEP for sequence in range(count)
        ]
    (latched,) = [data for name, _, data in found if name == INFO]
    decoded: Any = STORE.deserialize_cdr(latched, TYPES[INFO])
    assert (decoded.width, decoded.distortion_model) == (512, "plumb_bob")
    # Messages without a stamp of their own stand among those that have one.
    stamps = [stamp for name, stamp, _ in found if name == MARKERS]
    assert len(stamps) == count
    assert set(stamps) <= {sequence * STEP for sequence in range(count)} | {10**9}


@pytest.mark.parametrize(
    "options",
    [{}, {"compression": "zstd", "synchronize": True}],
    ids=["as it is", "compressed and to the disk"],
)
def test_three_fast_line_cameras_are_recorded_without_a_gap(
    graph: Graph, tmp_path: Path, options: dict[str, Any]
) -> None:
    """Three cameras with 2500 lines/s of 1024 px give 100 batches of 25 lines a second."""
    count = 150
    batches = [serialized_image(k, lines=25, pixels=1024) for k in range(count)]
    # The queue of the nodes' publishers holds 2 s; a busy machine may halt the recorder for longer.
    publishers = [graph.publisher(Image, topic, depth=RELIABLE.depth) for topic in CAMERAS]
    with recording(graph, tmp_path / "run", CAMERAS, queue_depth=2000, **options) as recorder:
        wait_for_match(publishers)
        due = time.monotonic()
        for number, batch in enumerate(batches, 1):
            time.sleep(max(0.0, due - time.monotonic()))
            due += 0.01
            for publisher in publishers:
                publisher.publish(batch)
                if number % (RELIABLE.depth // 2) == 0 or number == count:
                    publisher.wait_for_all_acked(Duration(seconds=TIMEOUT))
        code, out, err = recorder.end()
    assert (code, err) == (0, "")
    assert json.loads(out) == {"recorded": dict.fromkeys(CAMERAS, count)}
    frames: dict[str, list[int]] = {topic: [] for topic in CAMERAS}
    for message in bag_messages(open_bag(tmp_path / "run")):
        decoded: Any = STORE.deserialize_cdr(message.data, TYPES[message.channel.topic])
        assert (decoded.height, decoded.width) == (25, 1024)
        assert message.sequence == len(frames[message.channel.topic])
        frames[message.channel.topic].append(int(decoded.header.frame_id.removeprefix("frame_")))
    assert all(found == list(range(count)) for found in frames.values())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_recording_in_order(
    graph: Graph, tmp_path: Path, number: signal.Signals
) -> None:
    with recording(graph, tmp_path / "run", CAMERAS[:1], compression="zstd") as recorder:
        publisher = graph.publisher(Image, CAMERAS[0], depth=100)
        wait_for_match([publisher])
        sent = [serialized_image(k) for k in range(100)]
        send(publisher, sent)
        publisher.wait_for_all_acked(Duration(seconds=TIMEOUT))
        code, out, err = recorder.end(number)
    assert (code, err) == (0, "")
    assert json.loads(out) == {"recorded": {CAMERAS[0]: 100}}
    assert recorder.file.read_bytes().endswith(MAGIC)
    assert [data for _, _, data in read_bag(tmp_path / "run")] == sent


def test_publishers_that_go_on_do_not_hold_the_recorder_up(graph: Graph, tmp_path: Path) -> None:
    message = serialized_image(1)
    over = threading.Event()
    with recording(graph, tmp_path / "run", CAMERAS[:1]) as recorder:
        publisher = graph.publisher(Image, CAMERAS[0], depth=10)
        wait_for_match([publisher])

        def go_on() -> None:
            while not over.wait(0.005):
                publisher.publish(message)

        thread = threading.Thread(target=go_on)
        thread.start()
        try:
            wait_until(recorder.streamed, "something is recorded")
            code, out, err = recorder.end()
        finally:
            over.set()
            thread.join()
    assert (code, err) == (0, "")
    found = [data for _, _, data in read_bag(tmp_path / "run")]
    assert json.loads(out) == {"recorded": {CAMERAS[0]: len(found)}}
    assert set(found) == {message}


def test_a_kill_leaves_every_whole_chunk(graph: Graph, tmp_path: Path) -> None:
    sent = [serialized_image(k) for k in range(300)]
    with recording(graph, tmp_path / "run", CAMERAS[:1], chunk_size=1 << 24) as recorder:
        publisher = graph.publisher(Image, CAMERAS[0], depth=len(sent))
        wait_for_match([publisher])
        send(publisher, sent[:100])
        # The chunk is far from full: they get to the disk because time passes.
        wait_until(lambda: len(recorder.streamed()) == 100, "the first messages are flushed")
        send(publisher, sent[100:])
        recorder.end(signal.SIGKILL)
    found = [data for _, data in recorder.streamed()]
    assert len(found) >= 100
    assert found == sent[: len(found)]
    assert not recorder.file.read_bytes().endswith(MAGIC)
    document = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())
    assert document["rosbag2_bagfile_information"]["relative_file_paths"] == ["run_0.mcap"]


def test_a_full_disk_is_reported_and_leaves_a_readable_bag(graph: Graph, tmp_path: Path) -> None:
    sent = [serialized_image(k) for k in range(200)]
    limit = 2_000_000
    with recording(graph, tmp_path / "run", CAMERAS[:1], chunk_size=1 << 18) as recorder:
        publisher = graph.publisher(Image, CAMERAS[0], depth=len(sent))
        wait_for_match([publisher])
        resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (limit, limit))
        send(publisher, sent)
        code, out, err = recorder.end(None)  # it ends by itself
    assert code == 1
    assert err.strip().startswith(f"cannot record to {tmp_path / 'run'}: ")
    assert err.count("\n") == 1
    found = [data for _, _, data in read_bag(tmp_path / "run")]
    assert limit - 2 * (1 << 18) < sum(map(len, found)) < limit
    assert found == sent[: len(found)]
    assert json.loads(out) == {"recorded": {CAMERAS[0]: len(found)}}


def test_the_recorder_ends_with_its_parent(graph: Graph, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    recorder_command = command(tmp_path, parameters(folder, CAMERAS[:1]))
    script = (
        "import os, subprocess, sys; "
        f"os.environ[{PARENT_PID_VARIABLE!r}] = str(os.getpid()); "
        f"subprocess.run({recorder_command!r})"
    )
    parent = subprocess.Popen([sys.executable, "-c", script], env=graph.environment)
    try:
        publisher = graph.publisher(Image, CAMERAS[0], depth=10)
        wait_for_match([publisher])
        sent = [serialized_image(k) for k in range(10)]
        send(publisher, sent)
        publisher.wait_for_all_acked(Duration(seconds=TIMEOUT))
    finally:
        parent.kill()
        parent.wait()
    file = folder / "run_0.mcap"
    wait_until(lambda: file.read_bytes().endswith(MAGIC), "the orphan closes its recording")
    wait_until(lambda: publisher.get_subscription_count() == 0, "the orphan is gone")
    assert [data for _, _, data in read_bag(folder)] == sent


def test_a_signal_during_construction_loses_no_acknowledged_message(
    graph: Graph, tmp_path: Path
) -> None:
    signaled = tmp_path / "signaled"
    program = tmp_path / "recorder.py"
    program.write_text(UNDER_CONSTRUCTION.format(path=str(signaled)))
    topics = CAMERAS[:1]
    with recording(graph, tmp_path / "run", topics, program=[str(program)]) as recorder:
        publisher = graph.publisher(Image, CAMERAS[0], depth=10)
        wait_for_match([publisher])
        sent = [serialized_image(k) for k in range(10)]
        send(publisher, sent)
        publisher.wait_for_all_acked(Duration(seconds=TIMEOUT))
        recorder.process.send_signal(signal.SIGTERM)
        signaled.touch()
        code, out, err = recorder.end(None)
    assert (code, err) == (0, "")
    assert json.loads(out) == {"recorded": {CAMERAS[0]: 10}}
    assert [data for _, _, data in read_bag(tmp_path / "run")] == sent


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        ({"types": ["sensor_msgs/msg/Picture"]}, 2, "types: 'sensor_msgs/msg/Picture'"),
        ({"types": ["sensor_msgs/msg/Image"] * 2}, 2, "types: has 2 entries for 1 topics"),
        ({"topics": [CAMERAS[0][1:], CAMERAS[0]], "types": ["sensor_msgs/msg/Image"] * 2}, 2,
         f"topics: names {CAMERAS[0]} twice"),
        ({"compression": "gzip"}, 2, "compression: 'gzip' is not one of none, zstd, lz4"),
        ({"folder": os.devnull + "/run"}, 1, "cannot record to /dev/null/run: Not a directory"),
    ],
)  # fmt: skip
def test_what_cannot_be_recorded_is_reported_in_one_sentence(
    graph: Graph, tmp_path: Path, change: dict[str, Any], code: int, words: str
) -> None:
    with recording(graph, tmp_path / "run", CAMERAS[:1], **change) as recorder:
        returned, out, err = recorder.end(None)
    assert (returned, out) == (code, "")
    assert err.startswith(words)
    assert err.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_recorder_without_a_reader_of_reports_logs_the_topics_without_messages(
    graph: Graph, tmp_path: Path
) -> None:
    _, _, *by_hand = command(tmp_path, parameters(tmp_path / "run", CAMERAS))
    process = subprocess.Popen(
        by_hand,
        env=graph.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    publisher = graph.publisher(Image, CAMERAS[0], depth=1)
    wait_for_match([publisher])
    send(publisher, [serialized_image(0)])
    assert publisher.wait_for_all_acked(Duration(seconds=TIMEOUT))
    code, _, logged = Recorder(process, tmp_path / "run").end(signal.SIGINT)
    assert code == 0
    assert "recorded 1 messages" in logged
    assert f"no message on {', '.join(CAMERAS[1:])}" in logged


def test_messages_of_the_middleware_leave_stdout_alone(graph: Graph, tmp_path: Path) -> None:
    # Files of at most a kilobyte: Fast DDS complains that it has no shared memory.
    wrong = parameters(tmp_path / "run", CAMERAS[:1]) | {"compression": "gzip"}
    limited = ["prlimit", "--fsize=1000", *command(tmp_path, wrong)]
    ended = subprocess.run(
        limited, env=graph.environment, capture_output=True, text=True, check=False, timeout=TIMEOUT
    )
    assert (ended.returncode, ended.stdout) == (2, "")
    assert "RTPS_TRANSPORT_SHM" in ended.stderr
