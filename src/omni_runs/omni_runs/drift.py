"""Drift of the odometry: absolute and relative error of the estimated path.

The estimated path is the integral of the twists that the odometry measured. It begins at the same
pose as the true path. The definitions are those of the library `evo`: ``evo_ape`` with aligned
origins, and ``evo_rpe --delta 1 --delta_unit m --pairs_from_reference`` with consecutive pairs. If
the library is installed (``requirements/evo.lock``), a test compares the results.
"""

import math

import numpy as np

from omni_core.geometry import turned
from omni_core.pose import PoseIntegrator
from omni_core.quantities import FloatArray
from omni_runs.history import RunHistory
from omni_runs.metrics import NO_ODOMETRY, Metric

DELTA = 1.0
"""Length of a path segment for the relative error [m]."""

_SHORT = f"the path is shorter than {DELTA:g} m"


def odometry_path(history: RunHistory) -> FloatArray:
    """Return the integral of the measured twists: x, y, yaw [m, m, rad], shape (T, 3).

    The path begins at the true pose. As in the odometry node, a twist that was not measured is
    integrated as zero.
    """
    integrator = PoseIntegrator()
    unknown = np.zeros((3, 3))
    stamped = zip(map(int, history.stamp_ns), history.estimate, strict=True)
    path = np.array([integrator.update(stamp, twist, unknown).value for stamp, twist in stamped])
    *place, yaw = history.pose[0]
    return np.column_stack((place + turned(path[:, :2], yaw), yaw + path[:, 2]))


def absolute_error(truth: FloatArray, path: FloatArray) -> float:
    """Return the root mean square distance [m] of two paths, shape (T, 3), at the same stamps."""
    return float(np.sqrt(np.mean(np.sum((path[:, :2] - truth[:, :2]) ** 2, axis=1))))


def relative_error(truth: FloatArray, path: FloatArray, delta: float = DELTA) -> tuple[float, int]:
    """Return the error of an estimated path over segments of `delta` along the true path.

    Args:
        truth: true poses x, y, yaw [m, m, rad], shape (T, 3).
        path: estimated poses x, y, yaw at the same stamps [m, m, rad], shape (T, 3).
        delta: length of a segment [m].

    Returns:
        Root mean square of the translation error at the end of a segment [m], NaN if there is no
        segment; number of segments.
    """
    steps = np.hypot(*np.diff(truth[:, :2], axis=0).T)
    pairs, first, distance = [], 0, 0.0
    for index, step in enumerate(steps.tolist(), 1):
        distance += step
        if distance >= delta:
            pairs.append((first, index))
            first, distance = index, 0.0
    if not pairs:
        return math.nan, 0
    begins, ends = np.array(pairs).T
    error, true = (
        turned(poses[ends, :2] - poses[begins, :2], -poses[begins, 2]) for poses in (path, truth)
    )
    # The translation of true^-1 * error has the length of the difference of both translations.
    return float(np.sqrt(np.mean(np.sum((error - true) ** 2, axis=1)))), len(pairs)


def drift_metrics(history: RunHistory) -> dict[str, Metric]:
    """Return the metrics ``odometry_ate`` and ``odometry_rpe``: absolute and relative error [m]."""
    absolute, relative, notes = math.nan, math.nan, (NO_ODOMETRY, NO_ODOMETRY)
    if np.any(history.measured):
        path = odometry_path(history)
        absolute = absolute_error(history.pose, path)
        relative, pieces = relative_error(history.pose, path)
        notes = "", "" if pieces else _SHORT
    return {
        "odometry_ate": Metric(absolute, "m", note=notes[0]),
        "odometry_rpe": Metric(relative, "m", note=notes[1]),
    }
