"""Braking with a front wheel already on ice, assisted and not: Figures 36 to 38."""

from __future__ import annotations

import argparse
from pathlib import Path

from omni_analysis.braking import study as experiment_study
from omni_analysis.braking.study import (
    path_columns,
    write_figure,
    write_velocities_and_errors,
)
from omni_analysis.figures.overlay import overlay_view
from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.studies import StudyResult

_INTERVAL = 1.0  # between snapshots [s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's options."""
    experiment_study.add_arguments(parser)


def run(options: argparse.Namespace, library: ExperimentLibrary, folder: Path) -> StudyResult:
    """Run the experiment in one process and draw its figures."""
    runs = experiment_study.run_experiment(library, "ice_patch", options.overrides)
    figure = overlay_view(
        runs.scene,
        runs.histories,
        f"Braking on an ice patch, every {_INTERVAL:g} s and at rest",
        interval=_INTERVAL,
    )
    files = [
        *write_figure(figure, path_columns(runs.histories), folder, 36),
        *write_velocities_and_errors(runs, "unassisted", folder, 37),
        *write_velocities_and_errors(runs, "assisted", folder, 38),
    ]
    return StudyResult(runs.metrics, tuple(files))
