"""Choice of the unit of a figure's axis or a table's row by the magnitude of its values."""

import math
from collections.abc import Iterable

_LONGEST_IN_MM = 0.2  # [m]
_SMALLEST_IN_KN = 1000.0  # [N]


def readable_unit(unit: str, values: Iterable[float]) -> tuple[str, float]:
    """Return the unit in which values are easy to read, and the factor that converts them.

    Args:
        unit: unit of the values; only ``m`` and ``N`` are changed, to ``mm`` and ``kN``.
        values: values that are shown together, of which the largest magnitude decides.
    """
    largest = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    if unit == "m" and 0.0 < largest < _LONGEST_IN_MM:
        return "mm", 1e3
    if unit == "N" and largest >= _SMALLEST_IN_KN:
        return "kN", 1e-3
    return unit, 1.0
