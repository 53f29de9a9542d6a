"""Interpolation of poses between the physics steps to the times of the lines."""

import numpy as np

from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

_SLACK = 1e-6  # share of a step by which rounded times may be outside


def interpolate_poses(
    trajectory: FloatArray, start_ns: float, step_ns: float, times_ns: FloatArray
) -> FloatArray:
    """Return poses between physics steps by cubic Hermite interpolation.

    The path has the given position and velocity at every step, so it is smooth. The error is of
    fourth order in the step: at a step of 0.5 ms, an error of a micrometer would require a fourth
    derivative of 6e9 m/s^4.

    Args:
        trajectory: x, y, yaw [m, m, rad] and their time derivatives in the world frame at uniform
            steps, shape (n + 1, 6); yaw is continuous, not wrapped. A single row is valid only for
            its own time.
        start_ns: time of the first row [ns].
        step_ns: time between rows [ns].
        times_ns: times of the requested poses [ns], shape (m,).

    Returns:
        x, y, yaw, shape (m, 3) [m, m, rad].

    Raises:
        ValueError: a time is outside the trajectory.
    """
    poses = np.empty((len(times_ns), 3))
    rows = np.ascontiguousarray(trajectory)
    if not _interpolate(rows, float(start_ns), float(step_ns), times_ns, poses):
        raise ValueError(
            f"times from {times_ns.min()} ns to {times_ns.max()} ns are outside the trajectory, "
            f"{start_ns} ns to {start_ns + (len(trajectory) - 1) * step_ns} ns"
        )
    return poses


@lean
def _interpolate(
    trajectory: FloatArray, start_ns: float, step_ns: float, times_ns: FloatArray, poses: FloatArray
) -> bool:
    """Write the poses; return whether all times are within the trajectory."""
    steps = len(trajectory) - 1
    step = step_ns * 1e-9
    for i in range(len(times_ns)):
        place = (times_ns[i] - start_ns) / step_ns
        if not -_SLACK <= place <= steps + _SLACK:
            return False
        index = max(min(int(place), steps - 1), 0)
        t = place - index
        before, after = trajectory[index], trajectory[min(index + 1, steps)]
        # Hermite basis functions of value and slope at both ends.
        rise = t * t * (3.0 - 2.0 * t)
        slope = step * t * (1.0 - t)
        for k in range(3):
            value = before[k] + rise * (after[k] - before[k])
            poses[i, k] = value + slope * ((1.0 - t) * before[3 + k] - t * after[3 + k])
    return True


def interpolate_velocities(
    trajectory: FloatArray, start_ns: float, step_ns: float, times_ns: FloatArray
) -> FloatArray:
    """Return velocities between physics steps by linear interpolation.

    Args:
        trajectory: as in `interpolate_poses`.
        start_ns: time of the first row [ns].
        step_ns: time between rows [ns].
        times_ns: times of the requested velocities [ns], shape (m,).

    Returns:
        Time derivatives of x, y, yaw in the world frame [m/s, m/s, rad/s], shape (m, 3).
    """
    place = (np.asarray(times_ns, dtype=np.float64) - start_ns) / step_ns
    rows = np.arange(len(trajectory))
    return np.column_stack([np.interp(place, rows, trajectory[:, 3 + i]) for i in range(3)])
