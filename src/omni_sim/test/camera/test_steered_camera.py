"""Cameras on steered carriers: their path over the ground, and the velocity that they measure."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor, carried_velocity, sensor_matrix, turned_mount
from omni_sim.camera.batches import carried_path

CAMERA = LineSensor(x=0.8, y=0.3, heading_deg=70.0, carrier="front", carrier_x=0.6, carrier_y=0.5)
TWIST = np.array([3.0, -0.4, 0.8])  # in the body frame
STEERING = 0.2, 0.9  # angle [rad] at the start, and rate [rad/s]


def pose_at(time: float) -> FloatArray:
    """Pose after a motion with a constant twist, by the matrix exponential."""
    turn = np.array([[0.0, -TWIST[2], TWIST[0]], [TWIST[2], 0.0, TWIST[1]], [0.0, 0.0, 0.0]])
    matrix, term = np.eye(3), np.eye(3)
    for k in range(1, 30):  # series of the matrix exponential
        term = term @ turn * (time / k)
        matrix = matrix + term
    return np.array([matrix[0, 2], matrix[1, 2], TWIST[2] * time])


def camera_at(time: float) -> FloatArray:
    """Place and heading of the camera in the world, by rotations about body and steering axis."""
    x, y, yaw = pose_at(time)
    angle = STEERING[0] + STEERING[1] * time
    about, offset = complex(0.6, 0.5), complex(0.2, -0.2)
    body = about + offset * np.exp(1j * angle)
    place = complex(x, y) + body * np.exp(1j * yaw)
    return np.array([place.real, place.imag, yaw + angle + math.radians(70.0)])


def test_a_carried_camera_follows_its_carrier() -> None:
    duration, steps = 0.1, 20
    times = np.linspace(0.0, duration, steps + 1)
    path = np.array([[*pose_at(t), *(pose_at(t + 1e-6) - pose_at(t - 1e-6)) / 2e-6] for t in times])
    angles = STEERING[0], STEERING[0] + STEERING[1] * duration
    carried = carried_path(path, CAMERA, angles, duration)
    for row, time in zip(carried, times, strict=True):
        cos, sin = math.cos(row[2]), math.sin(row[2])
        place = row[:2] + np.array([[cos, -sin], [sin, cos]]) @ [CAMERA.x, CAMERA.y]
        np.testing.assert_allclose([*place, row[2] + CAMERA.heading], camera_at(time), atol=1e-9)
    slope = (carried[2:, :3] - carried[:-2, :3]) / (2.0 * duration / steps)
    np.testing.assert_allclose(carried[1:-1, 3:], slope, atol=2e-3)


def test_measured_velocity_is_that_of_the_camera_along_its_axis() -> None:
    time, step = 0.07, 1e-5
    velocity = (camera_at(time + step) - camera_at(time - step))[:2] / (2.0 * step)
    heading = camera_at(time)[2]
    along = velocity @ [math.cos(heading), math.sin(heading)]
    turned = turned_mount(CAMERA, STEERING[0] + STEERING[1] * time)
    (row,) = sensor_matrix({"camera": turned})
    (own,) = carried_velocity(turned, STEERING[1])
    assert row @ TWIST + own == pytest.approx(along, abs=1e-6)
