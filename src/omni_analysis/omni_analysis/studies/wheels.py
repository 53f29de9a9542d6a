"""The single-roller wheel against the wheel of individual rollers: forces, motion, cost.

Both platforms drive, brake and are pushed sideways on the single-roller wheel (section 2.4.2), on
the same with the contact of rollers (section 2.3.2), and on wheels of free rollers (section 2.4.1).
Forces and motions of the last are compared with the first in the mean over the wheel angles. The
study also refines the step, parks on a slope and after a stop, and measures what a wheel costs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omni_analysis.figures.data_table import write_table
from omni_analysis.figures.style import save_figure
from omni_analysis.loop.metrics import Metric
from omni_analysis.studies import StudyResult, StudyRun, claim
from omni_analysis.wheels.cost import DURATION, processor_times
from omni_analysis.wheels.figures import draw_contact, draw_differences, draw_forces, draw_motions
from omni_analysis.wheels.trials import (
    CONTACT,
    ROLLERS,
    SINGLE,
    TRIALS,
    Outcome,
    creep,
    force_difference,
    force_trace,
    motion_difference,
    movement_after_stop,
    outcome,
    start_angles,
    stopping_distance,
    with_wheels,
)
from omni_platform.configuration import Configuration, parameter
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import DEFAULT_PHYSICS_STEP

_PLATFORMS = {"mecanum": "mecanum_forklift", "three_wheel": "three_wheel_robot"}
_TITLES = {"mecanum": "Mecanum forklift", "three_wheel": "Three-wheeled robot, rollers at 0 deg"}
_MODELS = {
    SINGLE: "single roller",
    CONTACT: "single roller, contact of rollers",
    ROLLERS: "individual rollers",
}
_COUNTS = (6, 8, 12, 16, 24)
_COMPARED = 12  # rollers of the wheels in figures and metrics
_COSTED = 6  # rollers of the wheels whose cost is measured, as in section 2.4.1
_AGREEMENT, _REFINEMENT, _STANDSTILL = 0.05, 0.01, 0.001  # [1], [1], [m]
_REPEATS = 40
_TWO_ORDERS = 10.0**1.5  # is nearer to two orders of magnitude than to one

# By vehicle, then trial, then number of rollers.
Outcomes = dict[str, dict[str, dict[int, Outcome]]]


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """How much is averaged."""

    starts: int = parameter(
        16, description="start angles of the wheels to average over", minimum=2, maximum=1000
    )
    seed: int = parameter(1, description="of the start angles", minimum=0)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Compare the wheels and write figures, data and metrics."""
    vehicles = {
        name: study.experiments.load("straight_line", "unassisted", [f"vehicle={vehicle}"]).vehicle
        for name, vehicle in _PLATFORMS.items()
    }
    singles: dict[str, dict[str, Outcome]] = {}
    contacts: dict[str, dict[str, Outcome]] = {}
    rollers: Outcomes = {}
    for name, vehicle in vehicles.items():
        angles = start_angles(options.starts, len(vehicle.wheels), options.seed)
        single, contact = (with_wheels(vehicle, model, _COMPARED) for model in (SINGLE, CONTACT))
        singles[name] = {key: outcome(single, trial, angles[:1]) for key, trial in TRIALS.items()}
        contacts[name] = {key: outcome(contact, trial, angles) for key, trial in TRIALS.items()}
        rollers[name] = {
            key: {
                count: outcome(with_wheels(vehicle, ROLLERS, count), trial, angles)
                for count in _COUNTS
            }
            for key, trial in TRIALS.items()
        }
    metrics = _agreement(singles, rollers) | _standing(vehicles) | _cost(vehicles["mecanum"])
    files = [
        *_draw(vehicles, singles, contacts, rollers, study.folder),
        _write(singles, rollers, study.folder / "differences.csv"),
    ]
    return StudyResult(metrics, tuple(files), _findings(metrics))


def _agreement(singles: dict[str, dict[str, Outcome]], rollers: Outcomes) -> dict[str, Metric]:
    metrics = {}
    for name, trials in rollers.items():
        for key, by_count in trials.items():
            single, compared = singles[name][key], by_count[_COMPARED]
            for kind, value in (
                ("force", force_difference(compared, single)),
                ("motion", motion_difference(compared, single)),
            ):
                metrics[f"{kind}_difference.{name}_{key}"] = Metric(value, "1", limit=_AGREEMENT)
            # The largest of all wheels with at least as many rollers.
            worst = max(
                difference(other, single)
                for count, other in by_count.items()
                if count >= _COMPARED
                for difference in (force_difference, motion_difference)
            )
            metrics[f"worst_difference.{name}_{key}"] = Metric(worst, "1", limit=_AGREEMENT)
    return metrics


def _standing(vehicles: Mapping[str, VehicleConfiguration]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for name, vehicle in vehicles.items():
        for model in _MODELS:
            wheeled = with_wheels(vehicle, model, _COMPARED)
            coarse = stopping_distance(wheeled, DEFAULT_PHYSICS_STEP)
            fine = stopping_distance(wheeled, 0.5 * DEFAULT_PHYSICS_STEP)
            # On one roller, and where two share the load.
            crept = max(creep(wheeled, angle) for angle in (0.0, np.pi / _COMPARED))
            case = f"{name}_{model}"
            metrics |= {
                f"step_change.{case}": Metric(abs(coarse / fine - 1.0), "1", limit=_REFINEMENT),
                f"creep.{case}": Metric(crept, "m", limit=_STANDSTILL),
                f"moved_after_stop.{case}": Metric(
                    movement_after_stop(wheeled), "m", limit=_STANDSTILL
                ),
            }
    return metrics


def _cost(vehicle: VehicleConfiguration) -> dict[str, Metric]:
    times = processor_times(
        {model: with_wheels(vehicle, model, _COSTED) for model in _MODELS}, _REPEATS
    )
    ratio = times[ROLLERS] / times[SINGLE]
    metrics = {
        f"real_time_factor.{model}": Metric(DURATION / float(np.min(spent)), "1")
        for model, spent in times.items()
    }
    return metrics | {
        "cost_ratio.rollers_over_single": Metric(float(np.median(ratio)), "1", reference=100.0),
        "cost_ratio_low.rollers_over_single": Metric(float(np.quantile(ratio, 0.1)), "1"),
        "cost_ratio_high.rollers_over_single": Metric(float(np.quantile(ratio, 0.9)), "1"),
        "physics_step.rollers": Metric(DEFAULT_PHYSICS_STEP, "s"),
    }


def _draw(
    vehicles: Mapping[str, VehicleConfiguration],
    singles: dict[str, dict[str, Outcome]],
    contacts: dict[str, dict[str, Outcome]],
    rollers: Outcomes,
    folder: Path,
) -> list[Path]:
    geometries = [
        with_wheels(vehicles["mecanum"], ROLLERS, count).roller_geometries[0]
        for count in (_COSTED, _COMPARED)
    ]
    labels = {
        f"{label}{f', {count}' if model != SINGLE else ''}": (model, count)
        for model, label in _MODELS.items()
        for count in ((_COSTED, _COMPARED) if model == ROLLERS else (_COMPARED,))
    }
    traces = {
        _TITLES[name]: {
            label: force_trace(with_wheels(vehicle, model, count), 0, 2.0 * np.pi / 3.0)
            for label, (model, count) in labels.items()
        }
        for name, vehicle in vehicles.items()
    }
    motions = {
        _TITLES[name]: {
            trial: {
                _MODELS[SINGLE]: singles[name][trial],
                f"{_MODELS[CONTACT]}, {_COMPARED}": contacts[name][trial],
                f"{_MODELS[ROLLERS]}, {_COMPARED}": rollers[name][trial][_COMPARED],
            }
            for trial in ("brake", "push")
        }
        for name in vehicles
    }
    differences = {
        _TITLES[name]: {
            kind: {
                TRIALS[key].title: [difference(by[count], singles[name][key]) for count in _COUNTS]
                for key, by in rollers[name].items()
            }
            for kind, difference in (("motion", motion_difference), ("force", force_difference))
        }
        for name in vehicles
    }
    return [
        save_figure(draw_contact(geometries), folder / "contact.png"),
        save_figure(draw_forces(traces), folder / "forces.png"),
        save_figure(draw_motions(motions), folder / "motions.png"),
        save_figure(draw_differences(_COUNTS, differences, _AGREEMENT), folder / "differences.png"),
    ]


def _findings(metrics: Mapping[str, Metric]) -> tuple[str, ...]:
    agreeing = {key: metric for key, metric in metrics.items() if key.startswith("worst_")}
    largest = max(agreeing, key=lambda key: agreeing[key].value)
    ratio = metrics["cost_ratio.rollers_over_single"].value
    return (
        claim(
            "A single roller moves as individual rollers do (section 2.4.2)",
            f"from {_COMPARED} rollers on they differ by at most "
            f"{100.0 * agreeing[largest].value:.1f} % ({largest.partition('.')[2]})",
            holds=agreeing[largest].value <= _AGREEMENT,
        ),
        claim(
            "Individual rollers cost two orders of magnitude more",
            f"a wheel of {_COSTED} rollers keeps the processor {ratio:.1f} times as long",
            holds=ratio >= _TWO_ORDERS,
        ),
        "The dissertation's was a general multibody program that carries every roller as a body "
        "and stops at every change of contact. Here only the rollers on the ground are solved, "
        "with the step of the single roller",
    )


def _write(singles: dict[str, dict[str, Outcome]], rollers: Outcomes, path: Path) -> Path:
    """Write one row per vehicle, trial and number of rollers."""
    header = ("vehicle", "trial", "rollers", "motion_difference", "force_difference")
    rows = (
        (
            name,
            key,
            count,
            motion_difference(result, singles[name][key]),
            force_difference(result, singles[name][key]),
        )
        for name, trials in rollers.items()
        for key, by_count in trials.items()
        for count, result in by_count.items()
    )
    return write_table(path, header, rows, digits=6)
