"""Interpolated poses agree with the path between the physics steps."""

from __future__ import annotations

import numpy as np
import pytest

from omni_core.quantities import FloatArray
from omni_sim.camera.batches import interpolate_poses

STEP_NS = 500_000


def circle(time: FloatArray) -> FloatArray:
    radius, rate = 3.0, 2.0
    angle = rate * time
    speed = radius * rate
    return np.column_stack(
        (
            radius * np.cos(angle),
            radius * np.sin(angle),
            angle,
            -speed * np.sin(angle),
            speed * np.cos(angle),
            np.full_like(angle, rate),
        )
    )


def test_a_cubic_path_is_met_exactly() -> None:
    value = np.array([[1.0, -2.0, 0.3], [4.0, 5.0, -6.0], [70.0, -80.0, 90.0], [1e3, 2e3, -3e3]])

    def path(time: FloatArray) -> FloatArray:
        powers = np.column_stack([time**i for i in range(4)])
        slopes = np.column_stack([i * time ** max(i - 1, 0) for i in range(4)])
        return np.hstack((powers @ value, slopes @ value))

    start = 1_000_000_000
    steps = np.linspace(0.0, 20 * STEP_NS * 1e-9, 21)
    times = np.linspace(0.0, 20 * STEP_NS, 77)
    got = interpolate_poses(path(steps), start, STEP_NS, start + times)
    np.testing.assert_allclose(got, path(times * 1e-9)[:, :3], rtol=0.0, atol=1e-12)


def test_halving_the_step_divides_the_error_by_sixteen() -> None:
    errors = []
    for step in (0.02, 0.01):
        time = np.linspace(0.0, 1.0, round(1.0 / step) + 1)
        wanted = np.linspace(0.0, 1.0, 1001)
        got = interpolate_poses(circle(time), 0, step * 1e9, wanted * 1e9)
        errors.append(np.abs(got - circle(wanted)[:, :3])[:, :2].max())
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.05)


def test_a_resting_start_serves_its_own_instant() -> None:
    start = np.array([[1.0, 2.0, 3.0, 0.0, 0.0, 0.0]])
    got = interpolate_poses(start, 0, STEP_NS, np.array([0.0]))
    np.testing.assert_array_equal(got, [[1.0, 2.0, 3.0]])


@pytest.mark.parametrize("time", [-1000.0, 20.0 * STEP_NS + 1000.0, float("nan")])
def test_nothing_is_extrapolated(time: float) -> None:
    trajectory = circle(np.linspace(0.0, 20 * STEP_NS * 1e-9, 21))
    with pytest.raises(ValueError, match="outside the trajectory"):
        interpolate_poses(trajectory, 0, STEP_NS, np.array([time]))
