"""Braking out of a turn-while-translate maneuver under every weighting: Figures 43 to 48."""

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
    runs = experiment_study.run_experiment(library, "turn_while_translate", options.overrides)
    files = [
        *write_top_view(runs, ["unassisted", "zero", "cosine"], folder, 43),
        *write_velocities_and_errors(runs, "unassisted", folder, 44, errors=False),
        *write_velocities_and_errors(runs, "zero", folder, 45),
        *write_velocities_and_errors(runs, "cosine", folder, 46),
        *write_top_view(runs, ["cosine", "k1", "k7"], folder, 47),
        *write_velocities_and_errors(runs, "k1", folder, 48),
    ]
    return StudyResult(runs.metrics, tuple(files))
