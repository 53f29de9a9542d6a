"""Ground beside a bar of shadow, which is far more visible and moves with its own velocity."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from linescan_odometry.joint.estimator import Estimate, JointEstimator
from omni_core.sensors import LineSensor

LINES, PIXELS = 26, 1024
CAMERA = LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=PIXELS)
GROUND, SHADOW = 12.3, -4.6  # px by which the views of both shift from line to line


def _estimate(contrast: float, depth: float) -> Estimate:
    """Return the displacement over a ground [gray levels] with a bar of shadow [1]."""
    generator = np.random.default_rng(8)
    ground = gaussian_filter1d(generator.normal(0.0, 1.0, 2 * PIXELS), 4.0)
    ground *= contrast / ground.std()
    place = np.arange(PIXELS)
    lines: list[NDArray[Any]] = []
    for k in range(LINES):
        seen = np.interp(place + 400.0 - GROUND * k, np.arange(2 * PIXELS), ground)
        edge = np.abs(place - 500.0 - SHADOW * k)
        shaded = 1.0 - depth / (1.0 + np.exp((edge - 100.0) / 10.0))
        lines.append((120.0 + seen) * shaded + generator.normal(0.0, 1.0, PIXELS))
    levels = np.rint(lines).clip(0, 255).astype(np.uint8)
    return JointEstimator(CAMERA, PIXELS // 2).estimate(levels)


@pytest.mark.parametrize("depth", [0.0, 0.5])
def test_a_bar_of_shadow_is_no_rival_of_the_ground_that_it_moves_over(depth: float) -> None:
    estimate = _estimate(1.0, depth)
    assert not estimate.reason
    assert abs(estimate.value + GROUND) < max(4.0 * math.sqrt(estimate.variance), 0.1)


def test_a_bar_of_shadow_over_a_smooth_ground_is_no_motion_of_the_ground() -> None:
    assert _estimate(0.0, 0.3).reason
