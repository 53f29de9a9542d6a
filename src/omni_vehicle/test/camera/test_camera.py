"""Conversion of camera frames to lines: selected rows, stamps and lost frames."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from omni_core.configuration import ConfigurationError
from omni_core.signals import LineBatch
from omni_vehicle.camera import sources
from omni_vehicle.camera.assembler import FrameClock, LineAssembler
from omni_vehicle.camera.configuration import CameraConfiguration
from omni_vehicle.camera.cut import FrameError
from omni_vehicle.camera.sources import CameraError, VideoSource, open_source

MS = 1_000_000
RNG = np.random.default_rng(3)


def camera(**changes: Any) -> CameraConfiguration:
    given: dict[str, Any] = {"sensor": "front", "source": "0", "frame_rate": 200.0}
    return CameraConfiguration(**given | changes)


def pictures(count: int, rows: int = 6, pixels: int = 32) -> Any:
    return RNG.integers(0, 255, (count, rows, pixels)).astype(np.uint8)


def assembled(configuration: CameraConfiguration, frames: Any, numbers: Any) -> list[LineBatch]:
    """Return the batches of frames that arrive in time, each with its number."""
    assembler = LineAssembler(configuration)
    period = 1e9 / configuration.frame_rate
    taken = [
        assembler.take(frame, round(period * number), int(number))
        for frame, number in zip(frames, numbers, strict=True)
    ]
    return [*itertools.chain(*taken), *assembler.finish()]


def test_a_band_of_a_frame_is_one_line() -> None:
    frames = pictures(40)
    batches = assembled(camera(rows="2:4"), frames, range(40))
    lines = np.concatenate([batch.lines for batch in batches])
    np.testing.assert_array_equal(lines, np.rint(frames[:, 2:4].mean(axis=1)).astype(np.uint8))
    # Two lines in 10 ms; the newest one gives the stamp.
    assert {len(batch.lines) for batch in batches[1:-1]} == {2}
    assert batches[-1].stamp_ns == 39 * 5 * MS


def test_blocks_of_a_line_camera_follow_each_other() -> None:
    frames = pictures(30, rows=8)  # 1600 lines/s
    batches = assembled(camera(band=False, latency=0.002), frames, range(1, 31))
    lines = np.concatenate([batch.lines for batch in batches])
    np.testing.assert_array_equal(lines, frames.reshape(-1, 32))
    stamps = np.array([batch.stamp_ns for batch in batches])
    newest = np.cumsum([len(batch.lines) for batch in batches])
    # The stamp is that of its line in every batch.
    np.testing.assert_allclose(stamps, newest * (1e9 / 1600.0) - 2 * MS, atol=2.0)
    # They end where those of any camera with this clock end, within a line period.
    assert (stamps[:-1] % (10 * MS) >= 10 * MS - 1e9 / 1600.0 - 2).all()


def test_rows_of_a_rolling_shutter_end_with_their_frame() -> None:
    frames = pictures(10, rows=40)
    batches = assembled(camera(band=False, row_time=50e-6, batch=0.5), frames, range(10))
    assert [len(batch.lines) for batch in batches] == [40] * 10
    assert np.diff([batch.stamp_ns for batch in batches]) == pytest.approx(5 * MS)


def test_no_batch_spans_a_lost_frame() -> None:
    numbers = np.delete(np.arange(60), [17, 30, 31])
    frames = np.repeat(numbers, 6 * 32).reshape(-1, 6, 32).astype(np.uint8)
    batches = assembled(camera(batch=0.02), frames, numbers)
    for batch in batches:
        assert set(np.diff(batch.lines[:, 0].astype(int))) <= {1}
        assert batch.stamp_ns == int(batch.lines[-1, 0]) * 5 * MS


def test_a_frame_of_another_shape_is_named() -> None:
    assembler = LineAssembler(camera(rows="5"))
    assembler.take(pictures(1)[0], 0, 0)
    with pytest.raises(FrameError, match=r"16 px \(uint8\), unlike earlier frames"):
        assembler.take(pictures(1, pixels=16)[0], 5 * MS, 1)
    with pytest.raises(FrameError, match="3 rows, but rows 5:6 are selected"):
        assembler.take(pictures(1, rows=3)[0], 5 * MS, 1)


def times(count: int, rate: float, jitter: float, lost: tuple[int, ...] = ()) -> Iterator[int]:
    """Yield the arrival times of frames [ns], late by up to the share `jitter` of the period."""
    late = np.random.default_rng(1).uniform(0.0, jitter, count)
    for k in range(count):
        if k not in lost:
            yield round(1e9 / rate * (k + late[k]))


def test_stamps_are_even_where_arrivals_are_not() -> None:
    clock = FrameClock(100.0)
    stamps = [clock.take(arrival)[0] for arrival in times(400, 100.5, 0.4)]
    assert clock.lost == clock.resets == 0
    spacing = np.diff(stamps[100:])
    assert spacing.mean() == pytest.approx(1e9 / 100.5, rel=2e-3)
    assert spacing.std() < 0.02 * 10 * MS  # 0.16 for the arrivals
    assert clock.rate == pytest.approx(100.5, rel=2e-3)


@pytest.mark.parametrize("numbered", [False, True])
def test_lost_frames_are_counted_with_and_without_numbers(numbered: bool) -> None:
    lost = (150, 220, 221, 222)
    clock = FrameClock(100.0)
    numbers = [k for k in range(400) if k not in lost]
    gaps = {}
    for number, arrival in zip(numbers, times(400, 100.0, 0.3, lost), strict=True):
        _, missing = clock.take(arrival, number if numbered else None)
        if missing:
            gaps[number] = missing
    assert gaps == {151: 1, 223: 3}
    assert clock.lost == 4


def test_a_late_burst_loses_nothing_that_has_a_number() -> None:
    arrivals = [10 * MS * k for k in range(100)]
    arrivals[50:55] = [10 * MS * 55] * 5  # a busy machine reads five at once
    clock = FrameClock(100.0)
    stamps = [clock.take(arrival, k)[0] for k, arrival in enumerate(arrivals)]
    assert clock.lost == clock.resets == 0
    assert np.abs(np.array(stamps) - 10 * MS * np.arange(100)).max() < 10 * MS
    # Without frame numbers losses are unknown: the clock is reset, but never goes back.
    clock = FrameClock(100.0)
    stamps = [clock.take(arrival)[0] for arrival in arrivals]
    assert (np.diff(stamps) > 0).all()
    assert abs(stamps[-1] - arrivals[-1]) < 5 * MS


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"source": "ground.jpeg2"}, "neither a device nor a file"),
        ({"source": "nowhere.npy"}, "nowhere.npy cannot be read"),
        ({"rows": "a:b"}, "'a:b' is neither a row nor FIRST:END"),
        ({"row_time": 1e-5}, "set band to false"),
        ({"source": ""}, "is empty"),
    ],
)
def test_what_is_no_camera_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        open_source(camera(**changes))


def test_an_array_plays_its_pictures(tmp_path: Path) -> None:
    frames = pictures(3)
    np.save(tmp_path / "ground.npy", frames)
    source = open_source(camera(source=str(tmp_path / "ground.npy")))
    for number in (1, 2, 3):
        frame = source.read()
        assert frame is not None
        assert frame.number == number
        np.testing.assert_array_equal(frame.picture, frames[number - 1])
    assert source.read() is None
    assert source.ended
    np.save(tmp_path / "flat.npy", frames[0])
    with pytest.raises(ConfigurationError, match="has 2 dimensions"):
        open_source(camera(source=str(tmp_path / "flat.npy")))


class Unplugged:
    """Stand-in for OpenCV with a device that delivers three gray frames and is then unplugged."""

    CAP_V4L2, CAP_ANY = 200, 0
    CAP_PROP_FOURCC, CAP_PROP_CONVERT_RGB, CAP_PROP_FPS = 6, 16, 5
    CAP_PROP_FRAME_WIDTH, CAP_PROP_FRAME_HEIGHT, CAP_PROP_POS_MSEC = 3, 4, 0
    CAP_PROP_AUTO_EXPOSURE, CAP_PROP_EXPOSURE = 21, 15

    def __init__(self) -> None:
        self.asked: dict[int, float] = {}
        self.left = 3

    def VideoCapture(self, source: str, backend: int) -> Unplugged:  # noqa: N802 - as OpenCV has it
        assert (source, backend) == ("/dev/video7", self.CAP_V4L2)
        return self

    def VideoWriter_fourcc(self, *letters: str) -> float:  # noqa: N802
        return float(int.from_bytes("".join(letters).encode(), "little"))

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def set(self, key: int, value: float) -> None:
        self.asked[key] = value

    def get(self, _key: int) -> float:
        return 5000.25  # [ms]

    def read(self) -> tuple[bool, Any]:
        self.left -= 1
        return self.left >= 0, np.full((4, 8, 1), 700, np.uint16)

    def release(self) -> None:
        self.left = 0


def test_a_device_is_asked_for_its_settings_and_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    device = Unplugged()
    monkeypatch.setitem(__import__("sys").modules, "cv2", device)
    asked = camera(
        source="/dev/video7", pixel_format="Y16", frame_width=640, exposure=0.0005, frame_rate=120.0
    )
    source = open_source(asked)
    assert isinstance(source, VideoSource)
    assert not source.played
    assert device.asked[Unplugged.CAP_PROP_FPS] == 120.0
    assert device.asked[Unplugged.CAP_PROP_CONVERT_RGB] == 0.0  # 16 bit stay 16 bit
    assert device.asked[Unplugged.CAP_PROP_EXPOSURE] == 5.0  # of 100 us
    for _ in range(3):
        frame = source.read()
        assert frame is not None
        assert frame.stamp_ns == 5_000_250_000
        assert frame.picture.shape == (4, 8)
        assert frame.picture.dtype == np.uint16
    with pytest.raises(CameraError, match="/dev/video7 delivers no more frames"):
        source.read()


def test_a_video_gives_its_frames(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2", reason="needs requirements/opencv.lock")
    frames = np.repeat(np.repeat(pictures(5, 8, 8), 4, axis=1), 4, axis=2)
    film = cv2.VideoWriter(
        str(tmp_path / "film.avi"), cv2.VideoWriter_fourcc(*"FFV1"), 50.0, (32, 32), False
    )
    for frame in frames:
        film.write(frame)
    film.release()
    source = open_source(camera(source=str(tmp_path / "film.avi")))
    for frame in frames:
        read = source.read()
        assert read is not None
        assert np.abs(read.picture.astype(int) - frame).max() <= 3  # colors and back
    assert source.read() is None
    assert source.ended
    source.close()


def test_a_camera_of_genicam_is_read_by_a_producer() -> None:
    """The simulated cameras Viky of the GenICam wheel have a real GenTL producer."""
    pytest.importorskip("harvesters", reason="needs requirements/genicam.lock")
    genicam = pytest.importorskip("genicam")
    producer = Path(genicam.__file__).with_name("viky.cti")
    asked = camera(source=f"{producer}#1", frame_width=128, frame_height=100, rows="50:54")
    source = open_source(asked)
    assembler = LineAssembler(asked)
    numbers: list[int] = []
    while len(numbers) < 8:
        frame = source.read()
        if frame is not None and frame.number is not None:
            assert frame.picture.shape == (100, 128)
            numbers.append(frame.number)
            assembler.take(frame.picture, 5 * MS * frame.number, frame.number)
    source.close()
    assert assembler.pixels == 128
    assert numbers == sorted(set(numbers))
    with pytest.raises(ConfigurationError, match="no camera 77; cameras found: 0, 1, 2"):
        open_source(camera(source=f"{producer}#77"))
    with pytest.raises(ConfigurationError, match="refuses Width = 16000"):
        open_source(camera(source=str(producer), frame_width=16000))


def _enumeration(name: str, chosen: int, *words: str) -> str:
    entries = "".join(
        f'<EnumEntry Name="{word}"><Value>{value}</Value></EnumEntry>'
        for value, word in enumerate(words)
    )
    return f'<Enumeration Name="{name}">{entries}<Value>{chosen}</Value></Enumeration>'


@pytest.mark.parametrize(("mode", "source"), [(1, 1), (1, 0), (0, 1)])
def test_a_genicam_camera_with_an_encoder_trigger_is_refused(mode: int, source: int) -> None:
    """The names of the features are those of GenICam's SFNC."""
    genapi = pytest.importorskip("genicam.genapi", reason="needs requirements/genicam.lock")
    features = (
        _enumeration("TriggerSelector", 0, "FrameStart", "LineStart")
        + _enumeration("TriggerMode", mode, "Off", "On")
        + _enumeration("TriggerSource", source, "Line0", "Encoder0")
    )
    nodes = genapi.NodeMap()
    nodes.load_xml_from_string(
        '<RegisterDescription ModelName="M" VendorName="V" StandardNameSpace="None" '
        'SchemaMajorVersion="1" SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" '
        'MinorVersion="0" SubMinorVersion="0" ProductGuid="1" VersionGuid="1" '
        'xmlns="http://www.genicam.org/GenApi/Version_1_1">'
        f'<Category Name="Root"/>{features}</RegisterDescription>'
    )
    if mode and source:
        with pytest.raises(ConfigurationError, match="Encoder0 triggers the camera"):
            sources._refuse_encoder(nodes)
    else:
        sources._refuse_encoder(nodes)
        assert nodes.get_node("TriggerSelector").value == "FrameStart"


def test_frames_that_an_encoder_triggers_become_no_lines() -> None:
    """A vehicle accelerates; each millimeter triggers a frame, at 1 m/s at the configured rate."""
    assembler = LineAssembler(camera(frame_rate=1000.0, rows="0"))
    picture = np.zeros((4, 64), np.uint8)
    speed, published = np.linspace(0.1, 1.5, 2000), []
    stamps = np.cumsum(1e-3 / speed)
    for number, (stamp, now) in enumerate(zip(stamps, speed, strict=True)):
        batches = assembler.take(picture, round(1e9 * stamp), number)
        published += [now for batch in batches if len(batch.lines) > 1]
    assert published
    assert all(abs(now - 1.0) < 0.15 for now in published)
