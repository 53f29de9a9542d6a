"""Braking on ice with noisy feedback, Eqs. (60), (61): Figures 39 to 42."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from omni_analysis.braking import figures as braking_figures
from omni_analysis.braking.study import (
    BrakingOptions,
    ExperimentRuns,
    Values,
    braking_study,
    from_above,
    keeps_orientation,
)
from omni_analysis.figures.data_table import TIME
from omni_analysis.studies import claim

_CLEAN, _NOISY = "assisted", "noisy"

Options = BrakingOptions


def _measured(runs: ExperimentRuns) -> tuple[Figure, Mapping[str, Any]]:
    noisy = runs.histories[_NOISY]
    told = {"original": (noisy, noisy.twist), "noisy": (noisy, runs.feedback[_NOISY])}
    figure = braking_figures.compare_velocities(told, "Noise on the feedback")
    return figure, _feedback_columns(runs)


def _errors(runs: ExperimentRuns) -> tuple[Figure, Mapping[str, Any]]:
    both = {"no noise": runs.histories[_CLEAN], "noisy feedback": runs.histories[_NOISY]}
    figure = braking_figures.compare_errors(both, "Errors with and without noise")
    return figure, _columns(runs, errors=True)


def _velocities(runs: ExperimentRuns) -> tuple[Figure, Mapping[str, Any]]:
    clean, noisy = runs.histories[_CLEAN], runs.histories[_NOISY]
    both = {"no noise": (clean, clean.twist), "noisy feedback": (noisy, noisy.twist)}
    figure = braking_figures.compare_velocities(both, "Velocities with and without noise")
    return figure, _columns(runs, errors=False)


def _feedback_columns(runs: ExperimentRuns) -> dict[str, Any]:
    history, told = runs.histories[_NOISY], runs.feedback[_NOISY]
    columns: dict[str, Any] = {TIME: history.braking_time}
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
        table = {TIME: history.braking_time}
        if errors:
            for place, wheel in enumerate(history.wheel_names):
                table[f"s {wheel} [m/s]"] = history.error[:, place]
        else:
            for place, component in enumerate(("v_x [m/s]", "v_y [m/s]", "yaw rate [rad/s]")):
                table[component] = history.twist[:, place]
        for column, values in table.items():
            columns.setdefault(column, []).extend(values.tolist())
    return columns


def _findings(values: Values) -> list[str]:
    free, turned = values["orientation_change.unassisted"], values["orientation_change.noisy"]
    longer = values["stopping_distance.noisy"] - values["stopping_distance.assisted"]
    aside = values["lateral_deviation.noisy"] - values["lateral_deviation.assisted"]
    return [
        claim(
            "With noise it does not swerve either",
            f"{turned:.1f} against {free:.1f} deg unassisted",
            holds=keeps_orientation(turned, free),
        ),
        claim(
            "Noise tells most on the stopping distance",
            f"{longer:+.2f} m of distance, {aside:+.2f} m aside, which an offset of the yaw rate "
            "brings: the remembered line turns with it",
            holds=abs(longer) > abs(aside),
        ),
    ]


run = braking_study(
    "ice_patch_noisy",
    {
        39: from_above(),
        40: _measured,
        41: _errors,
        42: _velocities,
    },
    _findings,
)
