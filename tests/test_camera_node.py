"""Camera nodes over topics: videos of a moving ground give the twist of the platform."""

from __future__ import annotations

import importlib.util
import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bystander import Bystander
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from omni_process import WORKSPACE
from sensor_msgs.msg import CameraInfo

from omni_core.configuration import to_mapping
from omni_core.sensors import LineSensor, sensor_matrix
from omni_ros.environment import node_environment
from omni_ros.messages import twist_of
from omni_ros.qos import LATCHED, RELIABLE
from omni_runs.experiment import ExperimentLibrary
from omni_runs.graph import nodes as graph
from omni_runs.graph.domain import reserved_domain
from omni_runs.graph.process_group import NodeProcess, ProcessGroup, wait_for

FRAME_RATE, ROWS, SECONDS = 50.0, 16, 4.0
BATCH = 0.1  # [s]: the odometry waits for two of them for a camera that a busy machine holds up
TWIST = np.array([1.2, 0.1, 0.3])
LENGTH, PIXELS = 0.05, 256
CAMERAS = {
    name: LineSensor(
        x=x, y=y, heading_deg=heading, pixels=PIXELS, length=LENGTH, line_rate=FRAME_RATE * ROWS
    )
    for name, x, y, heading in (
        ("left", 0.0, 0.5, 0.0),
        ("right", 0.0, -0.5, 0.0),
        ("front", 0.6, 0.0, 90.0),
    )
}


class Listener(Bystander):
    """Receives the twist and the status of the cameras."""

    def __init__(self, domain: int) -> None:
        super().__init__("listener", domain)
        self.twists: list[TwistWithCovarianceStamped] = []
        self.infos: dict[str, CameraInfo] = {}
        self.said: set[str] = set()
        create = self.node.create_subscription
        create(TwistWithCovarianceStamped, "odometry/twist", self.twists.append, RELIABLE)
        create(DiagnosticArray, "/diagnostics", self._on_report, RELIABLE)
        for name in CAMERAS:
            topic = f"line_scan/{name}/camera_info"
            create(CameraInfo, topic, lambda m: self.infos.update({m.header.frame_id: m}), LATCHED)

    def _on_report(self, message: DiagnosticArray) -> None:
        self.said |= {f"{status.name}: {status.message}" for status in message.status}

    def measured(self) -> list[Any]:
        return [t[1:3] for t in map(twist_of, self.twists) if t.covariance[0, 0] < 1.0]

    def description(self) -> str:
        return f"{len(self.twists)} twists, {len(self.measured())} measured; {sorted(self.said)}"


def frames(name: str) -> Any:
    """Return the frames of a line camera that delivers blocks of rows, shape (frames, rows, n)."""
    sensor = CAMERAS[name]
    across = replace(sensor, heading_deg=sensor.heading_deg + 90.0)
    count = round(SECONDS * FRAME_RATE) * ROWS
    time = np.arange(count) / sensor.line_rate
    along, aside = (float(row @ TWIST) for row in sensor_matrix({"a": sensor, "b": across}))
    place = along * time / sensor.pixel_pitch
    place += 2.0 - place.min()
    # The ground changes from one strip of a pixel's width to the next.
    strip = np.abs(aside * time) / sensor.width
    shape = (int(strip[-1]) + 2, int(place.max()) + PIXELS + 4)
    ground = 60.0 * np.random.default_rng(1).normal(size=shape)
    ground = 128.0 + np.apply_along_axis(np.convolve, 1, ground, [0.3, 0.5, 0.3], "same")
    lines = []
    for k, start in zip(strip, place, strict=True):
        below = int(k)
        row = (below + 1 - k) * ground[below] + (k - below) * ground[below + 1]
        lines.append(np.interp(start + np.arange(PIXELS), np.arange(shape[1]), row))
    return np.rint(np.clip(lines, 0.0, 255.0)).astype(np.uint8).reshape(-1, ROWS, PIXELS)


def film(path: Path, pictures: Any) -> Path:
    """Write a lossless video, or only the pictures if OpenCV is not installed."""
    if importlib.util.find_spec("cv2") is None:
        np.save(path.with_suffix(".npy"), pictures)
        return path.with_suffix(".npy")
    cv2 = pytest.importorskip("cv2")
    size = (pictures.shape[2], pictures.shape[1])
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), FRAME_RATE, size, False)
    for picture in pictures:
        writer.write(picture)
    writer.release()
    return path


def camera(name: str, source: Path) -> NodeProcess:
    """Return the process of a camera node, which waits for one subscriber."""
    given = {"sensor": name, "source": source, "frame_rate": FRAME_RATE, "length": LENGTH}
    given |= {"band": "false", "batch": BATCH, "subscribers": 1}
    arguments = [word for key, value in given.items() for word in ("-p", f"{key}:={value}")]
    return NodeProcess(name, "omni_vehicle", "camera", ["--ros-args", *arguments])


def test_films_of_the_ground_give_the_twist(tmp_path: Path) -> None:
    tree = {name: to_mapping(sensor) for name, sensor in CAMERAS.items()}
    configuration = ExperimentLibrary(WORKSPACE / "config").load(
        "straight_line", "assisted", (f"sensors={json.dumps(tree)}",)
    )
    with (
        reserved_domain() as domain,
        ProcessGroup(node_environment(domain)) as group,
        closing(Listener(domain)) as listener,
    ):
        nodes = [group.start(camera(n, film(tmp_path / f"{n}.avi", frames(n)))) for n in CAMERAS]
        topics = [f"line_scan/{name}/lines" for name in CAMERAS]
        listener.wait(lambda: all(listener.node.count_publishers(topic) for topic in topics))
        # All videos begin when the odometry subscribes.
        group.start(graph.Nodes(configuration, tmp_path, lockstep=True).odometry(listeners=1))
        listener.wait(lambda: len(listener.measured()) > 5)
        found = np.array([twist for twist, _ in listener.measured()])
        assert np.median(found, axis=0) == pytest.approx(TWIST, abs=0.01)
        assert set(listener.infos) == set(CAMERAS)
        assert all(i.k[0] == pytest.approx(PIXELS / LENGTH) for i in listener.infos.values())
        # A camera node ends at the end of its video.
        listener.wait(lambda: all(node.returncode == 0 for node in nodes))


def test_a_camera_that_is_none_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with reserved_domain() as domain, ProcessGroup(node_environment(domain)) as group:
        node = group.start(camera("left", tmp_path / "nothing.npy"))
        assert wait_for(node, 60.0) == 2
        assert "source: " in node.error_output()
        assert "nothing.npy cannot be read" in node.error_output()
        assert "Traceback" not in node.error_output()
