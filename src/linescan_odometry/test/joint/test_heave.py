"""Heave of a camera with an ordinary lens, seen in the scale of its view."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.joint.estimator import Heave, JointEstimator
from linescan_odometry.joint.fit import UNSCALED, Scaling
from linescan_odometry.plausibility import Plausibility
from linescan_odometry.sensor import SensorOdometry
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch

BATCHES, LINES = 16, 25
SENSOR = LineSensor(x=0.0, y=0.0, heading_deg=0.0)
CONFIGURATION = OdometryConfiguration(
    sensors={
        "left": SENSOR,
        "right": LineSensor(x=0.0, y=-0.5, heading_deg=0.0),
        "front": LineSensor(x=0.5, y=0.0, heading_deg=90.0),
    }
)


def scale(time: NDArray[np.float64], amplitude: float) -> NDArray[np.float64]:
    """Return the pixel pitch on the ground, relative to its mean, which varies with 30 Hz."""
    return 1.0 + amplitude * np.sin(2.0 * math.pi * 30.0 * time)


def drive(amplitude: float, speed: float, seed: int = 1) -> list[tuple[float, float, str]]:
    """Return velocity, variance and remark of each batch at a speed [m/s] over fine texture."""
    generator = np.random.default_rng(seed)
    waves = generator.uniform(200.0, 8000.0, 100)  # rad/m
    phase = generator.uniform(0.0, 2.0 * math.pi, 100)
    # A wave at pixel 32 i + j is the product of its values at 32 i and at j.
    fine = np.arange(32) * SENSOR.pixel_pitch
    coarse = np.arange(-0.5 * SENSOR.pixels, 0.5 * SENSOR.pixels, 32) * SENSOR.pixel_pitch
    odometry, found = SensorOdometry(SENSOR, CONFIGURATION), []
    for b in range(BATCHES):
        time = (LINES * b + np.arange(LINES)) / SENSOR.line_rate
        scaled = waves * scale(time, amplitude)[:, None, None]
        start = waves * speed * time[:, None, None] + phase
        waves_at = np.exp(1j * (start + scaled * coarse[:, None]))
        sums = waves_at @ np.exp(1j * scaled * fine[:, None]).transpose(0, 2, 1)
        levels = 110.0 + 3.5 * sums.real.reshape(LINES, SENSOR.pixels)
        levels += generator.normal(0.0, 2.0, levels.shape)
        lines = np.rint(levels).clip(0, 255).astype(np.uint8)
        reading = odometry.update(LineBatch(10**9 + round(1e9 * time[-1]), lines))
        assert reading.measured, reading.reason
        found.append((reading.velocity, reading.variance, reading.remark))
    return found


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_heave_is_named_and_contained_in_the_variance(speed: float) -> None:
    velocity, variance, remarks = zip(*drive(0.02, speed), strict=True)
    named = [remark.startswith("heave: ") for remark in remarks]
    assert sum(named) >= 0.9 * BATCHES, named
    errors = (np.array(velocity) - speed) ** 2 / np.array(variance)
    assert errors.max() < 9.0
    assert errors.mean() < 2.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_camera_at_constant_height_has_no_heave(seed: int) -> None:
    assert {remark for _, _, remark in drive(0.0, 0.5, seed)} == {""}


@pytest.mark.parametrize("frequency", [5.0, 30.0])
def test_the_standard_deviation_of_the_scale_is_that_of_its_changes(frequency: float) -> None:
    heave, amplitude, lines, rate = Heave(2500.0), 0.02, 25, 2500.0
    generator = np.random.default_rng(2)
    sums = []
    for batch in range(300):
        ends = np.sin(2.0 * math.pi * frequency * lines * np.array([batch, batch + 1]) / rate)
        change = amplitude * float(np.diff(ends)[0]) / lines
        noise = 1e-5
        heave.add(Scaling(change + noise * float(generator.normal()), noise**2, 0.0), lines)
        sums.append(heave.variance)
    deviation = math.sqrt(float(np.mean(sums[50:])))
    assert deviation == pytest.approx(amplitude / math.sqrt(2.0), rel=0.2)


def test_an_unknown_change_leaves_the_variance() -> None:
    heave = Heave(2500.0)
    for sign in (1.0, -1.0, 1.0, -1.0):
        heave.add(Scaling(sign * 1e-3, 1e-12, 0.0), 25)
    known = heave.variance
    heave.add(Scaling(0.0, math.inf, 0.0), 25)
    assert heave.variance == known > 0.0


def test_a_view_of_unknown_scale_has_a_finite_variance(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = JointEstimator(SENSOR, 400)
    lines = np.random.default_rng(2).integers(0, 255, SENSOR.pixels, np.uint8) + np.zeros(
        (LINES, 1), np.uint8
    )
    estimate = camera.estimate(lines)._replace(
        value=5.0, variance=1e-4, reason="", moves=True, few=False, scaling=UNSCALED
    )
    monkeypatch.setattr(camera, "estimate", lambda _: estimate)
    camera.heave.variance = 0.01**2
    plausibility = Plausibility(SENSOR, 0.0, 0.0)
    found = camera.measure(lines, plausibility, 10**9)
    assert found.value == 5.0
    assert found.variance == pytest.approx(1e-4 + (0.01 * 5.0) ** 2)
