"""A profile that stands still is learnt while the ground moves, and only then."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import LineBatch
from linescan_odometry.sensor import SensorOdometry
from linescan_odometry.view.flat_field import FlatField
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
