"""Trials in which a camera moves sideways, for many fields of view (Figures 63, 64 and 71).

`sideways_motions` returns one motion for each length and width of the field of view.
`matches_table` returns a table with the displacements measured in these motions and their errors.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from omni_core.quantities import FloatArray
from omni_tools.line_trials import rig, trials

LENGTHS = tuple(0.01 * i for i in range(1, 8))
"""Lengths of the field of view [m]."""

SHAPES = tuple(0.1 * i for i in range(1, 11))
"""Ratios of width to length [1]."""

GROUP = 10
"""Number n of consecutive displacements in the median filter (section 4.6)."""

MOTION = trials.ViewMotion(rig.View(), 12.0, math.radians(89.0))
"""Motion at 12 m/s, almost perpendicular (89 deg) to the camera's axis."""


def sideways_motions(axis: float = 0.0) -> list[trials.ViewMotion]:
    """Return `MOTION` for all shapes and lengths of the field of view.

    `axis` is the angle of the camera's axis on the ground [rad].
    """
    return [
        MOTION._replace(view=rig.View(length=length, width=shape * length), axis=axis)
        for shape in SHAPES
        for length in LENGTHS
    ]


def needed_overlap(overlap: FloatArray, right: FloatArray, share: float = 0.95) -> float:
    """Return the smallest sufficient overlap.

    An overlap is sufficient if all fields of view with this or a larger overlap have the required
    share of correct line pairs.

    Args:
        overlap: overlap of consecutive lines for each field of view, 0 to 1, any shape.
        right: share of line pairs with a correct displacement for each field of view, 0 to 1, same
            shape.
        share: required share of correct line pairs, 0 to 1.

    Returns:
        One of the given overlaps; NaN if even the largest one is not sufficient.
    """
    failing = overlap[right < share]
    passing = overlap[overlap > (failing.max() if len(failing) else -1.0)]
    return float(passing.min()) if len(passing) else math.nan


def matches_table(
    names: tuple[str, ...],
    motions: Sequence[trials.ViewMotion],
    cases: Mapping[Any, Sequence[trials.Matches]],
) -> tuple[tuple[str, ...], Iterator[tuple[str | float, ...]]]:
    """Return the header of a table, and an iterator over its rows, one for each case and motion.

    Args:
        names: names of the columns that contain the parts of a case.
        motions: the motions.
        cases: matches for each motion, keyed by case; a case is a tuple of parts, such as ground
            and noise.
    """
    header = (
        *names, "speed_m_per_s", "length_mm", "width_over_length", "overlap",
        "true_displacement_px", "right_share", "exact_share", "usable_share",
        "undetected_share", "median_error_px", "median_right_share", *trials.ERROR_COLUMNS,
    )  # fmt: skip
    return header, (
        (*case, *_row(motion, m))
        for case, found in cases.items()
        for motion, m in zip(motions, found, strict=True)
    )


def _row(motion: trials.ViewMotion, m: trials.Matches) -> tuple[float, ...]:
    view = motion.view
    medians = math.nan, math.nan
    if len(m.shift) >= GROUP:
        medians = float(np.mean(np.abs(m.median_error(GROUP)))), m.right_medians(GROUP)
    return (
        motion.speed, 1e3 * view.length, view.width / view.length, motion.overlap,
        float(m.truth[0]), float(np.mean(m.right)), float(np.mean(m.pixel_error == 0.0)),
        float(np.mean(m.usable)), m.undetected_share, *medians,
        *m.error_values(view, motion.speed),
    )  # fmt: skip
