"""Experiments of section 3.6 without the ROS graph: Figures 30 to 48 and Table 2.

A figure of the dissertation is written to ``figure_<number>.png``, and its data to
``figure_<number>.csv``. The dissertation's assistant uses only the twist, whereas the assistant of
this project also compares the twist with IMU and wheel speeds. If an experiment uses IMU and wheel
speeds, the assisted variant is repeated without them, as ``<variant>_twist_alone``.

``table2`` brakes the identified vehicle of ``config/``. ``--identify`` repeats the search for this
vehicle; ``--assumptions`` changes one assumption at a time.

The dissertation assumes ideal feedback in chapter 3 and treats the line camera separately in
chapter 4. ``optical`` closes the loop with the line cameras. The velocity sensor used for
comparison is ideal, except in ``ice_patch_noisy``, which uses the sensor of Eqs. (60), (61).
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from omni_core.commands.command_options import overrides_option
from omni_core.configuration import Configuration, parameter
from omni_core.quantities import FloatArray
from omni_runs import compiled, loop
from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
from omni_runs.figures import style
from omni_runs.figures.scene import Scene
from omni_runs.figures.time_series import time_series, while_braking
from omni_runs.figures.top_view import top_view
from omni_runs.history import FastRun, RunHistory
from omni_runs.metrics import Metric, run_metrics
from omni_runs.options import LoopOptions
from omni_studies.identification import study as table_2
from omni_studies.identification.table_2 import TWIST_ALONE
from omni_studies.study import StudyResult, StudyRun

CASES = {
    "straight_line": "Emergency braking of the vehicle of Table 2, straight ahead: "
    "Figures 30 to 32",
    "three_wheel_diagonal": "The three-wheeled robot stops from a diagonal motion: Figures 33 "
    "to 35",
    "ice_patch": "Braking with a front wheel on ice: Figures 36 to 38",
    "ice_patch_noisy": "Braking on ice with noisy feedback, Eqs. (60), (61): Figures 39 to 42",
    "turn_while_translate": "Braking from a turn-while-translate maneuver, with every "
    "weighting: Figures 43 to 48",
    "table2": "Table 2: orientation change and stopping distance with each control law",
    "optical": "Experiments of chapter 3 with the line-scan odometry in the loop, against ideal "
    "feedback",
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
_DIFFERENCES = {
    "orientation_change": "deg",
    "stopping_distance": "m",
    "lateral_deviation": "m",
    "brake_switchings": "1",
}
_ODOMETRY = ("twist_rmse", "yaw_rate_rmse", "fail_safe_share")
_FEEDBACK = {"sensor": "velocity sensor", "optical": "line-scan odometry"}
_REPEATED = {("ice_patch_noisy", "assisted")}  # optical run equals that of ice_patch
_LABELS = ("$v_x$ [m/s]", "$v_y$ [m/s]", r"$\omega$ [rad/s]")
_BEFORE = 0.2  # time that is shown before the start of braking [s]


@dataclasses.dataclass(frozen=True)
class ExperimentRuns:
    """Configurations and results of all variants of an experiment.

    Attributes:
        configurations: configurations, keyed by variant.
        histories: time history of each variant's run, keyed by variant.
    """

    configurations: Mapping[str, ExperimentConfiguration]
    histories: Mapping[str, RunHistory]

    @property
    def metrics(self) -> dict[str, Metric]:
        """Metrics and largest error s_i of all variants, keyed by ``<quantity>.<variant>``."""
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
    """Return the largest magnitude of the error ``s_i`` of any wheel while braking [m/s]."""
    return float(np.max(np.abs(history.error[history.brake_start :])))


def run_experiment(
    library: ExperimentLibrary, experiment: str, overrides: Sequence[str]
) -> ExperimentRuns:
    """Run every variant of an experiment in one process.

    If the feedback is the velocity sensor, the fast loop is used. If it is the line-scan odometry,
    the loop with rendered cameras is used. In the fast loop, a variant with fault detection is also
    run without fault detection, as ``VARIANT_twist_alone``.

    Args:
        library: library that contains the experiment file.
        experiment: name of the experiment.
        overrides: ``dotted.key=value`` texts, applied to every variant.

    Raises:
        ConfigurationError: a name, key or value is invalid.
    """
    configurations = {
        variant: library.load(experiment, variant, overrides)
        for variant in library.variants(experiment, overrides)
    }
    for variant, configuration in list(configurations.items()):
        assistant = configuration.brake_assist
        if assistant.enabled and assistant.fault_detection and not configuration.uses_lines:
            alone = library.load(experiment, variant, (*overrides, TWIST_ALONE))
            configurations[variant + _ALONE] = alone
    histories: dict[str, RunHistory] = {}
    for variant, configuration in configurations.items():
        run = loop.run_closed_loop if configuration.uses_lines else compiled.run_fast_loop
        histories[variant] = run(configuration)
    return ExperimentRuns(configurations, histories)


def table_2_vehicle(library: ExperimentLibrary, vehicle: str = table_2.VEHICLE) -> list[str]:
    """Return the overrides that change ``straight_line`` into the dissertation's experiment.

    The overrides set the identified vehicle and ground, and a velocity sensor.

    Args:
        library: library that contains the experiment files.
        vehicle: name of a vehicle that replaces the identified vehicle.
    """
    ground = library.load("turn_while_translate", "unassisted").ground
    return [f"vehicle={vehicle}", f"ground.friction={ground.friction}", "feedback=velocity_sensor"]


Options = LoopOptions


class _StraightLine(LoopOptions):
    """Options of ``straight_line``: vehicle and overrides of the experiment."""

    vehicle: str = parameter(table_2.VEHICLE)
    """vehicle: a file of config/vehicles/, a path, or a vehicle's folder"""


class _Optical(Configuration):
    """Options of ``optical``: experiments to run and compare."""

    experiment: tuple[str, ...] = parameter(
        tuple(case for case in CASES if case not in ("table2", "optical"))
    )
    """experiment to run"""
    overrides: tuple[str, ...] = overrides_option()


OPTIONS = {"straight_line": _StraightLine, "table2": table_2.Options, "optical": _Optical}


def run(options: LoopOptions, study: StudyRun) -> StudyResult:
    """Run the experiment that has the name of the study, and draw the figures."""
    changes = options.changes
    if isinstance(options, _StraightLine):
        changes = [*table_2_vehicle(study.experiments, options.vehicle), *changes]
    runs = run_experiment(study.experiments, study.case, changes)
    for number, drawing in _FIGURES[study.case].items():
        study.plot(f"figure_{number}", drawing(runs))
    return study.result(runs.metrics)


Comparisons = Mapping[tuple[str, str], Mapping[str, RunHistory]]
"""Two runs of each experiment and variant: ``sensor`` with the velocity sensor, and ``optical``
with the line-scan odometry."""


def _optical(options: _Optical, study: StudyRun) -> StudyResult:
    """Run every assisted variant with both sources of feedback, and report the differences."""
    pairs = {}
    for experiment in options.experiment:
        for variant in study.experiments.variants(experiment):
            sensor, optical = (
                study.experiments.load(
                    experiment, variant, (*options.overrides, f"feedback={feedback}")
                )
                for feedback in ("velocity_sensor", "optical")
            )
            if sensor.brake_assist.enabled and (experiment, variant) not in _REPEATED:
                pairs[experiment, variant] = sensor, optical
    runs: dict[tuple[str, str], Mapping[str, RunHistory]] = {}
    metrics: dict[str, Metric] = {}
    for case, (sensor, optical) in pairs.items():
        study.report(len(runs) / len(pairs), " ".join(case))
        both = compiled.run_fast_loop(sensor), loop.run_closed_loop(optical)
        runs[case] = dict(zip(_FEEDBACK, both, strict=True))
        metrics |= _feedback_metrics("_".join(case), *both)
    study.figure("stops.png", _draw_stops(runs, metrics))
    study.plot("orientations", _draw_orientations(runs))
    return study.result(metrics)


def _feedback_metrics(
    case: str, by_sensor: RunHistory, by_odometry: RunHistory
) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    sensor, optical = run_metrics(by_sensor), run_metrics(by_odometry)
    for quantity, unit in _DIFFERENCES.items():
        difference = optical[quantity].value - sensor[quantity].value
        metrics[f"{quantity}.{case}_sensor"] = sensor[quantity]
        metrics[f"{quantity}.{case}_optical"] = optical[quantity]
        metrics[f"{quantity}_difference.{case}"] = Metric(difference, unit)
    metrics |= {f"{quantity}.{case}": optical[quantity] for quantity in _ODOMETRY}
    metrics[f"odometry_lag.{case}"] = Metric(odometry_lag(by_odometry), "s")
    return metrics


def odometry_lag(history: RunHistory) -> float:
    """Return the lag of the odometry's velocity while braking [s].

    A lag ``tau`` causes an error of ``-tau`` times the acceleration, from which ``tau`` is fitted.
    Noise that is independent of the acceleration does not affect the fit. The result is NaN if the
    odometry has no measurement.
    """
    start = history.brake_start or 0
    acceleration = np.gradient(history.twist[:, :2], history.time, axis=0)[start:]
    error = (history.estimate - history.twist)[start:, :2]
    known = history.measured[start:]
    square = float(np.sum(acceleration[known] ** 2))
    return -float(np.sum(error[known] * acceleration[known])) / square if square else math.nan


def _draw_stops(comparisons: Comparisons, metrics: Mapping[str, Metric]) -> Figure:
    """Draw the stops of all cases with both sources of feedback, and their differences."""
    title = "Assisted braking with both kinds of feedback; numbers: odometry minus sensor"
    inches = (10.0, 1.6 + 0.45 * len(comparisons))
    x = ("orientation change [deg]", "stopping distance [m]")
    figure, (panels,) = style.panels(title, 1, 2, size=inches, x=x, sharey=True)
    looks = (("sensor", style.BLUE, "o", 9), ("optical", style.VERMILLION, "D", 5))
    for axes, quantity in zip(panels, ("orientation_change", "stopping_distance"), strict=True):
        for row, case in enumerate(map("_".join, comparisons)):
            values = [metrics[f"{quantity}.{case}_{feedback}"].value for feedback in _FEEDBACK]
            axes.plot(values, [row, row], color=style.GRAY, linewidth=1.5, zorder=2)
            for value, (feedback, color, marker, size) in zip(values, looks, strict=True):
                look = {"color": color, "ms": size, "zorder": 3, "clip_on": False}
                label = "" if row else _FEEDBACK[feedback]
                axes.plot([value], [row], marker, label=label, **look)
            words = f"{round(values[1] - values[0], 2) + 0.0:+.2f}"  # adding 0 turns -0 into 0
            style.note(axes, words, (max(values), row), (9, 0), va="center")
        axes.margins(x=0.18)
        axes.set_xlim(left=0.0)
    panels[0].set_yticks(range(len(comparisons)), list(map(_case_in_words, comparisons)))
    panels[0].invert_yaxis()
    style.legend_below(figure, 2)
    return figure


def _case_in_words(case: tuple[str, str]) -> str:
    return f"{case[0].replace('_', ' ')}: {case[1]}"


def _draw_orientations(comparisons: Comparisons) -> Figure:
    """Draw the orientation over time, with both sources of feedback in one panel for each case."""
    count = len(comparisons)
    title = "Orientation [deg] over the time since braking [s]"
    figure, panels = style.tiles(title, count, min(count, 4), size=(3.45, 2.7))
    looks = {"sensor": (style.BLUE, 2.4), "optical": (style.VERMILLION, 1.2)}
    for axes, (case, runs) in zip(panels, comparisons.items(), strict=True):
        for feedback, history in runs.items():
            start, (color, width) = history.brake_start or 0, looks[feedback]
            yaw = history.pose[start:, 2]
            turned = np.degrees(yaw - yaw[0])
            time, label = history.braking_time[start:], _FEEDBACK[feedback]
            axes.plot(time, turned, color=color, linewidth=width, label=label)
        axes.set_title(_case_in_words(case))
    style.legend_below(figure, 2)
    return figure


RUNS = {"table2": table_2.run, "optical": _optical}

Drawing = Callable[[ExperimentRuns], Figure]
"""Draws one figure of the dissertation."""


def _over_time(variant: str) -> Drawing:
    """Return a function that draws velocity, yaw rate, s_i and enables of one variant over time."""
    return lambda runs: time_series(
        {variant: runs.histories[variant]}, title=runs.configurations[variant].description
    )


def _from_above(*variants: str) -> Drawing:
    """Return a function that draws snapshots of the given variants from above."""

    def drawing(runs: ExperimentRuns) -> Figure:
        configuration = runs.configurations[variants[0]]
        histories = {variant: runs.histories[variant] for variant in variants}
        return top_view(Scene.of(configuration), histories, title=configuration.description)

    return drawing


def _compared_errors(runs: ExperimentRuns) -> Figure:
    """Draw the errors s_i of the assisted runs with and without sensor noise."""
    plain, noisy = runs.histories["assisted"], runs.histories["noisy"]
    labels = [f"{wheel.replace('_', ' ')}\n$s_i$ [m/s]" for wheel in noisy.wheel_names]
    errors = {
        "no noise": (plain, while_braking(plain, plain.error)),
        "noisy feedback": (noisy, while_braking(noisy, noisy.error)),
    }
    return _over_one_another(errors, "Errors with and without noise", labels)


def _compared_velocities(runs: ExperimentRuns) -> Figure:
    """Draw the velocities of the assisted runs with and without sensor noise."""
    plain, noisy = runs.histories["assisted"], runs.histories["noisy"]
    twists = {"no noise": (plain, plain.twist), "noisy feedback": (noisy, noisy.twist)}
    return _over_one_another(twists, "Velocities with and without noise", _LABELS)


def _measured(runs: ExperimentRuns) -> Figure:
    """Draw the noisy feedback and the true motion."""
    history = runs.histories["noisy"]
    feedback = history.feedback if isinstance(history, FastRun) else history.estimate
    twists = {"original": (history, history.twist), "noisy": (history, feedback)}
    return _over_one_another(twists, "Noise on the feedback", _LABELS)


def _over_one_another(
    runs: Mapping[str, tuple[RunHistory, FloatArray]], title: str, labels: Sequence[str]
) -> Figure:
    """Draw the values of two runs over time, in one panel for each of K quantities.

    Args:
        runs: history and values, shape (T, K), of each run, keyed by label.
        title: title of the figure.
        labels: labels of the K quantities.
    """
    size, x = (9.0, 1.0 + 2.6 * len(labels)), "time since braking [s]"
    figure, grid = style.panels(title, len(labels), size=size, x=x, y=labels, sharex=True)
    # The second line is thin, so that the first one remains visible.
    looks: tuple[dict[str, Any], ...] = (
        {"color": style.BLUE, "linewidth": 2.2, "zorder": 3},
        {"color": style.VERMILLION, "linewidth": 0.9, "zorder": 4},
    )
    for row, axes in enumerate(grid[:, 0]):
        axes.axhline(0.0, color=style.GRAY, linewidth=0.8)
        axes.axvline(0.0, color=style.BLACK, linestyle=":", linewidth=1.2)
        for (name, (history, values)), look in zip(runs.items(), looks, strict=True):
            axes.plot(history.braking_time, values[:, row], label=name, **look)
    times = [history.braking_time for history, _ in runs.values()]
    grid[0, 0].set_xlim(max(-_BEFORE, min(t[0] for t in times)), max(t[-1] for t in times))
    grid[0, 0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=1.6)
    return figure


def _stop(first: int) -> dict[int, Drawing]:
    """Return the three figures of a stop, numbered consecutively from the given first number."""
    drawings = _from_above("unassisted", "assisted"), *map(_over_time, ("unassisted", "assisted"))
    return dict(enumerate(drawings, first))


_FIGURES: Mapping[str, Mapping[int, Drawing]] = {
    "straight_line": _stop(30),
    "three_wheel_diagonal": _stop(33),
    "ice_patch": _stop(36),
    "ice_patch_noisy": {
        39: _from_above("unassisted", "assisted", "noisy"),
        40: _measured,
        41: _compared_errors,
        42: _compared_velocities,
    },
    "turn_while_translate": {
        43: _from_above("unassisted", "zero", "cosine"),
        44: _over_time("unassisted"),
        45: _over_time("zero"),
        46: _over_time("cosine"),
        47: _from_above("cosine", "k1", "k7"),
        48: _over_time("k1"),
    },
}
