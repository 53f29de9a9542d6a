"""Sensitivity of the numbers of Table 2 to the identified parameters and to assumptions.

Each parameter is varied by a few steps in both directions while all other parameters are fixed, and
a straight line is fitted to each number of Table 2. Its slope is the sensitivity. The scatter about
the line is caused by the switching of the brakes and by wheels at the edge of the patch. Tire,
wheels and shape of the patch are assumed; `ASSUMPTIONS` changes these one at a time.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from omni_core import configuration, quantities
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_studies.identification import identification, table_2

_OFFSETS = (-2, -1, 0, 1, 2)  # [steps]


@dataclasses.dataclass(frozen=True, eq=False)
class Sensitivity:
    """Sensitivity of the ten numbers of Table 2 to the parameters.

    Attributes:
        numbers: names of the rows, as in `table_2.REFERENCES`.
        parameters: names of the columns, as in `identification.QUANTITIES`.
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
        """Slope divided by the tolerance of each number [1 per parameter step], shape (10, P)."""
        tolerance = np.array([table_2.tolerance(name) for name in self.numbers])
        return np.asarray(self.slope / tolerance[:, np.newaxis])

    def columns(self) -> dict[str, Any]:
        """Return the columns of a table, keyed by heading; every parameter is a row."""
        return {
            "parameter": list(self.parameters),
            "step": [quantity.step for quantity in identification.QUANTITIES],
            "unit of the step": [quantity.unit for quantity in identification.QUANTITIES],
            **dict(zip(self.numbers, self.slope, strict=True)),
            **{
                f"scatter {number}": row
                for number, row in zip(self.numbers, self.scatter, strict=True)
            },
        }


def sensitivities(
    bases: Mapping[str, ExperimentConfiguration], parameters: identification.Parameters
) -> Sensitivity:
    """Return the sensitivities at a candidate: slopes of lines fitted while a parameter varies.

    Args:
        bases: the variants of ``turn_while_translate``, keyed by case of Table 2.
        parameters: the candidate, keyed by the names in `QUANTITIES`.
    """
    numbers = tuple(table_2.REFERENCES)
    slope = np.full((len(numbers), len(identification.QUANTITIES)), np.nan)
    scatter = np.full_like(slope, np.nan)
    for column, quantity in enumerate(identification.QUANTITIES):
        offsets, values = [], []
        for offset in _OFFSETS:
            value = parameters[quantity.name] + offset * quantity.step
            row = _numbers(bases, {**parameters, quantity.name: value})
            if np.all(np.isfinite(row)):
                offsets.append(float(offset))
                values.append(row)
        if len(offsets) > 2:  # a line needs more than two points
            fit, residues, *_ = np.polyfit(offsets, values, 1, full=True)
            slope[:, column] = fit[0]
            scatter[:, column] = np.sqrt(residues / (len(offsets) - 2))
    return Sensitivity(
        numbers, tuple(quantity.name for quantity in identification.QUANTITIES), slope, scatter
    )


def _numbers(
    bases: Mapping[str, ExperimentConfiguration], parameters: identification.Parameters
) -> list[float]:
    """Return the ten numbers of Table 2 for a candidate; NaN if it tips over or does not stop."""
    try:
        measured = identification.measure(
            {case: identification.configure(base, parameters) for case, base in bases.items()}
        )
    except configuration.ConfigurationError:
        return [math.nan] * len(table_2.REFERENCES)
    return [measured[name] for name in table_2.REFERENCES]


EXPERIMENT = "turn_while_translate"


class Assumption(NamedTuple):
    """A change of one assumption about tire, wheels or patch.

    Attributes:
        name: name of the change.
        overrides: overrides of the experiment that make the change.
        sought: pairs of names of identified parameters; the first parameter of a pair gets the
            value of the second one.
        patch_width: factor on the width of the slippery patch [1].
    """

    name: str
    overrides: tuple[str, ...] = ()
    sought: tuple[tuple[str, str], ...] = ()
    patch_width: float = 1.0


ASSUMPTIONS = (
    Assumption("nothing"),
    Assumption("tire stiffness 100 kN/m", ("vehicle.tire.stiffness=1e5",)),
    Assumption("tire stiffness 400 kN/m", ("vehicle.tire.stiffness=4e5",)),
    Assumption("tire damping 500 N s/m", ("vehicle.tire.damping=500",)),
    Assumption("tire damping 10 kN s/m", ("vehicle.tire.damping=1e4",)),
    Assumption("Magic Formula tire", ("vehicle.tire.model=magic_formula",)),
    Assumption("linear tire", ("vehicle.tire.model=linear",)),
    *(
        Assumption(
            f"{count} individual rollers",
            ("vehicle.wheel_model=rollers", f"vehicle.rollers.count={count}"),
        )
        for count in (24, 12, 6)
    ),
    Assumption("patch 0.7 times as wide", patch_width=0.7),
    Assumption("patch half as wide", patch_width=0.5),
    Assumption("friction of the ground everywhere", sought=(("patch_friction", "friction"),)),
    Assumption("friction of the patch everywhere", sought=(("friction", "patch_friction"),)),
)


OTHERS: dict[str, identification.Parameters] = {
    "seed_1": identification.rounded((
        1477.0, 694.0, 412.0, 0.733, 0.231, 0.388, 1.835, 0.838, 848.0, 6.397, -48.49, 76.28,
        0.531, 0.339, 0.13, 1.94, 7.22, 2.42,
    )),
    "seed_2": identification.rounded((
        1059.0, 634.0, 366.0, 0.403, 0.456, 0.421, 1.506, 0.927, 1168.0, 6.237, -49.26, 71.95,
        0.596, 0.275, -0.31, 4.0, 7.12, 2.48,
    )),
}  # fmt: skip
"""Parameters of two vehicles that ``study table2 --identify --sound`` identified with the seeds 1
and 2, keyed by vehicle."""


def under(
    library: ExperimentLibrary, parameters: identification.Parameters
) -> Iterator[dict[str, float]]:
    """Yield the ten numbers of Table 2 for a candidate, once for each of the `ASSUMPTIONS`.

    Args:
        library: library that contains the experiment file.
        parameters: the candidate, keyed by the names in `identification.QUANTITIES`.
    """
    for _, overrides, sought, patch_width in ASSUMPTIONS:
        changed = {
            **parameters,
            **{name: parameters[source] for name, source in sought},
            "patch_width": patch_width * parameters["patch_width"],
        }
        yield identification.measure(
            {
                case: identification.configure(
                    library.load(EXPERIMENT, case, [table_2.TWIST_ALONE, *overrides]), changed
                )
                for case in table_2.CASES
            }
        )
