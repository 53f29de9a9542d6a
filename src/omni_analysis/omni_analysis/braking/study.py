"""What the studies of section 3.6 share: run every variant in one process, then figures and data.

A figure of the dissertation comes as ``figure_<number>.png`` with ``figure_<number>.csv`` beside
it, which holds what the figure shows.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from omni_analysis.braking import figures as braking_figures
from omni_analysis.figures.data_table import TIME, history_columns, write_columns
from omni_analysis.figures.run_figures import scene_of
from omni_analysis.figures.scene import Scene
from omni_analysis.figures.style import save_figure
from omni_analysis.figures.top_view import top_view
from omni_analysis.loop.compiled import run_fast_loop
from omni_analysis.loop.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_analysis.loop.history import RunHistory
from omni_analysis.loop.loop import run_closed_loop
from omni_analysis.loop.metrics import Metric, run_metrics
from omni_analysis.loop.options import LoopOptions
from omni_analysis.studies import StudyResult, StudyRun
from omni_platform.quantities import FloatArray

_QUANTITIES = (
    "orientation_change",
    "stopping_distance",
    "lateral_deviation",
    "stopping_time",
    "peak_yaw_rate",
    "brake_switchings",
)


@dataclasses.dataclass(frozen=True)
class ExperimentRuns:
    """All variants of an experiment, run to their end.

    Attributes:
        configurations: by variant.
        histories: likewise.
        feedback: twists that the assistant was told [m/s, m/s, rad/s], (T, 3), likewise.
    """

    configurations: Mapping[str, ExperimentConfiguration]
    histories: Mapping[str, RunHistory]
    feedback: Mapping[str, FloatArray]

    @property
    def scene(self) -> Scene:
        """Vehicle and ground, which all variants share."""
        return scene_of(next(iter(self.configurations.values())))

    @property
    def metrics(self) -> dict[str, Metric]:
        """How every variant stopped and its largest error, by ``<quantity>.<variant>``."""
        by_variant = {name: run_metrics(history) for name, history in self.histories.items()}
        metrics = {
            f"{quantity}.{name}": by_variant[name][quantity]
            for quantity in _QUANTITIES
            for name in by_variant
        }
        for name, history in self.histories.items():
            metrics[f"largest_error.{name}"] = Metric(largest_error(history), "m/s")
        return metrics


def largest_error(history: RunHistory) -> float:
    """Return the largest magnitude of any ``s_i`` while braking [m/s]."""
    return float(np.max(np.abs(history.error[history.brake_start :])))


def run_experiment(
    library: ExperimentLibrary, experiment: str, overrides: list[str]
) -> ExperimentRuns:
    """Run every variant of an experiment in one process.

    On the velocity sensor that is the fast loop; on optical feedback the loop with its cameras.

    Args:
        library: where the experiment is.
        experiment: its name.
        overrides: ``dotted.key=value`` texts, laid over every variant.

    Raises:
        ConfigurationError: a name, key or value does not fit.
    """
    configurations = {
        variant: library.load(experiment, variant, overrides)
        for variant in library.variants(experiment)
    }
    histories, feedback = {}, {}
    for variant, configuration in configurations.items():
        if not configuration.hears_lines:
            run = run_fast_loop(configuration)
            histories[variant], feedback[variant] = run.history(), run.record.feedback
        else:
            histories[variant] = run_closed_loop(configuration)
            feedback[variant] = histories[variant].estimate
    return ExperimentRuns(configurations, histories, feedback)


BrakingOptions = LoopOptions


Drawing = Callable[[ExperimentRuns], tuple[Figure, Mapping[str, Any]]]
"""Draws one figure of the dissertation; returns it with its data by ``name [unit]``."""


Values = Mapping[str, float]
Findings = Callable[[Values], Sequence[str]]


def keeps_orientation(turned: float, unassisted: float) -> bool:
    """Return whether a stop turns by a small part of what it does unassisted, both in [deg]."""
    return turned < 0.2 * unassisted


def braking_study(
    experiment: str, drawings: Mapping[int, Drawing], findings: Findings
) -> Callable[[BrakingOptions, StudyRun], StudyResult]:
    """Return the ``run`` of the study of one experiment.

    Args:
        experiment: whose variants it runs.
        drawings: the figures by their number in the dissertation.
        findings: says in words what values, by ``<quantity>.<variant>``, tell of its claims.
    """

    def run(options: BrakingOptions, study: StudyRun) -> StudyResult:
        runs = run_experiment(study.experiments, experiment, options.changes)
        metrics, files = runs.metrics, draw(runs, drawings, study.folder)
        values = {name: metric.value for name, metric in metrics.items()}
        return StudyResult(metrics, files, tuple(findings(values)))

    return run


def draw(runs: ExperimentRuns, drawings: Mapping[int, Drawing], folder: Path) -> tuple[Path, ...]:
    """Write the figures of an experiment, each with the data that it shows."""
    files = []
    for number, drawing in drawings.items():
        figure, columns = drawing(runs)
        files.append(save_figure(figure, folder / f"figure_{number}.png"))
        files.append(write_columns(folder / f"figure_{number}.csv", columns))
    return tuple(files)


def over_time(variant: str, *, errors: bool = True) -> Drawing:
    """Draw velocity components and errors of one variant over time."""

    def drawing(runs: ExperimentRuns) -> tuple[Figure, Mapping[str, Any]]:
        history = runs.histories[variant]
        title = f"{runs.configurations[variant].description}: {variant}"
        figure = braking_figures.velocities_and_errors(history, title, errors=errors)
        return figure, history_columns(history, errors=errors)

    return drawing


def from_above(*variants: str) -> Drawing:
    """Draw snapshots of some variants, or of all, from above, with the paths as data."""

    def drawing(runs: ExperimentRuns) -> tuple[Figure, Mapping[str, Any]]:
        histories = {variant: runs.histories[variant] for variant in variants or runs.histories}
        title = next(iter(runs.configurations.values())).description
        return top_view(runs.scene, histories, title=title), path_columns(histories)

    return drawing


def path_columns(histories: Mapping[str, RunHistory]) -> dict[str, Any]:
    """Return the poses of all variants over time, below one another."""
    names = [name for name, history in histories.items() for _ in history.stamp_ns]
    pose = np.concatenate([history.pose for history in histories.values()])
    return {
        "variant": names,
        TIME: np.concatenate([history.braking_time for history in histories.values()]),
        "x [m]": pose[:, 0],
        "y [m]": pose[:, 1],
        "yaw [deg]": pose[:, 2] * (180.0 / math.pi),
    }
