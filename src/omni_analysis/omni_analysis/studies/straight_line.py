"""Emergency braking straight ahead, assisted and not: Figures 30 to 32."""

from __future__ import annotations

import argparse
from pathlib import Path

from omni_analysis import experiment_study
from omni_analysis.experiment import ExperimentLibrary
from omni_analysis.experiment_study import write_top_view, write_velocities_and_errors
from omni_analysis.studies import StudyResult

VEHICLE = "table_2_mecanum"
"""The vehicle that `table2` identified; the experiment's own file names another."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's options."""
    parser.add_argument(
        "--vehicle",
        default=VEHICLE,
        metavar="NAME",
        help="a file of config/vehicles/ (default: %(default)s)",
    )
    experiment_study.add_arguments(parser)


def run(options: argparse.Namespace, library: ExperimentLibrary, folder: Path) -> StudyResult:
    """Run the experiment on the velocity sensor, as the dissertation did, and draw its figures."""
    overrides = [f"vehicle={options.vehicle}", "feedback=velocity_sensor", *options.overrides]
    runs = experiment_study.run_experiment(library, "straight_line", overrides)
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
