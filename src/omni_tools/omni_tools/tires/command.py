"""``./omni fit-tire``: fit a tire model to measured forces.

Estimate the parameters of a tire model from measured forces. Write a tire file that a vehicle can
use, and a figure that compares the data with the curve.
"""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core import configuration
from omni_core.commands.command_options import CommandOptions, option
from omni_core.commands.command_report import Report, estimate, estimate_table, write_text
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_tools.tires.data import TireData
    from omni_tools.tires.fit import TireFit

WORK = "fitting the tire"


class Options(CommandOptions):
    """Options of ``omni fit-tire``."""

    data: Path = option(positional=True, metavar="DATA.csv")
    """file whose first line names the columns `slip` [1], `load` [N] and `force` [N]"""
    model: str = option("tmeasy")
    """tire model, such as `tmeasy`, `linear` or `magic_formula`"""
    wheel_radius: float = option(0.2, unit="m", above=0.0, maximum=2.0)
    """radius of the wheel, from which tire stiffness and damping are estimated"""
    out: Path | None = option(None, metavar="DIR")
    """folder for tire file and figure (default: results/fit-tire/DATA)"""


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Fit the tire, write its parameters, and draw the fit."""
    from omni_runs.figures.style import save_figure
    from omni_sim.tire.models import MODELS
    from omni_tools.tires.data import TireDataError, read_tire_data
    from omni_tools.tires.fit import fit_figure, fit_tire

    configuration.check_choice("--model", options.model, MODELS)
    try:
        data = read_tire_data(options.data)
        fit = fit_tire(data, options.model)
    except (TireDataError, configuration.WorkError) as error:
        raise type(error)(f"{options.data}: {error}") from None
    name = options.data.stem
    folder = workspace.results(options.out, "fit-tire", name)
    tire = write_text(folder / f"{name}.yaml", _tire_file(fit, options, data))
    metrics = _entries(fit, options.model, data)
    figure = fit_figure(data, fit, f"{options.data.name} and its {options.model}")
    return Report(
        metrics=metrics,
        text=(
            estimate_table(metrics),
            f"from the loads of the data: {_given(fit, options.model)}",
            f"{data.slip.size} rows, differences of {fit.residual:.3g} N",
        ),
        files=(tire, save_figure(figure, folder.resolve() / f"{name}.png")),
        hints=(
            f"draw it: {shlex.join(('./omni', 'show', str(tire), '--kind', 'tires'))}",
            f"use it: write tire: {tire} in the file of a vehicle",
        ),
        summary=folder,
    )


def _entries(fit: TireFit, model: str, data: TireData) -> dict[str, Any]:
    entries = {
        f"{key.replace('.', '_')}.{model}": estimate(value, fit.unit(key), error, bounded=fixed)
        for key, value, error, fixed in _rows(fit)
    }
    entries[f"residual.{model}"] = {"value": fit.residual, "unit": "N"}
    entries[f"rows.{model}"] = {"value": float(data.slip.size), "unit": "1"}
    return entries


def _given(fit: TireFit, model: str) -> str:
    """Return the parameters that are not fitted, such as the loads of the fitted forces."""
    return ", ".join(
        f"{key.replace('_', ' ')} {value:g} {fit.unit(key)}"
        for key, value in fit.mapping[model].items()
        if isinstance(value, float) and key not in fit.keys
    )


def _rows(fit: TireFit) -> list[tuple[str, float, float, bool]]:
    return [
        (key, float(value), float(error), bool(fixed))
        for key, value, error, fixed in zip(
            fit.keys, fit.values, fit.standard_errors, fit.at_bound, strict=True
        )
    ]


def _tire_file(fit: TireFit, options: Options, data: TireData) -> str:
    """Return the YAML text of a tire file, which a vehicle can refer to by name."""
    from omni_runs.yaml_files import commented_yaml
    from omni_tools.vehicles.estimates import tire_stiffness

    model, source = options.model, options.data.name
    mapping = fit.mapping | tire_stiffness(fit.tire.largest_load, options.wheel_radius)
    lines = [
        f"{model} fitted to {data.slip.size} rows of {source}, loads from "
        f"{data.load.min():g} to {data.load.max():g} N,",
        f"slips from {data.slip.min():g} to {data.slip.max():g}; differences {fit.residual:.3g} "
        "N (standard deviation).",
        "Stiffness and damping do not follow from steady data: estimates from load and radius.",
        "Values with their standard errors:",
    ]
    lines += [
        f"  {key} = {value:.6g} +- {error:.2g}{' (on its bound)' if fixed else ''}"
        for key, value, error, fixed in _rows(fit)
    ]
    return commented_yaml(mapping, "\n".join(lines))
