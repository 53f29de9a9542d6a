"""Error surfaces as comma-separated values, and what they amount to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omni_analysis.figures.data_table import write_table
from omni_analysis.line_trials.errors import ERROR_COLUMNS
from omni_analysis.line_trials.texture_trials import Shifts
from omni_analysis.line_trials.view_grid import LENGTHS, SHAPES
from omni_analysis.loop.metrics import Metric

_OVERLAP = 0.6  # from which on views count


def surface_metrics(
    case: str, found: Sequence[Shifts], overlap: NDArray[np.float64]
) -> dict[str, Metric]:
    """Return mean error, wrong and flagged share over the views with 60 % overlap or more.

    Args:
        case: ends the names of the metrics.
        found: by the shapes of `texture_trials.shape_grid`.
        overlap: of consecutive lines, shape (shapes, lengths), 0..1.
    """
    enough = [f for f, o in zip(found, overlap.flat, strict=True) if o >= _OVERLAP]
    return {
        f"mean_error.{case}": Metric(float(np.mean([f.mean_error for f in enough])), "px"),
        f"wrong_share.{case}": Metric(float(np.mean([f.wrong_share for f in enough])), "1"),
        f"flagged_share.{case}": Metric(float(np.mean([f.flagged_share for f in enough])), "1"),
    }


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
    shapes = [(shape, length) for shape in SHAPES for length in LENGTHS]
    rows: Iterator[tuple[str | float, ...]] = (
        (
            *case, 1e3 * length, shape, common, shifts.truth, shifts.flagged_share,
            shifts.wrong_share, *shifts.errors,
        )
        for case, found in surfaces.items()
        for (shape, length), common, shifts in zip(shapes, overlap.flat, found, strict=True)
    )  # fmt: skip
    return write_table(path, header, rows, digits=6)
