"""Functions that write CSV tables, such as the data of a figure."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

TIME = "time since braking [s]"


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


def write_records(path: Path, records: Sequence[Any]) -> Path:
    """Write records of one type as rows below the names and units of their fields.

    Args:
        path: path of the file.
        records: at least one instance of a `NamedTuple`, which declares its numbers with their
            units, as ``speed: Annotated[float, "m/s"]``.
    """
    hints = get_type_hints(type(records[0]), include_extras=True)
    units = {name: getattr(hint, "__metadata__", None) for name, hint in hints.items()}
    header = [f"{name} [{unit[0]}]" if unit else name for name, unit in units.items()]
    return write_table(path, header, records)


def write_columns(path: Path, columns: Mapping[str, Any]) -> Path:
    """Write columns of equal length below their names, numbers with six digits.

    Args:
        path: path of the file.
        columns: texts or numbers by ``name [unit]``.

    Raises:
        ValueError: the lengths differ.
    """
    cells = (np.asarray(column).tolist() for column in columns.values())
    return write_table(path, columns, zip(*cells, strict=True), digits=6)
