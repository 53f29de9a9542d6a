"""Text files and tables that a user names, and folders in which the user can write."""

import contextlib
import csv
import errno
import math
import os
import stat
import tempfile
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path


def read_text(path: Path, encoding: str = "utf-8-sig") -> str:
    """Return the content of a text file; by default UTF-8, without a byte order mark.

    Raises:
        OSError: the file cannot be read, or is a pipe, a device or another special file;
            `strerror` is the reason.
        ValueError: the file is not text in this encoding.
    """
    # Opening a pipe would wait forever, and reading a device would never end.
    mode = path.stat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    try:
        return path.read_text(encoding=encoding)
    except UnicodeDecodeError as error:
        name = error.encoding.upper()
        problem = f"not text in {name} (byte {error.start + 1}): save it in this encoding"
        raise ValueError(problem) from None


@contextlib.contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Replace a file atomically by one that is written in the ``with`` block.

    Other processes see the old file or the complete new one. After an error, the old file is kept.

    Yields:
        Path of the new file, in the same folder.
    """
    # Threads, and processes in two containers with a common folder, may have the same number.
    incomplete = path.with_name(f".{path.name}.{os.urandom(8).hex()}")
    try:
        yield incomplete
        incomplete.replace(path)
    finally:
        incomplete.unlink(missing_ok=True)


def read_columns(
    path: Path, units: Mapping[str, str], positive: Collection[str] = ()
) -> list[list[float]]:
    """Return the rows of a CSV file, with its columns of numbers in the order of `units`.

    The first line names the columns in any order, in capital or small letters, with or without
    their unit, such as ``load`` or ``load_N``; other columns are ignored. Lines that begin with
    ``#`` are comments.

    Args:
        path: file with values separated by commas.
        units: unit of each required column, keyed by its name.
        positive: columns whose values must be above 0.

    Raises:
        OSError: the file cannot be read; `strerror` is the reason.
        ValueError: a column is missing, or a value is not a finite number, or not above 0 as
            required; the message states the line and the remedy.
    """
    numbered = [
        (number, line)
        for number, line in enumerate(read_text(path).splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not numbered:
        raise ValueError("is empty")
    try:
        header, *rows = (next(csv.reader([line])) for _, line in numbered)
    except csv.Error as error:
        raise ValueError(f"is not a CSV file: {error}") from None
    places = _find_columns(header, units)
    table = []
    for (number, _), row in zip(numbered[1:], rows, strict=True):
        if any(row[len(header) :]):
            raise ValueError(
                f"line {number}: there are {len(row)} values, but the first line names "
                f"{len(header)}; a number must have a decimal point, not a comma"
            )
        values = [_number(row, place, name, number) for name, place in places.items()]
        for name, value in zip(places, values, strict=True):
            if name in positive and value <= 0.0:
                raise ValueError(
                    f"line {number}: the {name} {value:g} {units[name]} must be above 0"
                )
        table.append(values)
    return table


def _find_columns(header: list[str], units: Mapping[str, str]) -> dict[str, int]:
    """Return the index of each required column, keyed by name."""
    names = [name.strip().lower() for name in header]
    with_unit = {f"{name}_{unit}".lower(): name for name, unit in units.items()}
    known = [with_unit.get(name, name) for name in names]
    for column in units:
        if known.count(column) > 1:
            raise ValueError(f"the column {column!r} occurs {known.count(column)} times")
    if missing := [column for column in units if column not in known]:
        wanted = ", ".join(f"{name} [{unit}]" for name, unit in units.items())
        there = ", ".join(name or "(no name)" for name in names)
        raise ValueError(
            f"no column {' and no column '.join(map(repr, missing))}; the first line must name "
            f"{wanted}, separated by commas, and names: {there}"
        )
    return {column: known.index(column) for column in units}


def _number(row: list[str], place: int, name: str, line: int) -> float:
    if place >= len(row) or not row[place].strip():
        raise ValueError(f"line {line}: there is no {name}")
    try:
        value = float(row[place])
    except ValueError:
        raise ValueError(f"line {line}: the {name} {row[place]!r} is not a number") from None
    if not math.isfinite(value):
        raise ValueError(f"line {line}: the {name} {row[place].strip()!r} is not finite")
    return value


def user_folder(name: str, *wanted: Path | str) -> Path:
    """Return a folder in which this user can write; it is created if it does not exist.

    Args:
        name: name of the folder if it is in the directory for temporary files.
        wanted: folders to use if possible, the first one first; ``~`` is the home folder.

    Returns:
        The first of `wanted` that can be used; otherwise a folder in the directory for temporary
        files. All users share this directory, so the name of the folder contains the user's number,
        and a folder or link of this name that another user has made is not used.
    """
    shared = Path(tempfile.gettempdir(), f"{name}_{os.getuid()}")
    for folder in (*wanted, shared):
        try:
            path = Path(folder).expanduser()
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            foreign = path == shared and path.lstat().st_uid != os.getuid()
        except (OSError, RuntimeError):  # RuntimeError: the home folder is unknown
            continue
        if os.access(path, os.W_OK | os.X_OK) and not foreign:
            return path
    return Path(tempfile.mkdtemp(prefix=f"{name}_"))
