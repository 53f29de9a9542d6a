"""Experiments of chapter 3 with the line-scan odometry in the loop, against ideal feedback.

The dissertation assumes ideal feedback in chapter 3 and treats the line camera separately in
chapter 4. This study closes the loop with the line cameras. The velocity sensor used for comparison
is ideal, except in ``ice_patch_noisy``, which uses the sensor of Eqs. (60), (61).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_loop import compiled, loop
from omni_loop.history import RunHistory
from omni_loop.metrics import Metric, run_metrics
from omni_platform.command_options import overrides_option
from omni_platform.configuration import Configuration, parameter
from omni_platform.quantities import FloatArray
from omni_studies.studies import braking
from omni_studies.study import StudyResult, StudyRun

_DIFFERENCES = {
    "orientation_change": "deg",
    "stopping_distance": "m",
    "lateral_deviation": "m",
    "brake_switchings": "1",
}
_ODOMETRY = ("twist_rmse", "yaw_rate_rmse", "fail_safe_share")
_FEEDBACK = {"sensor": "velocity sensor", "optical": "line-scan odometry"}
_REPEATED = {("ice_patch_noisy", "assisted")}  # optical run equals that of ice_patch


class Options(Configuration):
    """Experiments to compare."""

    experiment: tuple[str, ...] = parameter(
        tuple(case for case in braking.CASES if case not in braking.RUNS)
    )
    """experiment to run"""
    overrides: tuple[str, ...] = overrides_option()


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """One variant of an experiment, run with both kinds of feedback.

    Attributes:
        experiment: name of the experiment.
        variant: name of its variant.
        runs: the run with the experiment's velocity sensor as ``sensor``, and the run with the
            line-scan odometry as ``optical``.
    """

    experiment: str
    variant: str
    runs: Mapping[str, RunHistory]

    @property
    def case(self) -> str:
        """Name of experiment and variant together."""
        return f"{self.experiment}_{self.variant}"

    @property
    def words(self) -> str:
        """Experiment and variant as text for a reader."""
        return f"{self.experiment.replace('_', ' ')}: {self.variant}"


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run every assisted variant with both kinds of feedback and report the differences."""
    comparisons = _compare(options, study)
    metrics = {key: m for one in comparisons for key, m in _metrics(one).items()}
    study.figure("stops.png", _draw_stops(comparisons, metrics))
    study.plot("orientations", _draw_orientations(comparisons))
    return study.result(metrics)


def _compare(options: Options, study: StudyRun) -> list[Comparison]:
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
    comparisons: list[Comparison] = []
    for (experiment, variant), (sensor, optical) in pairs.items():
        study.report(len(comparisons) / len(pairs), f"{experiment} {variant}")
        runs = compiled.run_fast_loop(sensor), loop.run_closed_loop(optical)
        histories = dict(zip(_FEEDBACK, runs, strict=True))
        comparisons.append(Comparison(experiment, variant, histories))
    return comparisons


def _metrics(comparison: Comparison) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    sensor, optical = (run_metrics(history) for history in comparison.runs.values())
    case = comparison.case
    for quantity, unit in _DIFFERENCES.items():
        difference = optical[quantity].value - sensor[quantity].value
        metrics[f"{quantity}.{case}_sensor"] = sensor[quantity]
        metrics[f"{quantity}.{case}_optical"] = optical[quantity]
        metrics[f"{quantity}_difference.{case}"] = Metric(difference, unit)
    metrics |= {f"{quantity}.{case}": optical[quantity] for quantity in _ODOMETRY}
    metrics[f"odometry_lag.{case}"] = Metric(odometry_lag(comparison.runs["optical"]), "s")
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


def _turned(history: RunHistory) -> FloatArray:
    """Return the change of orientation since the start of braking [deg], shape (T,)."""
    yaw = history.pose[:, 2]
    start = history.brake_start or 0
    return np.asarray((yaw - yaw[start]) * (180.0 / math.pi), dtype=np.float64)


def _draw_stops(comparisons: Sequence[Comparison], metrics: Mapping[str, Metric]) -> Figure:
    """Draw the stops of all cases with both kinds of feedback, and their differences."""
    title = "Assisted braking with both kinds of feedback"
    inches = (10.0, 1.6 + 0.45 * len(comparisons))
    x = ("orientation change [deg]", "stopping distance [m]")
    figure, (panels,) = style.panels(title, 1, 2, size=inches, x=x, sharey=True)
    looks = (("sensor", style.BLUE, "o", 9), ("optical", style.VERMILLION, "D", 5))
    for axes, quantity in zip(panels, ("orientation_change", "stopping_distance"), strict=True):
        for row, one in enumerate(comparisons):
            values = [metrics[f"{quantity}.{one.case}_{feedback}"].value for feedback in _FEEDBACK]
            axes.plot(values, [row, row], color=style.GRAY, linewidth=1.5, zorder=2)
            for value, (feedback, color, marker, size) in zip(values, looks, strict=True):
                look = {"color": color, "ms": size, "zorder": 3, "clip_on": False}
                label = "" if row else _FEEDBACK[feedback]
                axes.plot([value], [row], marker, label=label, **look)
            words = f"{values[1] - values[0]:+.2f}"
            style.note(axes, words, (max(values), row), (9, 0), va="center")
        axes.margins(x=0.14)
        axes.set_xlim(left=0.0)
    panels[0].set_yticks(range(len(comparisons)), [one.words for one in comparisons])
    panels[0].invert_yaxis()
    style.legend_below(figure, 2)
    return figure


def _draw_orientations(comparisons: Sequence[Comparison], most: int = 4) -> Figure:
    """Draw the orientation over time, for all cases with both kinds of feedback."""
    columns = min(most, len(comparisons))
    rows = -(-len(comparisons) // columns)
    figure, grid = style.panels("", rows, columns, size=(3.3 * columns + 0.6, 2.7 * rows + 0.7))
    panels = grid.ravel()
    for axes in panels[len(comparisons) :]:
        axes.set_visible(False)
    looks = {"sensor": (style.BLUE, 2.4), "optical": (style.VERMILLION, 1.2)}
    for axes, comparison in zip(panels, comparisons, strict=False):
        for feedback, history in comparison.runs.items():
            start, (color, width) = history.brake_start or 0, looks[feedback]
            time, angle = history.braking_time[start:], _turned(history)[start:]
            axes.plot(time, angle, color=color, linewidth=width, label=_FEEDBACK[feedback])
        axes.set_title(comparison.words)
    figure.supxlabel("time since braking [s]")
    figure.supylabel("orientation [deg]")
    style.legend_below(figure, 2)
    return figure
