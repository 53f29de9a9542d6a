"""Reading of measured tire forces from a CSV file with the columns slip, load and force.

The first line names the columns, in any order; other columns are ignored. The names ``load_N`` and
``force_N`` are also accepted, but no other units. Lines that begin with ``#`` are comments. If a
file cannot be used, the error message states the reason and the line.

A file without names of units can still have other units: a slip in per cent, a slip angle in
degrees, a force in kN. Such values are far outside the range of tires, and are refused.
"""

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from omni_core import configuration, files, quantities

_COLUMNS = ("slip", "load", "force")
_UNITS = {"load_n": "load", "force_n": "force"}
_FRICTION = (0.01, 4.0)
"""Largest force divided by the largest load [1]: wet ice has 0.02 to 0.1, tires of racing cars have
up to 3 on abrasive belts. A wrong factor of 1000, or a load in kg on dry ground, is outside."""
_SLIP_OF_HALF_FORCE = 0.6
"""Limit on the slip at which the force reaches half of its maximum [1]: rubber reaches it at 0.01
to 0.1, and soft rollers, snow and gravel below 0.5; in per cent or degrees these are 1 or more."""


class TireDataError(configuration.InputError):
    """The measurements do not determine a tire; the message states the reason."""


class TireData(NamedTuple):
    """Steady forces of a tire in one direction.

    Attributes:
        slip: longitudinal or lateral slip by Eq. (1) or (2) [1], any sign, shape (n,).
        load: wheel load [N], above 0, shape (n,).
        force: tire force, with the sign of the slip [N], shape (n,).
    """

    slip: quantities.FloatArray
    load: quantities.FloatArray
    force: quantities.FloatArray


def read_tire_data(path: Path) -> TireData:
    """Return measured tire forces from a CSV file.

    Raises:
        TireDataError: the file cannot be read, a column is missing, or a value is not a usable
            number.
    """
    try:
        text = files.read_text(path, encoding="utf-8-sig")
    except OSError as error:
        raise TireDataError(f"cannot read the file: {error.strerror}") from None
    except UnicodeDecodeError:
        raise TireDataError("is not a text file") from None
    numbered = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not numbered:
        raise TireDataError("is empty")
    rows = list(csv.reader(line for _, line in numbered))
    places = _find_columns(rows[0])
    values = np.empty((len(rows) - 1, 3))
    for k, ((number, _), row) in enumerate(zip(numbered[1:], rows[1:], strict=True)):
        values[k] = [_number(row, place, name, number) for name, place in places.items()]
        if values[k, 1] <= 0.0:
            raise TireDataError(f"line {number}: the load {values[k, 1]:g} N must be above 0")
    data = TireData(*np.ascontiguousarray(values.T))
    _check_units(data)
    return data


def _check_units(data: TireData) -> None:
    """Check that the values are in the range of tires, so that no column has another unit.

    Raises:
        TireDataError: a column has another unit; the message states the value and the remedy.
    """
    largest = np.max(np.abs(data.force), initial=0.0)
    if largest == 0.0:
        return
    friction, (least, most) = largest / np.max(data.load), _FRICTION
    if not least <= friction <= most:
        raise TireDataError(
            f"the largest force is {friction:.3g} times the largest load, must be {least:g} to "
            f"{most:g} times: give both in N"
        )
    ratio = np.abs(data.force) / data.load
    # The largest ratio could be an outlier at a small load.
    slip = np.min(np.abs(data.slip[ratio >= 0.5 * np.quantile(ratio, 0.95)]))
    if slip > _SLIP_OF_HALF_FORCE:
        raise TireDataError(
            f"the force reaches half of its maximum only at a slip of {slip:.3g}, must be at most "
            f"{_SLIP_OF_HALF_FORCE:g}: divide a slip in per cent by 100, and replace a slip angle "
            "in degrees by its tangent"
        )


def _find_columns(header: list[str]) -> dict[str, int]:
    """Return the index of each required column, keyed by name."""
    names = [name.strip().lower() for name in header]
    known = [_UNITS.get(name, name) for name in names]
    for column in _COLUMNS:
        if known.count(column) > 1:
            raise TireDataError(f"the column {column!r} occurs {known.count(column)} times")
    if missing := [column for column in _COLUMNS if column not in known]:
        there = ", ".join(name or "(no name)" for name in names)
        raise TireDataError(
            f"no column {' and no column '.join(map(repr, missing))}; the first line must name "
            f"slip [1], load [N] and force [N], separated by commas, and names: {there}"
        )
    return {column: known.index(column) for column in _COLUMNS}


def _number(row: list[str], place: int, name: str, line: int) -> float:
    if place >= len(row) or not row[place].strip():
        raise TireDataError(f"line {line}: there is no {name}")
    try:
        value = float(row[place])
    except ValueError:
        raise TireDataError(f"line {line}: the {name} {row[place]!r} is not a number") from None
    if not math.isfinite(value):
        raise TireDataError(f"line {line}: the {name} {row[place].strip()!r} is not finite")
    return value
