"""Dependence of Table 2 on assumptions: tire, wheels and shape of the patch."""

from collections.abc import Iterator
from typing import NamedTuple

from omni_loop.experiment import ExperimentLibrary
from omni_studies.identification import table_2
from omni_studies.identification.identification import Parameters, configure, measure, rounded

EXPERIMENT = "turn_while_translate"


class Assumption(NamedTuple):
    """A changed assumption.

    Attributes:
        name: name of the change.
        overrides: overrides of the experiment.
        sought: parameters of the search that are set to the value of another.
        patch_width: patch width of the slippery patch, over its own [1].
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


OTHERS: dict[str, Parameters] = {
    "seed_1": rounded((
        1477.0, 694.0, 412.0, 0.733, 0.231, 0.388, 1.835, 0.838, 848.0, 6.397, -48.49, 76.28,
        0.531, 0.339, 0.13, 1.94, 7.22, 2.42,
    )),
    "seed_2": rounded((
        1059.0, 634.0, 366.0, 0.403, 0.456, 0.421, 1.506, 0.927, 1168.0, 6.237, -49.26, 71.95,
        0.596, 0.275, -0.31, 4.0, 7.12, 2.48,
    )),
}  # fmt: skip
"""Vehicles found by ``study table2 --identify --sound`` with the seeds 1 and 2, in the order
of `QUANTITIES`."""


def under(library: ExperimentLibrary, parameters: Parameters) -> Iterator[dict[str, float]]:
    """Yield the ten numbers of a candidate for each of `ASSUMPTIONS`.

    Args:
        library: where the experiment is.
        parameters: the candidate, by the names of `identification.QUANTITIES`.
    """
    for _, overrides, sought, patch_width in ASSUMPTIONS:
        changed = {
            **parameters,
            **{name: parameters[source] for name, source in sought},
            "patch_width": patch_width * parameters["patch_width"],
        }
        yield measure(
            {
                case: configure(
                    library.load(EXPERIMENT, case, [table_2.TWIST_ALONE, *overrides]), changed
                )
                for case in table_2.CASES
            }
        )
