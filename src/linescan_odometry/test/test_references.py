"""References correct shading and dark signal, and contain the pattern of an earlier drive."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.joint.spectra import FixedPattern
from linescan_odometry.references import References
from linescan_odometry.sensor import SensorOdometry
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch, LineBatchError

Expose = Callable[..., Any]

PIXELS = 256
PITCH, RATE = 5e-5, 2500.0
SHADING = 1.0 - 0.3 * np.linspace(-1.0, 1.0, PIXELS) ** 2  # 30 % less light at the ends
DARK = 6.0 * (np.arange(PIXELS) * 8 // PIXELS % 2)  # of eight amplifiers [gray levels]


def seen(light: Any) -> Any:
    """Return the gray levels of a camera with shading and a dark signal."""
    return np.rint(light * SHADING + DARK).clip(0, 255).astype(np.uint8)


def references() -> References:
    taken = References(PIXELS)
    taken.take(seen(np.zeros((9, PIXELS))), seen(np.full((9, PIXELS), 180.0)))
    return taken


def camera(tables: Path | None = None) -> SensorOdometry:
    sensors = {
        name: LineSensor(
            x=x, y=y, heading_deg=turn, pixels=PIXELS, length=PITCH * PIXELS, line_rate=RATE
        )
        for name, x, y, turn in (("a", 0.5, 0.0, 90.0), ("b", 0.0, 0.5, 180.0), ("c", -0.5, 0, 0))
    }
    return SensorOdometry(sensors["a"], OdometryConfiguration(sensors=sensors), tables)


def test_references_undo_shading_and_dark_signal(expose: Expose) -> None:
    ground = expose([500.0], PIXELS, grain=4.0, noise=0.0).astype(np.float64)
    corrected = references().correct(seen(ground)).astype(np.float64)
    assert np.corrcoef(corrected[0], ground[0])[0, 1] > 0.999
    assert corrected.mean() == pytest.approx(64.0 * (ground * SHADING).mean(), rel=0.05)


def test_a_camera_without_references_keeps_its_lines(expose: Expose) -> None:
    lines = expose([0.0, 5.0], PIXELS)
    assert References(PIXELS).correct(lines) is lines


def test_a_pixel_without_light_is_interpolated(expose: Expose) -> None:
    white = np.full((5, PIXELS), 180, np.uint8)
    white[:, 40] = 10
    taken = References(PIXELS)
    taken.take(None, white)
    assert list(np.flatnonzero(taken.dead)) == [40]
    corrected = taken.correct(expose([0.0], PIXELS)).astype(np.int64)[0]
    assert corrected[40] == pytest.approx(0.5 * (corrected[39] + corrected[41]), abs=1.0)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_no_gain_saturates_a_pixel(dtype: Any) -> None:
    full = np.iinfo(dtype).max
    white = (full * np.linspace(1.0, 0.3, PIXELS)).astype(dtype)[None]
    taken = References(PIXELS)
    taken.take(None, white)
    light = taken.correct(np.full((1, PIXELS), full, dtype))[0].astype(np.int64)
    assert light[-1] == light.max() > 3 * light[0]


@pytest.mark.parametrize(
    ("dark", "white", "complaint"),
    [
        (np.zeros((3, 8), np.uint8), None, r"must have the shape \(m, 256\)"),
        (np.full((3, PIXELS), 9, np.uint8), np.full((3, PIXELS), 9, np.uint8), "no brighter"),
    ],
)
def test_what_is_no_reference_is_refused(dark: Any, white: Any, complaint: str) -> None:
    with pytest.raises(LineBatchError, match=complaint):
        References(PIXELS).take(dark, white)


def test_tables_are_read_as_they_were_written(tmp_path: Path) -> None:
    taken = references()
    taken.pattern = FixedPattern(np.ones(5, np.complex64), np.full(5, 2.0))
    taken.save(tmp_path / "a.npz")
    read = References(PIXELS)
    read.load(tmp_path / "a.npz")
    assert read.dark == pytest.approx(taken.dark)
    assert read.gain == pytest.approx(taken.gain)
    assert read.pattern is not None
    assert read.pattern.precision == pytest.approx(2.0)
    with pytest.raises(LineBatchError, match="tables for 256 px, but this camera has 64 px"):
        References(64).load(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", mean=np.ones(3))
    with pytest.raises(LineBatchError, match="contains no tables of a camera"):
        read.load(tmp_path / "b.npz")


def test_the_pattern_of_a_drive_is_known_in_the_next_one(expose: Expose, tmp_path: Path) -> None:
    gain = 1.0 + 0.3 * np.random.default_rng(2).standard_normal(PIXELS)

    def batch(i: int, speed: float) -> LineBatch:
        lines = expose(speed * (25 * i + np.arange(26)), PIXELS) * gain
        stamp_ns = round((25 * i + 25) * 1e9 / RATE)
        return LineBatch(stamp_ns, np.rint(lines[1:] if i else lines).clip(0, 255).astype(np.uint8))

    first = camera()
    for i in range(12):
        assert first.update(batch(i, 15.0)).measured
    table = References(PIXELS)
    table.pattern = first.pattern
    table.save(tmp_path / "a.npz")
    known = camera(tmp_path / "a.npz").pattern
    assert known is not None
    assert known.deviation(PIXELS) == pytest.approx(0.3, rel=0.5)
    fresh = camera().pattern
    assert fresh is not None
    assert fresh.deviation(PIXELS) == 0.0
