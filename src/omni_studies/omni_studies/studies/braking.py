"""The experiments of section 3.6, every variant run in one process: Figures 30 to 48.

A figure of the dissertation is written as ``figure_<number>.png`` with its data in
``figure_<number>.csv``. The dissertation's assistant uses only the twist, while this one also
compares it with IMU and wheel speeds. If an experiment uses these, the assisted variant is repeated
without them, as ``<variant>_twist_alone``.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_figures import data_table, style
from omni_figures.run_figures import scene_of
from omni_figures.time_series import while_braking
from omni_figures.top_view import top_view
from omni_loop import compiled, loop
from omni_loop.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_loop.history import RunHistory
from omni_loop.metrics import Metric, run_metrics
from omni_loop.options import LoopOptions
from omni_platform.configuration import parameter
from omni_platform.quantities import FloatArray
from omni_studies.identification.files import VEHICLE
from omni_studies.study import StudyResult, StudyRun

CASES = {
    "straight_line": "Emergency braking of Table 2's vehicle straight ahead, assisted and not: "
    "Figures 30 to 32",
    "three_wheel_diagonal": "The three-wheeled robot stops from a diagonal motion: Figures 33 "
    "to 35",
    "ice_patch": "Braking with a front wheel already on ice, assisted and not: Figures 36 to 38",
    "ice_patch_noisy": "Braking on ice with noisy feedback, Eqs. (60), (61): Figures 39 to 42",
    "turn_while_translate": "Braking out of a turn-while-translate maneuver under every "
    "weighting: Figures 43 to 48",
}

_QUANTITIES = (
    "orientation_change",
    "stopping_distance",
    "lateral_deviation",
    "stopping_time",
    "peak_yaw_rate",
    "brake_switchings",
)
_ALONE = "_twist_alone"
_TWIST_ALONE = "brake_assist.fault_detection=false"
_COMPONENTS = ("v_x [m/s]", "v_y [m/s]", "yaw rate [rad/s]")
_LABELS = ("$v_x$ [m/s]", "$v_y$ [m/s]", r"$\omega$ [rad/s]")


@dataclasses.dataclass(frozen=True)
class ExperimentRuns:
    """Variants of an experiment, run to their end.

    Attributes:
        configurations: configurations by variant.
        histories: runs by variant.
        feedback: twists that the assistant received [m/s, m/s, rad/s], (T, 3), by variant.
    """

    configurations: Mapping[str, ExperimentConfiguration]
    histories: Mapping[str, RunHistory]
    feedback: Mapping[str, FloatArray]

    @property
    def metrics(self) -> dict[str, Metric]:
        """Metrics of every variant, and its largest error, by ``<quantity>.<variant>``."""
        by_variant = {name: run_metrics(history) for name, history in self.histories.items()}
        metrics = {
            f"{quantity}.{name}": by_variant[name][quantity]
            for quantity in _QUANTITIES
            for name in by_variant
        }
        for name, history in self.histories.items():
            metrics[f"largest_error.{name}"] = Metric(largest_error(history), "m/s")
        width = next(iter(self.configurations.values())).vehicle.chassis_width
        metrics["width.vehicle"] = Metric(width, "m")
        return metrics


def largest_error(history: RunHistory) -> float:
    """Return the largest magnitude of any ``s_i`` while braking [m/s]."""
    return float(np.max(np.abs(history.error[history.brake_start :])))


def run_experiment(
    library: ExperimentLibrary, experiment: str, overrides: Sequence[str]
) -> ExperimentRuns:
    """Run every variant of an experiment in one process.

    With the velocity sensor the fast loop runs, with optical feedback the loop with cameras.

    Args:
        library: library with the experiment.
        experiment: name of the experiment.
        overrides: ``dotted.key=value`` texts, applied to every variant.

    Raises:
        ConfigurationError: a name, key or value does not fit.
    """
    configurations = {
        variant: library.load(experiment, variant, overrides)
        for variant in library.variants(experiment, overrides)
    }
    for variant, configuration in list(configurations.items()):
        assistant = configuration.brake_assist
        if assistant.enabled and assistant.fault_detection and not configuration.uses_lines:
            alone = library.load(experiment, variant, (*overrides, _TWIST_ALONE))
            configurations[variant + _ALONE] = alone
    histories, feedback = {}, {}
    for variant, configuration in configurations.items():
        if not configuration.uses_lines:
            run = compiled.run_fast_loop(configuration)
            histories[variant], feedback[variant] = run.history(), run.record.feedback
        else:
            histories[variant] = loop.run_closed_loop(configuration)
            feedback[variant] = histories[variant].estimate
    return ExperimentRuns(configurations, histories, feedback)


def table_2_vehicle(library: ExperimentLibrary, vehicle: str = VEHICLE) -> list[str]:
    """Return the overrides that turn ``straight_line`` into the dissertation's experiment.

    The overrides set the identified vehicle and ground, and a velocity sensor.

    Args:
        library: library with the experiments.
        vehicle: name of a vehicle to use instead of the identified one.
    """
    ground = library.load("turn_while_translate", "unassisted").ground
    return [f"vehicle={vehicle}", f"ground.friction={ground.friction}", "feedback=velocity_sensor"]


Options = LoopOptions


class _StraightLine(LoopOptions):
    """Options of ``straight_line``: vehicle and overrides of the experiment."""

    vehicle: str = parameter(VEHICLE)
    """a file of config/vehicles/"""


OPTIONS = {"straight_line": _StraightLine}


def run(options: LoopOptions, study: StudyRun) -> StudyResult:
    """Run an experiment and draw its figures."""
    changes = options.changes
    if isinstance(options, _StraightLine):
        changes = [*table_2_vehicle(study.experiments, options.vehicle), *changes]
    runs = run_experiment(study.experiments, study.case, changes)
    for number, drawing in _FIGURES[study.case].items():
        figure, columns = drawing(runs)
        study.figure(f"figure_{number}.png", figure)
        study.columns(f"figure_{number}.csv", columns)
    return study.result(runs.metrics)


Drawing = Callable[[ExperimentRuns], tuple[Figure, Mapping[str, Any]]]
"""Draws one figure of the dissertation; returns it with its data by ``name [unit]``."""


def _over_time(variant: str, *, errors: bool = True) -> Drawing:
    """Draw velocity and yaw rate of a variant over time, and below the errors of all wheels."""

    def drawing(runs: ExperimentRuns) -> tuple[Figure, Mapping[str, Any]]:
        history = runs.histories[variant]
        labels = ("velocity [m/s], [rad/s]", "error $s_i$ [m/s]")[: 2 if errors else 1]
        title = f"{runs.configurations[variant].description}: {variant}"
        figure, panels = _rows(title, labels)
        colors = (style.BLUE, style.VERMILLION, style.GREEN)
        for values, label, color in zip(history.twist.T, _LABELS, colors, strict=True):
            panels[0].plot(history.braking_time, values, color=color, label=label)
        for axes in panels[1:]:
            error = while_braking(history, history.error)
            for column, name in enumerate(history.wheel_names):
                look: dict[str, Any] = {"color": style.wheel_color(column), "linewidth": 1.1}
                label = name.replace("_", " ")
                axes.plot(history.braking_time, error[:, column], label=label, **look)
        _finish(panels, [history])
        columns = _twist_columns(history) | (_error_columns(history) if errors else {})
        return figure, {data_table.TIME: history.braking_time, **columns}

    return drawing


def _from_above(*variants: str) -> Drawing:
    """Draw snapshots of some variants from above, with the paths as data."""

    def drawing(runs: ExperimentRuns) -> tuple[Figure, Mapping[str, Any]]:
        histories = {variant: runs.histories[variant] for variant in variants}
        configuration = runs.configurations[variants[0]]
        figure = top_view(scene_of(configuration), histories, title=configuration.description)
        return figure, _stacked(histories, _pose_columns)

    return drawing


def _compared(title: str, *, errors: bool) -> Drawing:
    """Draw errors or velocities of the assisted runs with and without noise."""

    def drawing(runs: ExperimentRuns) -> tuple[Figure, Mapping[str, Any]]:
        histories = {variant: runs.histories[variant] for variant in ("assisted", "noisy")}
        labels: Sequence[str] = _LABELS
        if errors:
            wheels = histories["noisy"].wheel_names
            labels = [f"{wheel.replace('_', ' ')}\n$s_i$ [m/s]" for wheel in wheels]
        shown = {
            name: (run, while_braking(run, run.error) if errors else run.twist)
            for name, run in zip(("no noise", "noisy feedback"), histories.values(), strict=True)
        }
        columns = _stacked(histories, _error_columns if errors else _twist_columns)
        return _over_one_another(shown, title, labels), columns

    return drawing


def _measured(runs: ExperimentRuns) -> tuple[Figure, Mapping[str, Any]]:
    """Draw the noisy feedback over the motion."""
    history, feedback = runs.histories["noisy"], runs.feedback["noisy"]
    shown = {"original": (history, history.twist), "noisy": (history, feedback)}
    figure = _over_one_another(shown, "Noise on the feedback", _LABELS)
    noisy = {f"noisy {name}": feedback[:, place] for place, name in enumerate(_COMPONENTS)}
    return figure, {data_table.TIME: history.braking_time, **_twist_columns(history), **noisy}


def _over_one_another(
    runs: Mapping[str, tuple[RunHistory, FloatArray]], title: str, labels: Sequence[str]
) -> Figure:
    """Draw values (T, K) of two runs over time, with one row of axes for each of the K labels."""
    figure, panels = _rows(title, labels)
    # The second line is thin, so that the first one stays visible.
    looks: tuple[dict[str, Any], ...] = (
        {"color": style.BLUE, "linewidth": 2.2, "zorder": 3},
        {"color": style.VERMILLION, "linewidth": 0.9, "zorder": 4},
    )
    for row, axes in enumerate(panels):
        for (name, (history, values)), look in zip(runs.items(), looks, strict=True):
            axes.plot(history.braking_time, values[:, row], label=name, **look)
    _finish(panels, [history for history, _ in runs.values()], legends=1)
    return figure


def _rows(title: str, labels: Sequence[str]) -> tuple[Figure, list[Axes]]:
    size = 9.0, 1.0 + 2.6 * len(labels)
    x = "time since braking [s]"
    figure, grid = style.panels(title, len(labels), size=size, x=x, y=labels, sharex=True)
    for axes in grid[:, 0]:
        axes.axhline(0.0, color=style.GRAY, linewidth=0.8)
    return figure, list(grid[:, 0])


def _finish(
    panels: Sequence[Axes], runs: Sequence[RunHistory], legends: int = 2, before: float = 0.2
) -> None:
    """Set a time axis that begins `before` braking [s], mark the start, and add the legends."""
    low = max(-before, min(float(run.braking_time[0]) for run in runs))
    high = max(float(run.braking_time[-1]) for run in runs)
    for place, axes in enumerate(panels):
        label = "pedal down" if place == 0 else None
        axes.axvline(0.0, color=style.BLACK, linestyle=":", linewidth=1.2, label=label)
        axes.set_xlim(low, high)
        if place < legends:
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=1.6)


def _stacked(
    histories: Mapping[str, RunHistory], columns: Callable[[RunHistory], Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the columns of several runs below each other."""
    tables = [{data_table.TIME: run.braking_time, **columns(run)} for run in histories.values()]
    names = [name for name, run in histories.items() for _ in run.stamp_ns]
    return {"variant": names} | {
        column: np.concatenate([table[column] for table in tables]) for column in tables[0]
    }


def _pose_columns(history: RunHistory) -> dict[str, Any]:
    pose = history.pose
    return {"x [m]": pose[:, 0], "y [m]": pose[:, 1], "yaw [deg]": pose[:, 2] * (180.0 / math.pi)}


def _twist_columns(history: RunHistory) -> dict[str, Any]:
    return dict(zip(_COMPONENTS, history.twist.T, strict=True))


def _error_columns(history: RunHistory) -> dict[str, Any]:
    names = [f"s {wheel} [m/s]" for wheel in history.wheel_names]
    return dict(zip(names, history.error.T, strict=True))


_FIGURES: Mapping[str, Mapping[int, Drawing]] = {
    "straight_line": {
        30: _from_above("unassisted", "assisted"),
        31: _over_time("unassisted"),
        32: _over_time("assisted"),
    },
    "three_wheel_diagonal": {
        33: _from_above("unassisted", "assisted"),
        34: _over_time("unassisted"),
        35: _over_time("assisted"),
    },
    "ice_patch": {
        36: _from_above("unassisted", "assisted"),
        37: _over_time("unassisted"),
        38: _over_time("assisted"),
    },
    "ice_patch_noisy": {
        39: _from_above("unassisted", "assisted", "noisy"),
        40: _measured,
        41: _compared("Errors with and without noise", errors=True),
        42: _compared("Velocities with and without noise", errors=False),
    },
    "turn_while_translate": {
        43: _from_above("unassisted", "zero", "cosine"),
        44: _over_time("unassisted", errors=False),
        45: _over_time("zero"),
        46: _over_time("cosine"),
        47: _from_above("cosine", "k1", "k7"),
        48: _over_time("k1"),
    },
}
