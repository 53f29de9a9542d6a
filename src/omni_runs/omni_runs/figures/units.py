"""Units of axes and rows: that of a parameter, and one that suits the magnitude of the values."""

import math
import typing
from collections.abc import Iterable

from omni_core.configuration import Configuration, declared_parameters

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


def unit_of(cls: type[Configuration], key: str) -> str:
    """Return the unit of a parameter; ``1`` if it has none.

    Args:
        cls: configuration that declares the parameter.
        key: dotted key, such as ``load.mass``; it may contain names of entries, such as wheels.
    """
    fields = {name: (kind, info) for name, kind, info in declared_parameters(cls)}
    name, _, rest = key.partition(".")
    if name not in fields:
        return "1"
    kind, info = fields[name]
    if typing.get_origin(kind) is not None:  # a mapping of entries
        kind, rest = typing.get_args(kind)[-1], rest.partition(".")[2]
    if rest and isinstance(kind, type) and issubclass(kind, Configuration):
        return unit_of(kind, rest)
    return info.unit or "1"
