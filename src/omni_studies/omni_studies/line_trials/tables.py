"""Matches over many views as comma-separated values."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omni_figures.data_table import write_table
from omni_studies.line_trials.view_grid import GROUP
from omni_tools.line_trials import errors, trials


def write_matches(
    path: Path,
    names: tuple[str, ...],
    motions: Sequence[trials.Motion],
    cases: Mapping[Any, Sequence[trials.Matches]],
) -> Path:
    """Write one row for every case and motion.

    Args:
        path: path of the file.
        names: column names of the parts of a case.
        motions: the motions.
        cases: the matches of each motion, by case: a tuple of its parts.
    """
    header = (
        *names, "speed_m_per_s", "length_mm", "width_over_length", "overlap",
        "true_displacement_px", "right_share", "exact_share", "usable_share",
        "undetected_share", "median_error_px", "median_right_share", *errors.ERROR_COLUMNS,
    )  # fmt: skip
    rows: Iterator[tuple[str | float, ...]] = (
        (*case, *_row(motion, m))
        for case, found in cases.items()
        for motion, m in zip(motions, found, strict=True)
    )
    return write_table(path, header, rows, digits=6)


def _row(motion: trials.Motion, m: trials.Matches) -> tuple[float, ...]:
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
