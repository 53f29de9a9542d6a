"""Sensitivity of each number of Table 2 to each identified parameter.

Every parameter is varied by a few steps to either side, with the others fixed, and a straight line
is fitted to each number. Its slope is the sensitivity. The scatter about the line is due to the
switching of the brakes and to wheels at the edge of the patch.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from omni_loop.experiment import ExperimentConfiguration
from omni_platform import configuration, quantities
from omni_studies.identification import table_2
from omni_studies.identification.identification import QUANTITIES, Parameters, configure, measure

_OFFSETS = (-2, -1, 0, 1, 2)  # [steps]


@dataclasses.dataclass(frozen=True, eq=False)
class Sensitivity:
    """Slopes of the ten numbers over the parameters.

    Attributes:
        numbers: names of the rows, those of `table_2.REFERENCES`.
        parameters: names of the columns, those of `identification.QUANTITIES`.
        slope: change for one step of a parameter [deg] or [m], shape (10, P); NaN if the
            vehicle tips over or does not stop.
        scatter: standard deviation about the straight line [deg] or [m], shape (10, P).
    """

    numbers: tuple[str, ...]
    parameters: tuple[str, ...]
    slope: quantities.FloatArray
    scatter: quantities.FloatArray

    @property
    def in_tolerances(self) -> quantities.FloatArray:
        """Slope over the tolerance of each number [1 per step], shape (10, P)."""
        tolerance = np.array([table_2.tolerance(name) for name in self.numbers])
        return np.asarray(self.slope / tolerance[:, np.newaxis])

    def columns(self) -> dict[str, Any]:
        """Return one row per parameter: its step, and slope and scatter of each number."""
        return {
            "parameter": list(self.parameters),
            "step": [quantity.step for quantity in QUANTITIES],
            "unit of the step": [quantity.unit for quantity in QUANTITIES],
            **dict(zip(self.numbers, self.slope, strict=True)),
            **{
                f"scatter {number}": row
                for number, row in zip(self.numbers, self.scatter, strict=True)
            },
        }


def sensitivities(
    bases: Mapping[str, ExperimentConfiguration], parameters: Parameters
) -> Sensitivity:
    """Vary every parameter about a candidate and fit straight lines.

    Args:
        bases: the variants of ``turn_while_translate`` by case.
        parameters: the candidate, by the names of `QUANTITIES`.
    """
    numbers = tuple(table_2.REFERENCES)
    slope = np.full((len(numbers), len(QUANTITIES)), np.nan)
    scatter = np.full_like(slope, np.nan)
    for column, quantity in enumerate(QUANTITIES):
        offsets, values = [], []
        for offset in _OFFSETS:
            value = parameters[quantity.name] + offset * quantity.step
            row = _numbers(bases, {**parameters, quantity.name: value})
            if np.all(np.isfinite(row)):
                offsets.append(float(offset))
                values.append(row)
        if len(offsets) > 2:  # otherwise there is no line
            fit, residues, *_ = np.polyfit(offsets, values, 1, full=True)
            slope[:, column] = fit[0]
            scatter[:, column] = np.sqrt(residues / (len(offsets) - 2))
    return Sensitivity(numbers, tuple(quantity.name for quantity in QUANTITIES), slope, scatter)


def _numbers(bases: Mapping[str, ExperimentConfiguration], parameters: Parameters) -> list[float]:
    """Return the ten numbers of a candidate, NaN if it tips over or does not stop."""
    try:
        measured = measure({case: configure(base, parameters) for case, base in bases.items()})
    except configuration.ConfigurationError:
        return [math.nan] * len(table_2.REFERENCES)
    return [measured[name] for name in table_2.REFERENCES]
