"""Lines are read as they were written; drives determine the mounting of their cameras."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from linescan_odometry.configuration import OdometryConfiguration
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch
from omni_tools.line_files.calibration import Calibration, calibrate, draw_residuals, observe
from omni_tools.line_files.kymograph import draw_kymographs, match_lines
from omni_tools.line_files.reading import LineFileError, RawFormat, read_lines
from omni_tools.line_trials.rig import Rig, ground, poses_at
from omni_vehicle.camera.cut import Cut

LINES = np.random.default_rng(1).integers(0, 256, (30, 64)).astype(np.uint8)
RATE, BATCH, BATCHES = 2500.0, 25, 24
EYE = LineSensor(x=0.6, y=0.1, heading_deg=70.0, pixels=512)
DRIVES = ((1.5, 0.0, 0.0), (0.0, 1.2, 0.0), (0.3, 0.2, 1.5), (-1.0, -0.5, -1.0))


def written(folder: Path, kind: str, lines: Any) -> Path:
    """Write lines as a file or folder of a kind, and return its path."""
    path = folder / f"lines{kind}"
    if kind == ".npy":
        np.save(path, lines)
    elif kind == ".csv":
        np.savetxt(path, lines, fmt="%d", delimiter=",", header="a,b,c", comments="")
    elif kind == ".raw":
        lines.tofile(path)
    elif kind == "":
        path.mkdir()
        for number, part in enumerate(np.array_split(lines, 11)):
            Image.fromarray(part).save(path / f"frame{number}.png")
    elif kind == ".tif":
        first, *rest = (Image.fromarray(part) for part in np.array_split(lines, 3))
        first.save(path, save_all=True, append_images=rest)
    else:
        Image.fromarray(lines).save(path)
    return path


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("kind", ["", ".png", ".tif", ".npy", ".csv", ".raw"])
def test_lines_are_read_as_they_were_written(kind: str, dtype: Any, tmp_path: Path) -> None:
    lines = LINES.astype(dtype) * (1 if dtype == np.uint8 else 200)
    path = written(tmp_path, kind, lines)
    read = read_lines(path, Cut(), RawFormat(64, 8 * lines.itemsize))
    assert read.dtype == dtype
    np.testing.assert_array_equal(read, lines)


def test_a_row_or_a_band_of_every_picture_is_a_line(tmp_path: Path) -> None:
    path = tmp_path / "film.npy"
    np.save(path, LINES.reshape(5, 6, 64))
    rows = read_lines(path, Cut(rows=(2, 3)))
    np.testing.assert_array_equal(rows, LINES[2::6])
    band = read_lines(path, Cut(rows=(1, 5), mean=True))
    expected = LINES.reshape(5, 6, 64)[:, 1:5].mean(axis=1)
    np.testing.assert_allclose(band, expected, atol=0.5)
    np.save(path, LINES.T)
    np.testing.assert_array_equal(read_lines(path, Cut(columns=True)), LINES)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.npy", None, "no such file"),
        ("x.png", b"no picture", "cannot be read"),
        ("x.npy", b"", "cannot be read"),
        ("x.csv", b"1,2\n3\n", "cannot be read"),
        ("x.csv", b"-4,2\n3,5\n", "not 0 to 65535"),
        ("x.csv", b"0.4,0.2\n1,0\n", "multiply them by 255"),
        ("x.raw", b"12345", "not a whole number of lines"),
        ("x.xyz", b"", "is none of"),
        ("x.csv", b"", "contains no line"),
    ],
)
def test_what_holds_no_lines_is_refused_by_name(
    name: str, content: bytes | None, words: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(LineFileError, match=words) as refused:
        read_lines(path, Cut(), RawFormat(2))
    assert name in str(refused.value)


def test_pictures_of_different_widths_are_no_stack(tmp_path: Path) -> None:
    for width in (20, 21):
        Image.fromarray(LINES[:, :width]).save(tmp_path / f"{width}.png")
    with pytest.raises(LineFileError, match="20 px of uint8 and 21 px of uint8"):
        read_lines(tmp_path, Cut())


def driven(true: LineSensor, nominal: LineSensor, drives: Any, noise: float = 0.003) -> Calibration:
    """Calibrate a wrongly configured camera with drives of known motion and noise [m/s]."""
    generator = np.random.default_rng(8)
    cameras = Rig({"eye": true}, ground("asphalt"), 1.0, 3).array
    observed = []
    for twist in drives:
        time = np.arange(BATCH * BATCHES) / RATE
        start = np.array([*generator.uniform(0.0, 0.2, 2), generator.uniform(0.0, 6.0)])
        lines = cameras.render({"eye": poses_at(time, start, np.array(twist))})["eye"]
        ends = range(BATCH, len(time) + 1, BATCH)
        batches = [LineBatch(round(1e9 * time[e - 1]), lines[e - BATCH : e]) for e in ends]
        stamps = np.arange(0.0, time[-1] + 0.02, 0.01)
        known = np.array(twist) + generator.normal(0.0, noise, (len(stamps), 3))
        others = {name: dataclasses.replace(nominal, x=x) for name, x in (("a", 2.0), ("b", -1.0))}
        others["b"] = dataclasses.replace(others["b"], heading_deg=nominal.heading_deg + 80.0)
        settings = OdometryConfiguration(sensors={"eye": nominal, **others})
        observed.append(observe(nominal, batches, stamps, known, settings))
    return calibrate(nominal, observed)


def lever(sensor: LineSensor) -> float:
    return sensor.x * math.sin(sensor.heading) - sensor.y * math.cos(sensor.heading)


@pytest.mark.parametrize("flip", [0.0, 180.0])
def test_drives_show_angle_pitch_place_and_mirroring(flip: float) -> None:
    true = dataclasses.replace(
        EYE, x=0.588, y=0.113, heading_deg=71.7 + flip, length=EYE.length * 1.04
    )
    found = driven(true, EYE, DRIVES)
    sensor = found.sensor
    assert found.mirrored == (flip > 0.0)
    assert not found.unseen
    assert math.remainder(sensor.heading_deg - true.heading_deg, 360.0) == pytest.approx(0, abs=0.1)
    assert sensor.length == pytest.approx(true.length, rel=3e-3)
    assert lever(sensor) == pytest.approx(lever(true), abs=2e-3)
    assert sensor.line_rate == pytest.approx(RATE, rel=1e-6)
    # The stated errors are as large as the true ones, within the accuracy of four drives.
    assert abs(lever(sensor) - lever(true)) < 4.0 * found.error["lever"] < 4e-3
    assert abs(sensor.length / true.length - 1.0) * sensor.pixel_pitch < 4.0 * found.error["pitch"]
    # They go with the camera into the covariance of the twist.
    assert sensor.lever_error == found.error["lever"]
    assert sensor.scale_error == pytest.approx(found.error["pitch"] / sensor.pixel_pitch, rel=0.01)
    assert sensor.heading_error_deg == pytest.approx(math.degrees(found.error["heading"]))
    after, before = (np.concatenate(part) for part in (found.residual, found.before))
    assert np.std(after) < 0.2 * np.std(before)
    draw_residuals({"eye": found}, "residuals")


def test_what_a_drive_does_not_show_stays_as_configured() -> None:
    nominal = dataclasses.replace(EYE, heading_deg=90.0)
    found = driven(nominal, nominal, ((0.0, 1.5, 0.0), (0.0, -1.0, 0.0)))
    assert "turning" in found.unseen
    assert "forward motion" in found.unseen
    assert lever(found.sensor) == pytest.approx(lever(nominal), abs=2e-3)
    assert found.error["lever"] > 0.1
    assert found.sensor.lever_error == found.sensor.heading_error_deg == 0.0  # as configured
    assert 0.0 < found.sensor.scale_error < 0.01
    assert found.sensor.length == pytest.approx(nominal.length, rel=3e-3)


def test_a_kymograph_shows_every_line_and_what_became_of_it() -> None:
    cameras = Rig({"eye": EYE}, ground("asphalt"), 1.0, 3).array
    time = np.arange(4 * BATCH) / RATE
    lines = cameras.render({"eye": poses_at(time, np.zeros(3), np.array([0.5, 1.0, 0.0]))})["eye"]
    others = {"a": dataclasses.replace(EYE, x=2.0), "b": dataclasses.replace(EYE, heading_deg=0.0)}
    settings = OdometryConfiguration(sensors={"eye": EYE, **others})
    batches = [
        LineBatch(round(1e9 * time[e - 1]), lines[e - BATCH : e])
        for e in range(BATCH, len(time) + 1, BATCH)
    ]
    kymograph = match_lines(EYE, batches, settings)
    assert kymograph.measured == 1.0
    np.testing.assert_allclose(kymograph.time, time, atol=1e-8)
    speed = 0.5 * math.cos(EYE.heading) + math.sin(EYE.heading)
    expected = speed / RATE / EYE.pixel_pitch
    assert float(np.median(kymograph.displacement)) == pytest.approx(expected, abs=0.05)
    draw_kymographs({"eye": kymograph}, "lines")
