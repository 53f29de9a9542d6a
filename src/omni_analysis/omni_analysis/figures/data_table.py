"""Columns of numbers as a CSV file: the data behind a figure."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from omni_analysis.loop.history import RunHistory


def write_table(columns: Mapping[str, Any], path: Path) -> Path:
    """Write columns of equal length under their names, numbers with six digits.

    Args:
        columns: texts or numbers by ``name [unit]``.
        path: of the file.

    Raises:
        ValueError: the lengths differ.
    """
    cells = [[_text(value) for value in np.asarray(column).tolist()] for column in columns.values()]
    rows = zip(*cells, strict=True)
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
    return path


def history_columns(history: RunHistory, *, errors: bool = True) -> dict[str, Any]:
    """Return what the dissertation's figures show of a run: time, velocities and errors.

    Args:
        history: the run.
        errors: whether the errors are among it.
    """
    columns: dict[str, Any] = {
        "time [s]": history.time,
        "v_x [m/s]": history.twist[:, 0],
        "v_y [m/s]": history.twist[:, 1],
        "yaw rate [rad/s]": history.twist[:, 2],
    }
    if errors:
        for column, name in enumerate(history.wheel_names):
            columns[f"s {name} [m/s]"] = history.error[:, column]
    return columns


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
