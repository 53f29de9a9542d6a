"""Tables of studies as CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path


def write_table(
    path: Path, header: Sequence[str], rows: Iterable[Sequence[str | int | float]], digits: int = 9
) -> Path:
    """Write a table and return its path.

    Args:
        path: of the file.
        header: names of the columns.
        rows: texts and integers, which are written as they are, and other numbers.
        digits: significant ones of the other numbers.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for row in rows:
            writer.writerow(
                x if isinstance(x, str | int) else f"{float(x):.{digits}g}" for x in row
            )
    return path
