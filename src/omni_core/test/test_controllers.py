"""Kinematics and odometry agree with the published equations of two controllers of ros2_control."""

from __future__ import annotations

import math

import numpy as np
import published_controllers as published
import pytest

from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.pose import PoseIntegrator
from omni_core.quantities import FloatArray

RADIUS = 0.05
SPEEDS = np.random.default_rng(3).uniform(-20.0, 20.0, (20, 4))  # [rad/s]


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.2, -0.1, 0.0), (-0.3, 0.05, 0.4)])
def test_mecanum_drive_controller(offset: tuple[float, float, float]) -> None:
    length, width = 0.31, 0.38
    x, y, angle = offset
    c, s = math.cos(angle), math.sin(angle)
    wheels = {}
    for name, along, left, roller in (
        ("front_left", 1, 1, -45.0),
        ("front_right", 1, -1, 45.0),
        ("back_right", -1, -1, -45.0),
        ("back_left", -1, 1, 45.0),
    ):
        from_x, from_y = along * length / 2 - x, left * width / 2 - y
        wheels[name] = WheelMount(
            x=c * from_x + s * from_y,
            y=c * from_y - s * from_x,
            heading_deg=-math.degrees(angle),
            roller_angle_deg=roller,
            radius=RADIUS,
        )
    kinematics = PlatformKinematics(wheels)
    for speeds in SPEEDS:
        theirs = published.mecanum_twist(speeds, RADIUS, (length + width) / 2, offset)
        np.testing.assert_allclose(kinematics.twist(speeds), theirs, rtol=1e-12, atol=1e-13)


def omni_pose(pose: FloatArray, twist: FloatArray, period: float) -> FloatArray:
    """Return the pose of `omni_wheel_drive_controller` after a period on an arc."""
    d_x, d_y, turn = twist * period
    before, after = pose[2], pose[2] + turn
    sines, cosines = math.sin(after) - math.sin(before), math.cos(after) - math.cos(before)
    moved = ((d_x * sines + d_y * cosines) / turn, (d_y * sines - d_x * cosines) / turn, turn)
    return np.asarray(pose + moved)


@pytest.mark.parametrize("count", [3, 4])
def test_omni_wheel_drive_controller(count: int) -> None:
    offset, reach, dt_ns = math.radians(30.0), 0.2, 20_000_000
    expected = np.zeros(3)
    wheels = {}
    for number in range(count):
        angle = offset + math.tau * number / count
        wheels[f"wheel_{number}"] = WheelMount(
            x=reach * math.cos(angle),
            y=reach * math.sin(angle),
            heading_deg=math.degrees(angle) % 360.0 - 90.0,
            roller_angle_deg=0.0,
            radius=RADIUS,
        )
    kinematics, pose = PlatformKinematics(wheels), PoseIntegrator()
    pose.update(0, np.zeros(3), np.zeros((3, 3)))
    for step, speeds in enumerate(SPEEDS[:, :count], 1):
        twist = kinematics.twist(speeds)
        theirs = published.omni_twist(speeds, RADIUS, reach, offset)
        np.testing.assert_allclose(twist, theirs, rtol=1e-11)
        expected = omni_pose(expected, theirs, 1e-9 * dt_ns)
        value = pose.update(step * dt_ns, twist, np.zeros((3, 3))).value
        np.testing.assert_allclose(value[:2], expected[:2], rtol=1e-9)
        assert math.remainder(value[2] - expected[2], math.tau) == pytest.approx(0, abs=1e-12)
