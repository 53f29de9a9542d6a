"""The edge of a shadow that runs through the view is not taken for the ground."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from linescan_odometry.measurements import LineBatch
from linescan_odometry.odometry import OdometryConfiguration
from linescan_odometry.sensor import SensorOdometry
from linescan_odometry.view.sharp import sharp_pixels, sharpened
from omni_platform.sensors import LineSensor

PIXELS, RATE, LINES = 512, 2500.0, 26
CAMERA = LineSensor(x=0.6, y=0.0, heading_deg=90.0, pixels=PIXELS)
OTHERS = {
    "left": LineSensor(x=0.0, y=0.5, heading_deg=0.0),
    "right": LineSensor(x=0.0, y=-0.5, heading_deg=0.0),
}


def seen(step: float, shadow_step: float) -> NDArray[np.uint8]:
    """Return lines of a faint ground that moves, in a shadow whose soft edge moves otherwise."""
    generator = np.random.default_rng(3)
    ground = gaussian_filter1d(generator.normal(0.0, 1.0, 3000), 1.5)
    ground *= 4.0 / ground.std()
    number, place = np.arange(LINES)[:, None], np.arange(PIXELS)
    gray = 140.0 + np.interp(1000.0 + step * number + place, np.arange(3000), ground)
    edge = 250.0 - shadow_step * number
    gray *= 1.0 - 0.6 * np.clip((place - edge) / 30.0 + 0.5, 0.0, 1.0)
    noisy = np.rint(gray + generator.normal(0.0, 0.7, gray.shape))
    lines: NDArray[np.uint8] = noisy.clip(0, 255).astype(np.uint8)
    return lines


@pytest.mark.parametrize("step", [12.0, -20.0, 45.0])
@pytest.mark.parametrize("shadow_step", [2.0, -3.0])
def test_the_ground_is_measured_and_not_the_shadow(step: float, shadow_step: float) -> None:
    settings = OdometryConfiguration(sensors={"eye": CAMERA, **OTHERS}, flat_field_places=0)
    odometry = SensorOdometry(CAMERA, settings)
    lines = seen(step, shadow_step)
    raw = odometry._matcher.match(lines)
    assert float(np.median(raw.displacement)) == pytest.approx(shadow_step, abs=1.0)
    reading = odometry.update(LineBatch(round(1e9 * LINES / RATE), lines))
    if reading.measured:
        assert reading.velocity == pytest.approx(step * CAMERA.pixel_pitch * RATE, rel=0.01)
    else:
        assert "two displacements in the view" in reading.reason


@pytest.mark.parametrize("step", [2, 5])
def test_a_ramp_of_light_has_no_detail(step: int) -> None:
    ramp = np.rint(np.linspace(0.0, 60000.0, PIXELS)).astype(np.uint16)
    sharp = sharpened(ramp[None, :], step)
    assert sharp.shape == (1, sharp_pixels(PIXELS, step))
    ground = np.random.default_rng(1).integers(0, 2000, PIXELS).astype(np.uint16)
    with_ramp = sharpened((ground + ramp)[None, :], step).astype(np.float64)[0]
    alone = sharpened(ground[None, :], step).astype(np.float64)[0]
    assert np.corrcoef(with_ramp, alone)[0, 1] > 0.99
