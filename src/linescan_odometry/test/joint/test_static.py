"""Rest, slow motion, dirt and shadows in the joint estimator."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.joint.details import limited
from linescan_odometry.joint.estimator import JointEstimator
from linescan_odometry.sensor import SensorOdometry
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch

Levels = NDArray[np.float64]

PIXELS, LINES = 1024, 26
SENSOR = LineSensor(x=0.0, y=0.0, heading_deg=0.0)
PLACE = np.arange(PIXELS)
WAVES = 200  # of the ground, of random length and phase
CONFIGURATION = OdometryConfiguration(
    sensors={
        "left": LineSensor(x=0.0, y=0.5, heading_deg=0.0),
        "right": LineSensor(x=0.0, y=-0.5, heading_deg=0.0),
        "front": LineSensor(x=0.5, y=0.0, heading_deg=90.0),
    }
)


@functools.cache
def waves(seed: int) -> tuple[Levels, NDArray[np.complex128]]:
    """Return the wave numbers [rad/px] of a smoothed random ground, and its waves at each pixel."""
    generator = np.random.default_rng(seed)
    numbers = 2.0 * math.pi * generator.uniform(0.002, 0.08, WAVES)
    phase = generator.uniform(0.0, 2.0 * math.pi, WAVES)
    return numbers, np.exp(1j * (numbers * PLACE[:, None] + phase))


def ground(shift: float, contrast: float, seed: int = 1) -> Levels:
    """Return gray levels over a smoothed random ground, of a line at `shift` [px]."""
    numbers, at_rest = waves(seed)
    wave = (at_rest @ np.exp(1j * numbers * shift)).real
    return np.asarray(110.0 + contrast * wave / 10.0)


def batch(
    displacement: float,
    contrast: float,
    change: Callable[[int], Any] = lambda _: 1.0,
    seed: int = 2,
) -> NDArray[np.uint8]:
    """Return lines with noise; `change` returns the factor of each pixel of a line."""
    generator = np.random.default_rng(seed)
    lines = [ground(k * displacement, contrast) * change(k) for k in range(LINES)]
    noisy = np.array(lines) + generator.normal(0.0, 2.0, (LINES, PIXELS))
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def dirt(seed: int = 3) -> Levels:
    """Return the transmission of a window with 30 specks."""
    generator = np.random.default_rng(seed)
    clear = np.ones(PIXELS)
    for _ in range(30):
        place, width = generator.uniform(0.0, PIXELS), generator.uniform(2.0, 12.0)
        speck = np.exp(-0.5 * ((PLACE - place) / width) ** 2)
        clear *= 1.0 - generator.uniform(0.2, 0.8) * speck
    return clear


def gains(seed: int = 3) -> Levels:
    """Return the gains of pixels that differ by 5 %."""
    return 1.0 + 0.05 * np.random.default_rng(seed).normal(size=PIXELS)


@pytest.mark.parametrize("displacement", [0.05, 0.4, 2.4])
@pytest.mark.parametrize("contrast", [0.3, 3.0, 20.0])
@pytest.mark.parametrize("window", [dirt, gains])
def test_motion_below_a_fixed_pattern_is_not_a_certain_rest(
    displacement: float, contrast: float, window: Callable[[], Levels]
) -> None:
    clear = window()
    for seed in range(4):
        found = JointEstimator(SENSOR, 512).estimate(
            batch(displacement, contrast, lambda _: clear, seed)
        )
        error = abs(found.value - displacement)
        tolerance = max(4.0 * math.sqrt(found.variance), 0.1 * displacement)
        assert found.reason or found.few or error < tolerance


@pytest.mark.parametrize("displacement", [0.0, 0.02, 0.1, 0.3, 0.6, 1.0])
def test_a_slow_motion_is_not_reduced_by_the_pattern(displacement: float) -> None:
    found = JointEstimator(SENSOR, 512).estimate(batch(displacement, 20.0))
    assert found.reason == ""
    assert found.value == pytest.approx(displacement, abs=0.01)
    assert abs(found.value - displacement) < 4.0 * math.sqrt(found.variance)


@pytest.mark.parametrize("window", [dirt(), gains()])
def test_a_shift_of_a_few_details_is_measured_below_a_fixed_pattern(window: Levels) -> None:
    found = JointEstimator(SENSOR, 512).estimate(batch(0.8, 20.0, lambda _: window))
    assert found.reason == ""
    assert found.value == pytest.approx(0.8, abs=0.02)
    assert math.sqrt(found.variance) < 0.02


@pytest.mark.parametrize("speed", [3.0, -2.0])
def test_the_edge_of_a_shadow_is_not_a_motion(speed: float) -> None:
    def shade(k: int) -> Levels:
        return np.asarray(1.0 - 0.5 * np.clip((PLACE - 500.0 - speed * k) / 40.0 + 0.5, 0.0, 1.0))

    found = JointEstimator(SENSOR, 512).estimate(batch(0.0, 0.5, shade))
    assert found.reason
    over_ground = JointEstimator(SENSOR, 512).estimate(batch(12.3, 20.0, shade))
    assert over_ground.reason == ""
    assert over_ground.value == pytest.approx(12.3, abs=0.05)


def test_details_are_limited_to_their_median_size() -> None:
    lines = np.random.default_rng(1).normal(size=(LINES, PIXELS)).astype(np.float32)
    lines[:, 300:] += np.linspace(0.0, 9.0, LINES)[:, None].astype(np.float32)
    details = limited(lines)
    limit = float(np.abs(details).max())
    assert np.mean(np.abs(details) >= 0.999 * limit) == pytest.approx(0.5, abs=0.05)


def test_rest_with_few_features_must_follow_a_measured_motion() -> None:
    """A smooth floor with one patch of mud looks the same at rest and in motion."""
    mud = np.where(abs(PLACE - 400) < 90, ground(0.0, 25.0, 5) / 160.0, 1.0)
    eye = SensorOdometry(SENSOR, CONFIGURATION)
    lines = np.concatenate([batch(0.0, 0.2, lambda _: mud, seed) for seed in range(6)])
    for number in range(6):
        part = lines[25 * number : 25 * (number + 1)]
        assert not eye.update(LineBatch(round(1e7 * (number + 1)), part)).measured


@pytest.mark.parametrize("window", [np.ones(PIXELS), dirt(), gains()])
def test_a_lid_after_a_motion_shows_no_texture(window: Levels) -> None:
    """The error of the pattern that was learned in motion is no texture.

    A batch that begins with a line of the ground may have a velocity, but no certain one.
    """
    eye, noise = SensorOdometry(SENSOR, CONFIGURATION), np.random.default_rng(9)
    measured = []
    for number in range(60):
        levels = np.full((25, PIXELS), 60.0)
        if number < 20:
            shifts = 2.4 * (25 * number + np.arange(25))
            levels = np.array([ground(shift, 20.0) * window for shift in shifts])
        noisy = np.rint(levels + noise.normal(0.0, 2.0, levels.shape))
        lines = noisy.clip(0, 255).astype(np.uint8)
        reading = eye.update(LineBatch(round(1e7 * (number + 1)), lines))
        measured.append(reading.measured)
        if number == 20 and reading.measured:
            assert math.sqrt(reading.variance) > 0.25 * 2.4 * SENSOR.pixel_pitch * SENSOR.line_rate
    assert all(measured[3:20])
    assert not any(measured[21:])


def test_one_batch_of_other_lines_does_not_blind_a_camera_at_rest() -> None:
    eye = SensorOdometry(SENSOR, CONFIGURATION)
    measured = []
    for number in range(12):
        lines = batch(24.0 if number == 3 else 0.0, 20.0, seed=number)[:25]
        measured.append(eye.update(LineBatch(round(1e7 * (number + 1)), lines)).measured)
    assert all(measured[:3])
    assert all(measured[5:])


@pytest.mark.parametrize("displacement", [0.4, 1.0])
def test_ground_that_hardly_turns_within_a_batch_is_not_learned_as_a_pattern(
    displacement: float,
) -> None:
    """Waves of 100 px and more turn by at most a quarter of a period."""
    estimator = JointEstimator(SENSOR, 512)
    for number in range(10):
        first = number * (LINES - 1) * displacement
        lines = [ground(first + k * displacement, 20.0) for k in range(LINES)]
        noisy = np.array(lines) + np.random.default_rng(number).normal(0.0, 2.0, (LINES, PIXELS))
        estimator.estimate(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    information, precision = estimator.pattern
    # The squared error of the pattern, which is 0, relative to its stated variance.
    error = np.abs(information[4:20]) ** 2 / np.maximum(precision[4:20], 1e-12)
    assert error.mean() < 9.0
