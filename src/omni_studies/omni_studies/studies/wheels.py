"""The single-roller wheel against the wheel of individual rollers: forces, motion, cost.

Both platforms drive, brake and are pushed sideways with the single-roller wheel (section 2.4.2),
with the single-roller wheel and the contact of rollers (section 2.3.2), and with individual rollers
(section 2.4.1). Forces and motions of the last are compared with the first in the mean over the
wheel angles. The study also refines the step, parks on a slope and after a stop, and measures what
a wheel costs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from omni_figures.data_table import write_records
from omni_loop.metrics import Metric
from omni_platform.configuration import Configuration, parameter
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import DEFAULT_PHYSICS_STEP
from omni_studies.study import StudyResult, StudyRun
from omni_studies.wheels.cost import DURATION, processor_times
from omni_studies.wheels.figures import draw_contact, draw_differences, draw_forces, draw_motions
from omni_studies.wheels.trials import (
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

# By vehicle, then trial, then number of rollers.
Outcomes = dict[str, dict[str, dict[int, Outcome]]]


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Extent of the averages."""

    starts: int = parameter(16, minimum=2, maximum=1000)
    """start angles of the wheels to average over"""
    seed: int = parameter(1, minimum=0)
    """of the start angles"""


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
    rows = _differences(singles, rollers)
    metrics = _agreement(rows) | _standing(vehicles) | _cost(vehicles["mecanum"])
    _draw(vehicles, singles, contacts, rollers, rows, study)
    study.written.append(write_records(study.folder / "differences.csv", rows))
    return study.result(metrics)


class Difference(NamedTuple):
    """Relative differences between individual rollers and the single roller."""

    vehicle: str
    trial: str
    rollers: int
    motion: Annotated[float, "1"]
    force: Annotated[float, "1"]


def _differences(
    singles: Mapping[str, Mapping[str, Outcome]], rollers: Outcomes
) -> list[Difference]:
    return [
        Difference(
            name,
            key,
            count,
            motion_difference(result, singles[name][key]),
            force_difference(result, singles[name][key]),
        )
        for name, trials in rollers.items()
        for key, by_count in trials.items()
        for count, result in by_count.items()
    ]


def _agreement(rows: Sequence[Difference]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for row in rows:
        case = f"{row.vehicle}_{row.trial}"
        if row.rollers == _COMPARED:
            metrics[f"force_difference.{case}"] = Metric(row.force, "1", at_most=_AGREEMENT)
            metrics[f"motion_difference.{case}"] = Metric(row.motion, "1", at_most=_AGREEMENT)
        # The largest of all wheels with at least as many rollers.
        if row.rollers >= _COMPARED:
            name = f"worst_difference.{case}"
            before = metrics[name].value if name in metrics else 0.0
            worst = max(before, row.force, row.motion)
            metrics[name] = Metric(worst, "1", at_most=_AGREEMENT)
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
                f"step_change.{case}": Metric(abs(coarse / fine - 1.0), "1", at_most=_REFINEMENT),
                f"creep.{case}": Metric(crept, "m", at_most=_STANDSTILL),
                f"moved_after_stop.{case}": Metric(
                    movement_after_stop(wheeled), "m", at_most=_STANDSTILL
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
    rows: Sequence[Difference],
    study: StudyRun,
) -> None:
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
        title: {
            kind: {
                trial.title: [
                    getattr(row, kind) for row in rows if (row.vehicle, row.trial) == (name, key)
                ]
                for key, trial in TRIALS.items()
            }
            for kind in ("motion", "force")
        }
        for name, title in _TITLES.items()
    }
    study.figure("contact.png", draw_contact(geometries))
    study.figure("forces.png", draw_forces(traces))
    study.figure("motions.png", draw_motions(motions))
    study.figure("differences.png", draw_differences(_COUNTS, differences, _AGREEMENT))
