"""What rules a match, how many structures a view has, and what repeats itself."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from linescan_odometry.measurements import LineBatch, SensorReading
from linescan_odometry.odometry import OdometryConfiguration
from linescan_odometry.sensor import SensorOdometry
from linescan_odometry.view.structures import StructureCounter, pull
from omni_platform.sensors import LineSensor

PIXELS, LINES, RATE = 1024, 26, 2500.0
CAMERA = LineSensor(x=0.6, y=0.0, heading_deg=90.0, pixels=PIXELS)
OTHERS = {
    "left": LineSensor(x=0.0, y=0.5, heading_deg=0.0),
    "right": LineSensor(x=0.0, y=-0.5, heading_deg=0.0),
}


def lines_over(ground: NDArray[np.float64], step: float, noise: float = 1.0) -> NDArray[np.uint8]:
    """Return lines that move over a ground that repeats itself, by a step [px] each."""
    generator = np.random.default_rng(5)
    place = np.arange(PIXELS) + step * np.arange(LINES)[:, None]
    gray = np.interp(place % len(ground), np.arange(len(ground) + 1), [*ground, ground[0]])
    noisy = np.rint(128.0 + gray + generator.normal(0.0, noise, gray.shape))
    lines: NDArray[np.uint8] = noisy.clip(0, 255).astype(np.uint8)
    return lines


def texture(length: int, grain: float) -> NDArray[np.float64]:
    rough = gaussian_filter1d(np.random.default_rng(2).normal(0.0, 1.0, length), grain, mode="wrap")
    scaled: NDArray[np.float64] = rough * (20.0 / rough.std())
    return scaled


def read(lines: NDArray[np.uint8]) -> SensorReading:
    settings = OdometryConfiguration(sensors={"eye": CAMERA, **OTHERS})
    return SensorOdometry(CAMERA, settings).update(LineBatch(round(1e9 * LINES / RATE), lines))


@pytest.mark.parametrize("step", [0.3, 7.4, -31.0])
def test_coarse_grounds_have_few_structures_whatever_the_speed_and_noise(step: float) -> None:
    def count(grain: float, noise: float) -> float:
        return StructureCounter(PIXELS).count(lines_over(texture(4096, grain), step, noise), step)

    # The power spectrum of a Gaussian of s pixels is as wide as n / (s sqrt(pi)) structures.
    for grain in (3.0, 30.0):
        assert count(grain, 0.5) == pytest.approx(PIXELS / (grain * np.pi**0.5), rel=0.5)
        assert count(grain, 4.0) == pytest.approx(count(grain, 0.5), rel=0.35)


def test_the_pulls_of_many_structures_cancel() -> None:
    assert pull(float("inf")) == pull(100.0) == 0.0
    assert 0.0 < pull(30.0) < pull(10.0) < 0.1


@pytest.mark.parametrize("step", [5.0, 40.0])
def test_a_single_edge_is_no_ground(step: float) -> None:
    edge = np.where(np.arange(2 * PIXELS) < PIXELS, 40.0, -40.0) + texture(2 * PIXELS, 8.0) / 20.0
    reading = read(lines_over(gaussian_filter1d(edge, 1.0, mode="wrap"), step))
    assert not reading.measured
    assert "match dominated by" in reading.reason
    assert reading.unlike
    assert read(lines_over(texture(4096, 8.0), step)).measured


def test_a_periodic_ground_is_detected_where_small_and_large_displacements_fit() -> None:
    period = texture(524, 3.0)
    lines = lines_over(period, 24.0 - 524.0)
    reading = read(lines)
    if reading.measured:
        assert reading.velocity == pytest.approx(24.0 * CAMERA.pixel_pitch * RATE, rel=0.01)
    else:
        assert "periodic ground" in reading.reason
    fast = read(lines_over(texture(8192, 3.0), 400.0))
    assert fast.measured
    assert fast.velocity == pytest.approx(400.0 * CAMERA.pixel_pitch * RATE, rel=1e-3)


def test_dirt_that_stands_still_is_no_rest_over_a_ground_fainter_than_the_noise() -> None:
    generator = np.random.default_rng(7)
    dirt = -60.0 * (gaussian_filter1d(generator.normal(0.0, 1.0, PIXELS), 2.0) > 0.5)
    faint = texture(4096, 20.0) / 50.0

    def seen(step: float) -> SensorReading:
        lines = lines_over(faint, step) + dirt
        return read(np.rint(lines).clip(0, 255).astype(np.uint8))

    assert seen(0.0).measured
    moving = seen(1.4)
    error = moving.velocity - 1.4 * CAMERA.pixel_pitch * RATE
    assert not moving.measured or error**2 < 4.0**2 * moving.variance
