"""Kinematics and odometry agree with the published equations of two controllers of ros2_control."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omni_core.geometry import WheelMount
from omni_core.kinematics import PlatformKinematics
from omni_core.pose import PoseIntegrator
from omni_core.quantities import FloatArray

RADIUS = 0.05
SPEEDS = np.random.default_rng(3).uniform(-20.0, 20.0, (20, 4))  # [rad/s]


def mecanum_drive_controller(
    speeds: FloatArray, radius: float, projections: float, offset: tuple[float, float, float]
) -> FloatArray:
    """Return the twist of `base_link`.

    Args:
        speeds: speeds of front left, back left, back right, front right [rad/s], shape (4,).
        radius: `kinematics.wheels_radius` [m].
        projections: `kinematics.sum_of_robot_center_projection_on_X_Y_axis` [m].
        offset: `kinematics.base_frame_offset`: x, y [m] and angle [rad] of base_link at the center.
    """
    signs = np.array([[1, 1, 1, 1], [-1, 1, -1, 1], [-1, -1, 1, 1]])
    v_x, v_y, rate = 0.25 * radius * (signs @ speeds) / (1.0, 1.0, projections)
    x, y, angle = offset
    c, s = math.cos(angle), math.sin(angle)
    at_x, at_y = v_x - rate * y, v_y + rate * x
    return np.array([c * at_x + s * at_y, c * at_y - s * at_x, rate])


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.2, -0.1, 0.0), (-0.3, 0.05, 0.4)])
def test_mecanum_drive_controller(offset: tuple[float, float, float]) -> None:
    length, width = 0.31, 0.38
    x, y, angle = offset
    c, s = math.cos(angle), math.sin(angle)
    wheels = {}
    for name, along, left, roller in (
        ("front_left", 1, 1, -45.0),
        ("back_left", -1, 1, 45.0),
        ("back_right", -1, -1, -45.0),
        ("front_right", 1, -1, 45.0),
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
        published = mecanum_drive_controller(speeds, RADIUS, (length + width) / 2, offset)
        np.testing.assert_allclose(kinematics.twist(speeds), published, rtol=1e-12, atol=1e-13)


class OmniWheelDriveController:
    """Odometry of `omni_wheel_drive_controller`, and its pose x, y [m], heading [rad]."""

    def __init__(self, wheels: int, offset: float, reach: float) -> None:
        angle = offset + math.tau * np.arange(wheels) / wheels
        self.rows = np.column_stack((np.sin(angle), -np.cos(angle), np.full(wheels, -reach)))
        self.pose = np.zeros(3)

    def update(self, speeds: FloatArray, dt: float) -> FloatArray:
        """Integrate wheel speeds [rad/s] over a time [s] on an arc; return the twist."""
        twist, *_ = np.linalg.lstsq(self.rows, RADIUS * speeds, rcond=None)
        d_x, d_y, turn = twist * dt
        before, after = self.pose[2], self.pose[2] + turn
        sines, cosines = math.sin(after) - math.sin(before), math.cos(after) - math.cos(before)
        self.pose += [
            (d_x * sines + d_y * cosines) / turn,
            (d_y * sines - d_x * cosines) / turn,
            turn,
        ]
        return np.asarray(twist)


@pytest.mark.parametrize("count", [3, 4])
def test_omni_wheel_drive_controller(count: int) -> None:
    offset, reach, dt_ns = math.radians(30.0), 0.2, 20_000_000
    published = OmniWheelDriveController(count, offset, reach)
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
        np.testing.assert_allclose(twist, published.update(speeds, 1e-9 * dt_ns), rtol=1e-11)
        value = pose.update(step * dt_ns, twist, np.zeros((3, 3))).value
        np.testing.assert_allclose(value[:2], published.pose[:2], rtol=1e-9)
        assert math.remainder(value[2] - published.pose[2], math.tau) == pytest.approx(0, abs=1e-12)
