"""A profile that stands still is learned while the ground moves, and only then."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import LineBatch, LineBatchError
from linescan_odometry.sensor import SensorOdometry
from linescan_odometry.view.flat_field import FlatField, _fill
from omni_platform.sensors import LineSensor

Expose = Callable[..., Any]

PIXELS = 256
PITCH, RATE = 5e-5, 2500.0
SHADING = 1.0 - 0.3 * np.linspace(-1.0, 1.0, PIXELS) ** 2  # 30 % less light at the ends


def shaded(expose: Expose, positions: Any, noise_seed: int) -> Any:
    """Expose a coarse ground of weak contrast through optics that shade it."""
    lines = expose(positions, PIXELS, grain=4.0, noise=0.0)
    weak = 150.0 + 0.12 * (lines.astype(np.float64) - 128.0)
    noise = np.random.default_rng(noise_seed).standard_normal(lines.shape)
    return np.rint(weak * SHADING + noise).clip(0, 255).astype(np.uint8)


def camera(**changes: Any) -> SensorOdometry:
    sensors = {
        name: LineSensor(
            x=x, y=y, heading_deg=turn, pixels=PIXELS, length=PITCH * PIXELS, line_rate=RATE
        )
        for name, x, y, turn in (
            ("a", 0.5, 0.0, 90.0),
            ("b", 0.0, 0.5, 180.0),
            ("c", -0.5, 0.0, 0.0),
        )
    }
    return SensorOdometry(sensors["a"], OdometryConfiguration(sensors=sensors, **changes))


@pytest.mark.parametrize(("places", "right"), [(0, False), (200, True)])
def test_shading_hides_a_weak_ground_unless_it_is_corrected(
    places: int, right: bool, expose: Expose
) -> None:
    sensor = camera(flat_field_places=places)
    velocity = []
    for i in range(30):
        positions = -4000.0 + 15.0 * (25 * i + np.arange(26))
        lines = shaded(expose, positions[1:] if i else positions, i)
        reading = sensor.update(LineBatch(round((25 * i + 25) * 1e9 / RATE), lines))
        velocity.append(reading.velocity if reading.measured else np.nan)
    truth = 15.0 * PITCH * RATE
    measured = abs(np.array(velocity[-5:]) / truth - 1.0) < 0.01
    assert measured.all() if right else not measured.all()


def test_the_profile_is_that_of_the_optics(expose: Expose) -> None:
    field = FlatField(PIXELS, 1000)
    for line in shaded(expose, np.linspace(-4000.0, 7800.0, 90), 0):
        field.learn(line)
    assert field.places > 50
    assert field.profile == pytest.approx(SHADING / SHADING.mean(), abs=0.02)
    corrected = field.correct(shaded(expose, [500.0], 1)).astype(np.float64)
    bare = 150.0 + 0.12 * (expose([500.0], PIXELS, grain=4.0, noise=0.0)[0] - 128.0)
    smooth = gaussian_filter1d(corrected[0] / corrected.mean() - bare / bare.mean(), 3.0)
    assert abs(smooth).max() < 0.03  # 30 % before


@pytest.mark.parametrize("gain", [1.0, 0.6])
def test_the_ground_at_rest_is_no_profile(gain: float, expose: Expose) -> None:
    field = FlatField(PIXELS, 1000)
    for seed in range(50):
        line = expose([0.0], PIXELS, grain=4.0, noise=2.0, noise_seed=seed)[0]
        field.learn((line * gain ** (seed % 2)).astype(np.uint8))
    assert field.places == 1


def test_nothing_is_changed_before_the_profile_is_known(expose: Expose) -> None:
    field = FlatField(PIXELS, 1000)
    lines = expose([0.0, 5.0], PIXELS)
    field.learn(lines[0])
    assert field.correct(lines) is lines


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_no_gain_saturates_a_pixel(dtype: Any) -> None:
    field = FlatField(PIXELS, 1000)
    generator = np.random.default_rng(1)
    full = np.iinfo(dtype).max
    for _ in range(40):
        ground = gaussian_filter1d(generator.uniform(-3.0, 4.0, PIXELS), 1.5).clip(0.0, 1.0)
        line = full * ground * np.linspace(1.0, 0.1, PIXELS)
        field.learn(line.astype(dtype))
    white = field.correct(np.full((1, PIXELS), full, dtype))[0].astype(np.int64)
    assert field.places > 30
    assert white[-1] == white.max()  # nothing wrapped around
    assert white[-1] > 4 * white[0]


def test_a_ground_that_repeats_itself_is_no_profile(expose: Expose) -> None:
    field = FlatField(PIXELS, 1000)
    lines = expose([0.0, 700.0, 1400.0], PIXELS, grain=4.0, noise=2.0)
    for _ in range(30):
        for line in lines:
            field.learn(line)
    assert field.places == 3


def test_darkness_teaches_nothing() -> None:
    field = FlatField(64, 10)
    assert not field.learn(np.zeros(64, np.uint8))


def unlike_pixels(expose: Expose, positions: Any, dark: Any, gain: Any) -> Any:
    """Return lines of a camera whose pixels differ, of a ground with little light."""
    light = expose(positions, PIXELS, grain=4.0, noise=1.0)
    return np.clip(np.rint(0.35 * light * gain + dark), 0, 255).astype(np.uint8)


def test_references_correct_the_first_line_and_survive_a_file(
    tmp_path: Path, expose: Expose
) -> None:
    rng = np.random.default_rng(4)
    dark, gain = rng.uniform(5.0, 15.0, PIXELS), rng.uniform(0.8, 1.2, PIXELS)
    gain[77] = 0.0  # a dead pixel
    noise = rng.normal(0.0, 1.0, (2, 100, PIXELS))
    covered = np.rint(dark + noise[0]).clip(0).astype(np.uint8)
    white = np.rint(180.0 * gain + dark + noise[1]).clip(0, 255).astype(np.uint8)
    field = FlatField(PIXELS, 200)
    field.take_references(covered, white)
    assert field.corrects
    assert field.learning  # of dirt and shadows they know nothing
    assert list(np.flatnonzero(field.blind)) == [77]
    field.save(tmp_path / "a.npz")
    loaded = FlatField(PIXELS, 200)
    loaded.load(tmp_path / "a.npz")
    lines = unlike_pixels(expose, [500.0, 507.0], dark, gain)
    corrected = field.correct(lines)
    np.testing.assert_array_equal(loaded.correct(lines), corrected)
    even = 64.0 * 0.35 * expose([500.0, 507.0], PIXELS, grain=4.0, noise=0.0)
    error = np.delete(corrected / corrected.mean() - even / even.mean(), 77, axis=1)
    assert error.std() < 0.03  # noise of the lines; 0.15 without
    assert np.delete(lines / lines.mean() - even / even.mean(), 77, axis=1).std() > 0.1
    # Without learning they are used all the same.
    fixed = FlatField(PIXELS, 0)
    fixed.load(tmp_path / "a.npz")
    np.testing.assert_array_equal(fixed.apply(lines), corrected)


def test_tables_of_a_drive_are_used_from_the_first_line_of_the_next(
    tmp_path: Path, expose: Expose
) -> None:
    field = FlatField(PIXELS, 1000)
    field.apply(shaded(expose, np.linspace(-4000.0, 7800.0, 90), 0))
    field.save(tmp_path / "a.npz")
    loaded = FlatField(PIXELS, 1000)
    loaded.load(tmp_path / "a.npz")
    line = shaded(expose, [500.0], 1)
    np.testing.assert_array_equal(loaded.correct(line), field.correct(line))
    assert loaded.learning  # until this drive has shown that nothing else stands still


def test_files_that_are_no_tables_are_named(tmp_path: Path) -> None:
    field = FlatField(PIXELS, 200)
    (tmp_path / "a.npz").write_text("no tables")
    with pytest.raises(LineBatchError, match="holds no tables of a camera"):
        field.load(tmp_path / "a.npz")
    FlatField(64, 200).save(tmp_path / "b.npz")
    with pytest.raises(LineBatchError, match=f"is of 64 px, this camera has {PIXELS} px"):
        field.load(tmp_path / "b.npz")
    with pytest.raises(LineBatchError, match="no brighter than the dark one"):
        field.take_references(np.full((3, PIXELS), 9, np.uint8), np.full((3, PIXELS), 9, np.uint8))


def test_rest_under_a_strong_pattern_is_not_sure_while_a_faint_ground_creeps(
    expose: Expose,
) -> None:
    """Dirt rules every pair of lines; what changes between them shows over half of a batch."""
    pattern = 50.0 * gaussian_filter1d(np.random.default_rng(3).standard_normal(PIXELS), 3.0)
    sensor, score = camera(), []
    for i in range(4):
        positions = 0.6 * (25 * i + np.arange(26))
        ground = expose(positions[1:] if i else positions, PIXELS, grain=6.0, noise=0.0)
        noise = np.random.default_rng(i).standard_normal(ground.shape)
        gray = 120.0 + 0.05 * (ground.astype(np.float64) - 128.0) + pattern + noise
        lines = np.rint(gray).clip(0, 255).astype(np.uint8)
        reading = sensor.update(LineBatch(round((25 * i + 25) * 1e9 / RATE), lines))
        if reading.measured:
            score.append((reading.velocity - 0.6 * PITCH * RATE) / reading.variance**0.5)
    assert np.all(np.abs(score) < 4.0)


def test_blind_pixels_fade_to_the_mean_without_a_step() -> None:
    light = np.random.default_rng(1).normal(100.0, 0.1, (3, PIXELS))
    light += 20.0 * np.linspace(-1.0, 1.0, PIXELS)
    seen = light.copy()
    blind = np.zeros(PIXELS, np.bool_)
    blind[100:108] = blind[180:] = True
    light[:, blind] = 0.0
    _fill(light, blind)
    assert np.abs(np.diff(light, axis=1)).max() < 1.5
    assert light[:, 100:108] == pytest.approx(seen[:, 100:108], abs=1.0)
    assert light[:, 230] == pytest.approx(light[:, ~blind].mean(axis=1))
