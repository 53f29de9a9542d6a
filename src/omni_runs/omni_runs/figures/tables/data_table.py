"""Writing of CSV tables, such as the data of a figure."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_table(
    path: Path, header: Iterable[str], rows: Iterable[Sequence[str | int | float]], digits: int = 9
) -> Path:
    """Write a table and return its path.

    Args:
        path: path of the file.
        header: names of the columns.
        rows: cells of each row; texts and integers are written unchanged.
        digits: number of significant digits of all other numbers.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for row in rows:
            writer.writerow(
                x if isinstance(x, str | int) else f"{float(x):.{digits}g}" for x in row
            )
    return path


def write_cases(path: Path, head: str, cases: Mapping[str, Mapping[str, Any]]) -> Path:
    """Write a table with a row for each case, and a column for each name that any case contains.

    Args:
        path: path of the file.
        head: heading of the first column, which contains the names of the cases.
        cases: values of each case, keyed by case and then by column name.
    """
    names = list(dict.fromkeys(name for entries in cases.values() for name in entries))
    rows = ([case, *(own.get(name, "") for name in names)] for case, own in cases.items())
    return write_table(path, [head, *names], rows)


def write_lines(path: Path, figure: Figure) -> Path:
    """Write the finite points of all lines of a figure as a table, and return its path.

    Unlabeled lines with at most two finite points, such as axes and limits, are omitted.

    Args:
        path: path of the file.
        figure: the figure; the first column of the table names each panel by its title or, without
            a title, by the label of its vertical axis.
    """
    rows: list[tuple[str, str, float, float]] = []
    for axes in figure.axes:
        panel = (axes.get_title(loc="left") or axes.get_ylabel()).replace("\n", " ")
        for line in axes.get_lines():
            name, points = str(line.get_label()), np.asarray(line.get_xydata()).tolist()
            name = "" if name.startswith("_") else name
            known = [point for point in points if np.isfinite(point).all()]
            rows += [(panel, name, x, y) for x, y in known if name or len(known) > 2]
    return write_table(path, ("panel", "line", "x", "y"), rows, digits=6)
