"""Sideways motion over the two dimensions of the field of view (Figures 63, 64 and 71)."""

import dataclasses
import math

from omni_platform.quantities import FloatArray
from omni_tools.line_trials import rig, trials

LENGTHS = tuple(0.01 * i for i in range(1, 8))
"""Lengths of the field of view [m]."""

SHAPES = tuple(0.1 * i for i in range(1, 11))
"""Widths over lengths [1]."""

GROUP = 10
"""n of the median filter over consecutive displacements (section 4.6)."""

MOTION = trials.Motion(rig.View(), 12.0, math.radians(89.0))
"""Sideways motion at 12 m/s, at 89 deg to the axis of the camera."""


def sideways_motions(axis: float = 0.0) -> list[trials.Motion]:
    """Return 12 m/s at 89 deg to an axis [rad], 2500 lines/s, for every shape and length."""
    return [
        dataclasses.replace(MOTION, view=rig.View(length=length, width=shape * length), axis=axis)
        for shape in SHAPES
        for length in LENGTHS
    ]


def needed_overlap(overlap: FloatArray, right: FloatArray, share: float = 0.95) -> float:
    """Return the smallest overlap above which every view has at least a share of right pairs.

    Args:
        overlap: overlap of each view.
        right: share of its pairs that are right.
        share: required share.

    Returns:
        The overlap, NaN if there is none.
    """
    failing = overlap[right < share]
    passing = overlap[overlap > (failing.max() if len(failing) else -1.0)]
    return float(passing.min()) if len(passing) else math.nan
