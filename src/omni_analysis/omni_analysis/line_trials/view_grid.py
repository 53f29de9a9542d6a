"""Sideways motion over the two dimensions of the field of view (Figures 63, 64 and 71)."""

from __future__ import annotations

import math

import numpy as np

from omni_analysis.line_trials.trials import Matches, Motion, View
from omni_platform.quantities import FloatArray

LENGTHS = tuple(0.01 * i for i in range(1, 8))
"""Of the field of view [m]."""

SHAPES = tuple(0.1 * i for i in range(1, 11))
"""Widths over lengths [1]."""

_SPEED = 12.0  # m/s
_ANGLE = math.radians(89.0)


def sideways_motions() -> list[Motion]:
    """Return 12 m/s at 89 deg with 2500 lines/s for every shape, then every length."""
    return [
        Motion(View(length=length, width=shape * length), _SPEED, _ANGLE)
        for shape in SHAPES
        for length in LENGTHS
    ]


def as_map(values: list[float]) -> FloatArray:
    """Arrange values of `sideways_motions` as a map, shape (shapes, lengths)."""
    return np.array(values).reshape(len(SHAPES), len(LENGTHS))


def mean_error(matches: Matches) -> float:
    """Return the mean magnitude of the error in whole pixels, Eq. (84)."""
    return float(np.mean(np.abs(matches.pixel_error)))


def filtered_error(matches: Matches, group: int) -> FloatArray:
    """Return the errors in whole pixels of medians of consecutive shifts (section 4.6).

    Args:
        matches: of consecutive pairs.
        group: n of the median; what is left over at the end is not used.
    """
    count = len(matches.shift) // group * group
    median = np.median(matches.shift[:count].reshape(-1, group), axis=1)
    truth = np.mean(matches.truth[:count].reshape(-1, group), axis=1)
    # As in `Matches.pixel_error`, either rounding of a truth near a half is right.
    return np.where(np.abs(median - truth) <= 0.55, 0.0, median - np.round(truth))


def filtered_right(matches: Matches, group: int) -> float:
    """Return the share of `filtered_error` within a pixel, as `Matches.right` counts."""
    return float(np.mean(np.abs(filtered_error(matches, group)) <= 1.0))


def needed_overlap(overlap: FloatArray, right: FloatArray, share: float = 0.95) -> float:
    """Return the overlap from which on every view is right in at least a share of its pairs.

    Args:
        overlap: of each view.
        right: share of its pairs that are right.
        share: that is asked for.

    Returns:
        The smallest overlap above that of all views that are not; NaN if there is none.
    """
    failing = overlap[right < share]
    passing = overlap[overlap > (failing.max() if len(failing) else -1.0)]
    return float(passing.min()) if len(passing) else math.nan
