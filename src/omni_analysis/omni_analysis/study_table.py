"""Error surfaces as comma-separated values."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omni_analysis.displacement_errors import ERROR_COLUMNS
from omni_analysis.texture_trials import Shifts
from omni_analysis.view_grid import LENGTHS, SHAPES


def write_surfaces(
    names: tuple[str, str],
    surfaces: Mapping[tuple[str, str], list[Shifts]],
    overlap: NDArray[np.float64],
    path: Path,
) -> Path:
    """Write one row for every case and shape of the field of view.

    Args:
        names: what the two words of a case are called.
        surfaces: what the shapes of `texture_trials.shape_grid` found, by case.
        overlap: of consecutive lines, shape (shapes, lengths), 0..1.
        path: of the file.
    """
    header = (
        *names, "length_mm", "width_over_length", "overlap", "true_displacement_px",
        "flagged_share", "wrong_share", *ERROR_COLUMNS,
    )  # fmt: skip
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for case, found in surfaces.items():
            shapes = [(shape, length) for shape in SHAPES for length in LENGTHS]
            for (shape, length), common, shifts in zip(shapes, overlap.flat, found, strict=True):
                numbers = (
                    1e3 * length, shape, common, shifts.truth, shifts.flagged_share,
                    shifts.wrong_share, *shifts.errors,
                )  # fmt: skip
                writer.writerow((*case, *(f"{value:.6g}" for value in numbers)))
    return path
