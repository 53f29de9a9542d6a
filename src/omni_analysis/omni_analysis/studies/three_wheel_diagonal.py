"""The three-wheeled robot stops from a diagonal motion: Figures 33 to 35."""

from __future__ import annotations

import argparse
from pathlib import Path

from omni_analysis.braking import study as experiment_study
from omni_analysis.braking.study import write_top_view, write_velocities_and_errors
from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.studies import StudyResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's options."""
    experiment_study.add_arguments(parser)


def run(options: argparse.Namespace, library: ExperimentLibrary, folder: Path) -> StudyResult:
    """Run the experiment in one process and draw its figures."""
    runs = experiment_study.run_experiment(library, "three_wheel_diagonal", options.overrides)
    files = [
        *write_top_view(runs, ["unassisted", "assisted"], folder, 33),
        *write_velocities_and_errors(runs, "unassisted", folder, 34),
        *write_velocities_and_errors(runs, "assisted", folder, 35),
    ]
    return StudyResult(runs.metrics, tuple(files))
