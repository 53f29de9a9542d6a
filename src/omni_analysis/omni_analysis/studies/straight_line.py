"""Emergency braking straight ahead, assisted and not: Figures 30 to 32."""

from __future__ import annotations

import argparse
from pathlib import Path

from omni_analysis.braking import study as experiment_study
from omni_analysis.braking.study import write_top_view, write_velocities_and_errors
from omni_analysis.identification.files import VEHICLE
from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.studies import StudyResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's options."""
    parser.add_argument(
        "--vehicle",
        default=VEHICLE,
        metavar="NAME",
        help="a file of config/vehicles/ (default: %(default)s)",
    )
    experiment_study.add_arguments(parser)


def overrides(library: ExperimentLibrary, vehicle: str = VEHICLE) -> list[str]:
    """Return what makes the experiment's own file the dissertation's.

    That is the identified vehicle on the ground that was identified with it, and a velocity sensor.

    Args:
        library: where the experiments are.
        vehicle: name of another vehicle.
    """
    ground = library.load("turn_while_translate", "unassisted").ground
    return [f"vehicle={vehicle}", f"ground.friction={ground.friction}", "feedback=velocity_sensor"]


def run(options: argparse.Namespace, library: ExperimentLibrary, folder: Path) -> StudyResult:
    """Run the experiment on the velocity sensor, as the dissertation did, and draw its figures."""
    chosen = [*overrides(library, options.vehicle), *options.overrides]
    runs = experiment_study.run_experiment(library, "straight_line", chosen)
    files = [
        *write_top_view(runs, ["unassisted", "assisted"], folder, 30),
        *write_velocities_and_errors(runs, "unassisted", folder, 31),
        *write_velocities_and_errors(runs, "assisted", folder, 32),
    ]
    metrics = runs.metrics
    ratio = metrics["largest_error.unassisted"].value / metrics["largest_error.assisted"].value
    return StudyResult(
        metrics,
        tuple(files),
        (f"the errors of the assisted vehicle are smaller by a factor of {ratio:.1f}",),
    )
