"""Reading of measured tire forces from a CSV file with the columns slip, load and force.

A file without names of units can still have other units: a slip in per cent, a slip angle in
degrees, a force in kN. Such values are far outside the range of tires, and are refused.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from omni_core import configuration, files, quantities

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
        values = files.read_columns(path, {"slip": "1", "load": "N", "force": "N"}, {"load"})
    except OSError as error:
        raise TireDataError(f"cannot read the file: {error.strerror}") from None
    except ValueError as error:
        raise TireDataError(str(error)) from None
    data = TireData(*np.reshape(values, (-1, 3)).T.copy())
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
