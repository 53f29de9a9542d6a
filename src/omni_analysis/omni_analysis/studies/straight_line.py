"""Emergency braking of Table 2's vehicle straight ahead, assisted and not: Figures 30 to 32."""

from __future__ import annotations

from dataclasses import dataclass

from omni_analysis.braking.study import (
    BrakingOptions,
    draw,
    from_above,
    keeps_orientation,
    over_time,
    run_experiment,
)
from omni_analysis.identification.files import VEHICLE
from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.studies import StudyResult, StudyRun, claim
from omni_platform.configuration import parameter

_FIGURES = {
    30: from_above("unassisted", "assisted"),
    31: over_time("unassisted"),
    32: over_time("assisted"),
}


@dataclass(frozen=True, kw_only=True)
class Options(BrakingOptions):
    """The vehicle, and what is changed of the experiment."""

    vehicle: str = parameter(VEHICLE, description="a file of config/vehicles/")


def overrides(library: ExperimentLibrary, vehicle: str = VEHICLE) -> list[str]:
    """Return what makes the experiment's own file the dissertation's.

    That is the identified vehicle on the ground that was identified with it, and a velocity sensor.

    Args:
        library: where the experiments are.
        vehicle: name of another vehicle.
    """
    ground = library.load("turn_while_translate", "unassisted").ground
    return [f"vehicle={vehicle}", f"ground.friction={ground.friction}", "feedback=velocity_sensor"]


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run the experiment on the velocity sensor, as the dissertation did, and draw its figures."""
    chosen = [*overrides(study.experiments, options.vehicle), *options.changes]
    runs = run_experiment(study.experiments, "straight_line", chosen)
    files = draw(runs, _FIGURES, study.folder)
    metrics = runs.metrics
    ratio = metrics["largest_error.unassisted"].value / metrics["largest_error.assisted"].value
    free, helped = (
        metrics[f"orientation_change.{variant}"].value for variant in ("unassisted", "assisted")
    )
    findings = (
        f"Braked is {options.vehicle} on the ground identified with it, as in the dissertation; "
        "`omni run straight_line` brakes the vehicle of the experiment's own file",
        claim(
            "Assisted, the errors are smaller by an order of magnitude",
            f"by a factor of {ratio:.1f}",
            holds=ratio > 10.0,
        ),
        claim(
            "Unassisted it swerves, assisted it does not",
            f"{free:.1f} against {helped:.1f} deg",
            holds=keeps_orientation(helped, free),
        ),
    )
    return StudyResult(metrics, files, findings)
