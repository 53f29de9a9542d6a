"""Uniform motion, and the batches of lines of cameras in this motion."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch
from omni_tools.line_trials.rig import Rig, ground, poses_at
from omni_tools.placement.mounting_area import tangential


@pytest.mark.parametrize("twist", [(2.0, -1.0, 3.0), (1.0, 0.5, 1e-9), (0.0, 0.0, -2.0)])
def test_constant_twist_moves_on_an_arc(twist: tuple[float, float, float]) -> None:
    start, time = np.array([0.3, -0.2, 0.8]), np.linspace(0.0, 1.5, 16)
    poses = poses_at(time, start, np.array(twist))
    steps = 2000
    x, y, yaw = start
    dt = time[-1] / steps
    for _ in range(steps):  # midpoint rule
        middle = yaw + 0.5 * dt * twist[2]
        x += dt * (math.cos(middle) * twist[0] - math.sin(middle) * twist[1])
        y += dt * (math.sin(middle) * twist[0] + math.cos(middle) * twist[1])
        yaw += dt * twist[2]
    assert poses[0] == pytest.approx(start)
    assert poses[-1] == pytest.approx((x, y, yaw), abs=1e-6)


def test_batches_in_a_row_are_one_motion() -> None:
    sensors = tangential(
        0.6, LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=64, length=0.05, width=0.02)
    )
    sensors["camera_1"] = dataclasses.replace(sensors["camera_1"], line_rate=1000.0)
    start, twist = np.array([0.03, 0.05, 0.4]), np.array([3.0, 1.0, 0.5])

    def batches(*ends: int) -> list[dict[str, LineBatch]]:
        rig = Rig(sensors, ground("cork", 1024), 1.0, seed=2)
        return [
            rig.expose(start, twist, dict.fromkeys(sensors, np.arange(*span)), 500)
            for span in itertools.pairwise(ends)
        ]

    (whole,), parts = batches(0, 20), batches(0, 1, 9, 20)
    for name, sensor in sensors.items():
        lines = np.concatenate([part[name].lines for part in parts])
        np.testing.assert_array_equal(lines, whole[name].lines)
        assert parts[-1][name].stamp_ns == whole[name].stamp_ns
        assert parts[1][name].stamp_ns == 500 + round(8e9 / sensor.line_rate)
