"""Braking on ice with noisy feedback, Eqs. (60), (61): Figures 39 to 42."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from omni_analysis.braking import figures as braking_figures
from omni_analysis.braking import study as experiment_study
from omni_analysis.braking.study import ExperimentRuns, path_columns, write_figure
from omni_analysis.figures.overlay import overlay_view
from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.studies import StudyResult

_CLEAN, _NOISY = "assisted", "noisy"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the study's options."""
    experiment_study.add_arguments(parser)


def run(options: argparse.Namespace, library: ExperimentLibrary, folder: Path) -> StudyResult:
    """Run the experiment in one process and draw its figures."""
    runs = experiment_study.run_experiment(library, "ice_patch_noisy", options.overrides)
    clean, noisy = runs.histories[_CLEAN], runs.histories[_NOISY]
    final = overlay_view(
        runs.scene,
        runs.histories,
        "Braking on an ice patch: where the vehicles come to rest",
        interval=None,
    )
    measured = braking_figures.compare_velocities(
        {"original": (noisy, noisy.twist), "noisy": (noisy, runs.feedback[_NOISY])},
        "Noise on the feedback",
    )
    errors = braking_figures.compare_errors(
        {"no noise": clean, "noisy feedback": noisy}, "Errors with and without noise"
    )
    velocities = braking_figures.compare_velocities(
        {"no noise": (clean, clean.twist), "noisy feedback": (noisy, noisy.twist)},
        "Velocities with and without noise",
    )
    return StudyResult(
        runs.metrics,
        (
            *write_figure(final, path_columns(runs.histories), folder, 39),
            *write_figure(measured, _feedback_columns(runs), folder, 40),
            *write_figure(errors, _columns(runs, errors=True), folder, 41),
            *write_figure(velocities, _columns(runs, errors=False), folder, 42),
        ),
    )


def _feedback_columns(runs: ExperimentRuns) -> dict[str, Any]:
    history, told = runs.histories[_NOISY], runs.feedback[_NOISY]
    columns: dict[str, Any] = {"time [s]": history.time}
    for place, name in enumerate(("v_x [m/s]", "v_y [m/s]", "yaw rate [rad/s]")):
        columns[name] = history.twist[:, place]
        columns[f"noisy {name}"] = told[:, place]
    return columns


def _columns(runs: ExperimentRuns, *, errors: bool) -> dict[str, Any]:
    """Return errors or velocities of both runs, below one another."""
    columns: dict[str, list[Any]] = {"variant": []}
    for name in (_CLEAN, _NOISY):
        history = runs.histories[name]
        columns["variant"] += [name] * len(history.stamp_ns)
        table = {"time [s]": history.time}
        if errors:
            for place, wheel in enumerate(history.wheel_names):
                table[f"s {wheel} [m/s]"] = history.error[:, place]
        else:
            for place, component in enumerate(("v_x [m/s]", "v_y [m/s]", "yaw rate [rad/s]")):
                table[component] = history.twist[:, place]
        for column, values in table.items():
            columns.setdefault(column, []).extend(values.tolist())
    return columns
