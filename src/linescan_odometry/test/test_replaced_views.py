"""A constant view that replaced another one sooner than a vehicle can stop belongs to a cover."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.measurements import SensorReading
from linescan_odometry.odometry import LineScanOdometry
from linescan_odometry.sensor import SensorOdometry
from linescan_odometry.unsuitable_views import UnsuitableViews
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch

PIXELS, BATCH = 512, 25
CAMERA = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=PIXELS)
Levels = NDArray[Any]


def three() -> dict[str, LineSensor]:
    """Return the camera and two others that complete the twist."""
    other = dataclasses.replace(CAMERA, y=0.5)
    return {"eye": CAMERA, "other": other, "front": dataclasses.replace(other, heading_deg=90.0)}


def ground(shifts: Levels, contrast: float, seed: int = 1) -> Levels:
    """Return lines of a ground, shape (m, PIXELS), at shifts along the axis [px]."""
    rows = gaussian_filter1d(np.random.default_rng(seed).normal(size=8 * PIXELS), 4.0)
    places = np.arange(PIXELS) + 2.0 * PIXELS + shifts[:, None]
    seen: Levels = np.interp(places, np.arange(len(rows)), rows)
    levels: Levels = 110.0 + contrast / rows.std() * seen
    return levels


def readings(levels: Levels) -> list[SensorReading]:
    """Return the readings of successive batches of lines, shape (m, PIXELS)."""
    eye = SensorOdometry(CAMERA, OdometryConfiguration(sensors=three()))
    noise = np.random.default_rng(2).normal(0.0, 1.5, levels.shape)
    lines = np.rint(levels + noise).clip(0, 255).astype(np.uint8)
    return [
        eye.update(LineBatch(round(1e9 + 1e9 * end / CAMERA.line_rate), lines[end - BATCH : end]))
        for end in range(BATCH, len(lines) + 1, BATCH)
    ]


@pytest.mark.parametrize("first", [0, 7, 12])
@pytest.mark.parametrize("contrast", [0.3, 15.0])
def test_a_cover_replaces_the_view(contrast: float, first: int) -> None:
    """The view of a camera that moves over a smooth or a rough floor shows mud from a line on."""
    levels = ground(2.4 * np.arange(8 * BATCH), contrast)
    levels[4 * BATCH + first :] = ground(np.zeros(1), 15.0, seed=5)
    views = UnsuitableViews({"eye": CAMERA})
    for number, reading in enumerate(readings(levels)):
        found = views.stopped(10**9 + number * 10**7, {"eye": reading})
        assert not (found and number < 4)
        # The batch in which the view is replaced also shows the ground.
        assert found or not reading.measured or number < 5


@pytest.mark.parametrize("speed", [0.3, 1.0, 2.0, 5.0])
@pytest.mark.parametrize("contrast", [3.0, 20.0])
def test_a_motion_across_the_axis_replaces_no_view(speed: float, contrast: float) -> None:
    step = 1e-4  # m between two rows of the ground
    width, way = round(CAMERA.width / step), speed / CAMERA.line_rate / step
    rows = np.random.default_rng(4).normal(size=(math.ceil(12 * BATCH * way) + width, PIXELS))
    total = np.cumsum(gaussian_filter1d(rows, 3.0, axis=1), axis=0)
    first = np.floor(way * np.arange(12 * BATCH)).astype(int)
    seen = total[first + width - 1] - total[first]
    levels = 110.0 + contrast / seen.std() * seen
    assert not any(reading.replaced for reading in readings(levels))


def test_a_view_that_stays_is_not_replaced() -> None:
    still = np.zeros(12 * BATCH)
    dimmed = ground(still, 15.0)
    dimmed[5 * BATCH + 3 :] *= 0.3  # another exposure
    glitch = ground(still, 15.0)
    glitch[5 * BATCH : 6 * BATCH] = ground(24.0 * np.arange(BATCH), 15.0, seed=6)
    time = np.arange(12 * BATCH) / CAMERA.line_rate
    stop = ground(-0.5 * 10.0 / CAMERA.pixel_pitch * np.maximum(0.06 - time, 0.0) ** 2, 15.0)
    for levels in (dimmed, glitch, stop):
        assert not any(reading.replaced for reading in readings(levels))


@pytest.mark.parametrize("measured", [True, False])
def test_a_replaced_view_stays_covered_unless_all_others_are_at_rest(measured: bool) -> None:
    """A camera under which something passes measures the rest of the vehicle again."""
    views = UnsuitableViews({"eye": CAMERA, "other": CAMERA})
    still = SensorReading(0.0, 1e-6, 1.0, 1.0, True, static_time=0.0096)
    moving = dataclasses.replace(still, velocity=1.0, static_time=0.0)
    blind = SensorReading.unmeasured("low texture")
    named = []
    for number in range(20):
        reading = still if number < 8 else moving
        reading = dataclasses.replace(reading, replaced=number == 2)
        found = {"eye": reading, "other": still if measured else blind}
        named.append(bool(views.stopped(10**9 + number * 10**7, found)))
    covered = [False] * 8 if measured else 2 * [False] + 6 * [True]
    assert named == covered + 5 * [True] + 7 * [False]


def test_a_motion_under_one_camera_at_rest_covers_no_view_for_good() -> None:
    """The motion of a passing object contradicts the two views that do not change."""
    odometry = LineScanOdometry(OdometryConfiguration(sensors=three()))
    share = np.clip((np.arange(60 * BATCH) / BATCH - 10.0) / 25.0, 0.0, 1.0)  # of the motion
    way = 0.1 / CAMERA.pixel_pitch * (share - np.sin(2.0 * math.pi * share) / (2.0 * math.pi))
    views = [ground(shifts, 15.0, seed) for seed, shifts in enumerate((0.0 * way, 0.0 * way, way))]
    generator, named = np.random.default_rng(2), set()
    for end in range(BATCH, len(way) + 1, BATCH):
        batches = {}
        for name, levels in zip(three(), views, strict=True):
            lines = levels[end - BATCH : end] + generator.normal(0.0, 1.5, (BATCH, PIXELS))
            stamp_ns = round(1e9 + 1e9 * end / CAMERA.line_rate)
            batches[name] = LineBatch(stamp_ns, np.rint(lines).clip(0, 255).astype(np.uint8))
        estimate = odometry.update(batches)
        named |= {one.reason for one in estimate.readings.values() if "moves across" in one.reason}
    assert named
    assert estimate.measured
    np.testing.assert_allclose(estimate.twist, 0.0, atol=0.01)
