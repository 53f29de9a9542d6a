"""Draw the tire models (Figures 4 to 6) and check convergence, rest and zero slip of vehicles."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from omni_loop.experiment import ExperimentLibrary
from omni_loop.metrics import Metric
from omni_platform.configuration import Configuration, ConfigurationError, parameter
from omni_sim.tire.models.tmeasy import TMeasyConfiguration
from omni_sim.tire.tire import Tire, TireConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_studies.study import StudyResult, StudyRun
from omni_studies.tires import figures as tire_figures
from omni_studies.tires import trials as tire_trials

_EXPERIMENT = "straight_line"  # lends its vehicle
_TABLE_1 = "rill_table_1"
_TIRES = (_TABLE_1, "linear", "magic_formula")
_SLOPE = 0.05  # of the parked vehicle [1]
# Limits of the project: share of a stopping distance [1], creep in a minute [m].
_LARGEST_CHANGE, _LARGEST_CREEP = 0.01, 1e-3


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """The tires and the vehicle."""

    tire: tuple[str, ...] = parameter(_TIRES)
    """a file of config/tires/, or a path that ends in .yaml"""
    vehicle: str = parameter("mecanum_forklift")
    """vehicle that stands, drives and brakes on them"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Draw the characteristics, and try each tire under the vehicle."""
    table = _vehicle(study.experiments, options.vehicle, _TABLE_1).tire.tmeasy
    vehicles = {}
    for name in options.tire:
        case = Path(name).stem
        if case in vehicles:
            raise ConfigurationError("--tire", f"two of the tires are called {case!r}")
        vehicles[case] = _vehicle(study.experiments, options.vehicle, name)
    tires = {name: Tire(vehicle.tire) for name, vehicle in vehicles.items()}
    _draw(table, tires, study)
    _write(table, tires, study)
    metrics = _characteristic_metrics(table)
    for name, vehicle in vehicles.items():
        give, creep = tire_trials.slope_creep(vehicle, _SLOPE)
        change = tire_trials.stopping_distance_change(vehicle)
        metrics |= {
            f"stopping_distance_change.{name}": Metric(change, "1", at_most=_LARGEST_CHANGE),
            f"slope_creep.{name}": Metric(creep, "m", at_most=_LARGEST_CREEP),
            f"slope_give.{name}": Metric(give, "m"),
            f"creep_after_stop.{name}": Metric(
                tire_trials.creep_after_stop(vehicle), "m", at_most=_LARGEST_CREEP
            ),
            f"zero_crossing_unevenness.{name}": Metric(
                tire_trials.zero_crossing_unevenness(vehicle), "1"
            ),
        }
    return study.result(metrics)


def _vehicle(library: ExperimentLibrary, vehicle: str, tire: str) -> VehicleConfiguration:
    overrides = (f"vehicle={vehicle}", f"vehicle.tire={tire}")
    variant = library.variants(_EXPERIMENT)[0]
    return library.load(_EXPERIMENT, variant, overrides).vehicle


def _draw(table: TMeasyConfiguration, tires: Mapping[str, Tire], study: StudyRun) -> None:
    loads = np.linspace(0.25, 1.0, 4) * table.nominal_load_2
    figures: dict[str, Figure] = {
        "figure_4": tire_figures.slip_figure(table, table.nominal_load_1),
        "figure_5": tire_figures.load_figure(
            _longitudinal(table), loads, "Load dependence of the force (Figure 5)"
        ),
        "figure_6": tire_figures.interpolation_figure(table),
        "combined_slip": tire_figures.combined_figure(table, table.nominal_load_1),
        "models": tire_figures.model_figure(tires, (table.nominal_load_1, table.nominal_load_2)),
    }
    for name, figure in figures.items():
        study.figure(f"{name}.png", figure)


def _longitudinal(table: TMeasyConfiguration) -> Tire:
    return Tire(TireConfiguration(tmeasy=table))


def _write(table: TMeasyConfiguration, tires: Mapping[str, Tire], study: StudyRun) -> None:
    slips = np.linspace(0.0, 0.6, 121)
    loads = np.linspace(0.25, 1.0, 4) * table.nominal_load_2
    model = _longitudinal(table)
    overload = np.linspace(0.0, 2.5 * table.nominal_load_2, 101)
    parabola = tire_figures.interpolation_curve(table, overload)
    rows: Iterable[tuple[Any, ...]] = (
        (s, float(model.force(s, table.nominal_load_1))) for s in slips
    )
    study.table("figure_4.csv", ("slip", "force_N"), rows)
    rows = ((load, s, float(model.force(s, load))) for load in loads for s in slips)
    study.table("figure_5.csv", ("load_N", "slip", "force_N"), rows)
    rows = (
        (load, value, model.curve(load).slope, int(model.overloaded(load)))
        for load, value in zip(overload, parabola, strict=True)
    )
    study.table("figure_6.csv", ("load_N", "parabola_N", "used_N", "overloaded"), rows)
    rows = (
        (name, tire.configuration.model, load, s, float(tire.force(s, load)))
        for name, tire in tires.items()
        for load in loads
        for s in slips
    )
    study.table("models.csv", ("tire", "model", "load_N", "slip", "force_N"), rows)


def _characteristic_metrics(table: TMeasyConfiguration) -> dict[str, Metric]:
    """Return the values of Table 1 from the computed curves."""
    model = _longitudinal(table)
    slips = np.linspace(0.0, 2.0, 20001)
    h = 1e-7
    metrics: dict[str, Metric] = {}
    printed = {"load_1": (3000.0, 50000.0, 0.15, 3000.0, 2800.0)}
    printed["load_2"] = (6000.0, 75000.0, 0.18, 4500.0, 4200.0)
    for case, (load, slope, peak_slip, peak, slide) in printed.items():
        force = model.force(slips, load)
        metrics |= {
            f"slope.{case}": Metric(float(model.force(h, load)) / h, "N", reference=slope),
            f"peak_slip.{case}": Metric(float(slips[np.argmax(force)]), "1", reference=peak_slip),
            f"peak_force.{case}": Metric(float(np.max(force)), "N", reference=peak),
            f"slide_force.{case}": Metric(float(force[-1]), "N", reference=slide),
        }
    return metrics
