"""Integrated twists give the pose in closed form, and a covariance that agrees with samples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from omni_core.pose import PoseIntegrator

PERIOD_NS = 10_000_000
EXACT = np.zeros((3, 3))


def drive(twist: np.ndarray, steps: int, covariance: np.ndarray = EXACT) -> PoseIntegrator:
    integrator = PoseIntegrator()
    integrator.update(5 * PERIOD_NS, twist, covariance)  # at rest from then on
    for step in range(steps):
        integrator.update((6 + step) * PERIOD_NS, twist, covariance)
    return integrator


@pytest.mark.parametrize("steps", [1, 7, 100])
def test_a_constant_twist_is_an_arc_whatever_the_step(steps: int) -> None:
    v, w, time = 2.0, 3.0, 0.01 * steps
    pose = drive(np.array([0.0, v, w]), steps).update(0, np.zeros(3), EXACT)
    angle = w * time
    # Sideways to the left around a point ahead: the arc of radius v / w.
    expected = (v / w * (math.cos(angle) - 1.0), v / w * math.sin(angle))
    assert pose.value[:2] == pytest.approx(expected, abs=1e-12)
    assert math.remainder(pose.value[2] - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)


def test_a_gap_adds_what_the_vehicle_can_move_in_it() -> None:
    integrator = PoseIntegrator(maximum_speed=3.0, maximum_yaw_rate=2.0)
    for step in range(11):
        integrator.update((5 + step) * PERIOD_NS, np.array([1.0, 0.0, 0.0]), EXACT)
    for step in range(1000):
        pose = integrator.update((16 + step) * PERIOD_NS, np.full(3, np.nan), 1e6 * np.eye(3))
    assert pose.value == pytest.approx([0.1, 0.0, 0.0])
    # 10 s at 3 m/s and 2 rad/s, in each direction.
    assert np.diag(pose.covariance) == pytest.approx([30.0**2, 30.0**2, 20.0**2])


def test_the_covariance_is_that_of_many_noisy_drives() -> None:
    generator = np.random.default_rng(1)
    twist, deviation = np.array([3.0, -1.0, 1.2]), np.array([0.3, 0.2, 0.4])
    ends = []
    for _ in range(500):
        integrator = PoseIntegrator()
        integrator.update(0, twist, EXACT)
        for step in range(1, 31):
            noisy = twist + generator.normal(0.0, deviation)
            pose = integrator.update(step * PERIOD_NS, noisy, np.diag(deviation**2))
        ends.append(pose.value)
    np.testing.assert_allclose(pose.covariance, np.cov(np.array(ends).T), atol=1e-4, rtol=0.15)
