"""Chapter 3 with the line-scan odometry in the loop, compared with ideal feedback.

The velocity sensor is ideal except in ``ice_patch_noisy``, which uses that of Eqs. (60), (61).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omni_loop.metrics import Metric
from omni_platform.command_options import overrides_option
from omni_platform.configuration import Configuration, parameter
from omni_studies.braking import feedback_comparison, feedback_figures
from omni_studies.study import StudyResult, StudyRun

_DIFFERENCES = {
    "orientation_change": "deg",
    "stopping_distance": "m",
    "lateral_deviation": "m",
    "brake_switchings": "1",
}
_ODOMETRY = ("twist_rmse", "yaw_rate_rmse", "fail_safe_share")


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Experiments to compare."""

    experiment: tuple[str, ...] = parameter(feedback_comparison.EXPERIMENTS)
    """experiment to run"""
    overrides: tuple[str, ...] = overrides_option()


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run every assisted variant with either feedback and report the difference."""
    comparisons = feedback_comparison.compare(
        study.experiments, options.experiment, options.overrides, study.report
    )
    study.columns("stops.csv", _columns(comparisons))
    study.columns("orientations.csv", _orientation_columns(comparisons))
    study.figure("stops.png", feedback_figures.stops(comparisons))
    study.figure("orientations.png", feedback_figures.orientations(comparisons))
    return study.result(_metrics(comparisons))


def _metrics(comparisons: Sequence[feedback_comparison.Comparison]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for comparison in comparisons:
        sensor, optical = comparison.sensor_metrics, comparison.optical_metrics
        case = comparison.case
        for quantity, unit in _DIFFERENCES.items():
            difference = optical[quantity].value - sensor[quantity].value
            metrics[f"{quantity}.{case}_sensor"] = sensor[quantity]
            metrics[f"{quantity}.{case}_optical"] = optical[quantity]
            metrics[f"{quantity}_difference.{case}"] = Metric(difference, unit)
        metrics |= {f"{quantity}.{case}": optical[quantity] for quantity in _ODOMETRY}
        metrics[f"odometry_lag.{case}"] = Metric(
            feedback_comparison.odometry_lag(comparison.optical), "s"
        )
    return metrics


def _columns(comparisons: Sequence[feedback_comparison.Comparison]) -> dict[str, Any]:
    columns: dict[str, Any] = {
        "experiment": [comparison.experiment for comparison in comparisons],
        "variant": [comparison.variant for comparison in comparisons],
    }
    for quantity, unit in _DIFFERENCES.items():
        for words, metrics in (
            ("velocity sensor", [c.sensor_metrics for c in comparisons]),
            ("line-scan odometry", [c.optical_metrics for c in comparisons]),
        ):
            name = f"{quantity.replace('_', ' ')}, {words} [{unit}]"
            columns[name] = [case[quantity].value for case in metrics]
    for quantity in _ODOMETRY:
        values = [comparison.optical_metrics[quantity] for comparison in comparisons]
        columns[f"{quantity.replace('_', ' ')} [{values[0].unit}]"] = [m.value for m in values]
    columns["odometry lag [s]"] = [feedback_comparison.odometry_lag(c.optical) for c in comparisons]
    return columns


def _orientation_columns(comparisons: Sequence[feedback_comparison.Comparison]) -> dict[str, Any]:
    runs = [
        (comparison, feedback, history)
        for comparison in comparisons
        for feedback, history in (("sensor", comparison.sensor), ("optical", comparison.optical))
    ]
    return {
        "case": [c.case for c, _, history in runs for _ in history.stamp_ns],
        "feedback": [feedback for _, feedback, history in runs for _ in history.stamp_ns],
        "time since braking [s]": np.concatenate([h.braking_time for _, _, h in runs]),
        "orientation [deg]": np.concatenate([feedback_comparison.turned(h) for _, _, h in runs]),
    }
