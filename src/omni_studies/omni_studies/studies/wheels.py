"""Comparison of wheel models with each other and with MuJoCo.

In ``wheels``, a Mecanum forklift and a three-wheeled robot drive, brake and are pushed sideways.
Three wheel models are compared: the single-roller wheel (section 2.4.2), the single-roller wheel
with the moving contact of rollers (section 2.3.2), and individual rollers (section 2.4.1). Forces
and motions are averaged over the wheel angles and compared between individual rollers and the
single-roller wheel. The study also refines the time step, determines how far a vehicle moves while
parked on a slope and after a stop, and measures the computing time per wheel. Finally, the forklift
is pushed and brakes on conventional wheels, Mecanum wheels and omni-wheels (Figure 23, `kinds`);
`parts` has two rows of rollers, rolling resistance and a motor.

In ``mujoco``, the same vehicle brakes fully from the same motion on single-roller wheels, on
individual rollers, and in MuJoCo, both unassisted and with the brake assistant, whose feedback is
the velocity sensor. `omni_sim.vehicle.mujoco_vehicle` describes the model in MuJoCo. MuJoCo is
optional; without it, the study explains how to install it. The study also shows why the wheels of
the model in MuJoCo are sprung.
"""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from omni_core.configuration import Configuration, parameter
from omni_runs.experiment import WITHOUT_CAMERAS, changed
from omni_runs.figures import style
from omni_runs.history import RunHistory
from omni_runs.loop import run_closed_loop
from omni_runs.metrics import Metric, run_metrics
from omni_sim.mujoco_import import load_mujoco
from omni_sim.vehicle.configuration import VehicleConfiguration, WheelCondition
from omni_sim.vehicle.mujoco_vehicle import MujocoVehicle
from omni_sim.vehicle.vehicle import DEFAULT_PHYSICS_STEP, Vehicle
from omni_studies.study import StudyResult, StudyRun
from omni_studies.wheels import cost, kinds, parts, trials
from omni_studies.wheels.trials import CONTACT, ROLLERS, SINGLE, TRIALS, with_wheels

CASES = {
    "wheels": "Comparison of the single-roller wheel with individual rollers: forces, motion, "
    "computing time",
    "mujoco": "Rotation and stopping distance of the forklift in MuJoCo and in the simulator",
}

_PLATFORMS = {"mecanum": "mecanum_forklift", "three_wheel": "three_wheel_robot"}
_TITLES = {"mecanum": "Mecanum forklift", "three_wheel": "Three-wheeled robot, rollers at 0 deg"}
_MODELS = {
    SINGLE: "single roller",
    CONTACT: "single roller, contact of rollers",
    ROLLERS: "individual rollers",
}
_COUNTS = (6, 8, 12, 16, 24)
_COMPARED = 12  # number of rollers per wheel in figures and metrics
# Parked on a slope of 5 %, in a direction that is no axis of symmetry.
_SLOPE = trials.WheelTrial("slope", pedal=1.0, push=(0.05 * math.cos(0.4), 0.05 * math.sin(0.4)))
_COSTED = 6  # number of rollers per wheel for the computing time, as in section 2.4.1
# Styles of the wheel models in a figure. The first one, the reference, is dashed and
# drawn over the others.
_STYLES: tuple[dict[str, Any], ...] = (
    {"color": style.BLACK, "linestyle": "--", "zorder": 3.0},
    {"color": style.SKY},
    {"color": style.VERMILLION},
    {"color": style.BLUE},
)


_ENGINES = {
    "single": ("single roller", style.BLUE),
    "rollers": ("individual rollers", style.ORANGE),
    "mujoco": ("MuJoCo", style.VERMILLION),
}
_MOTIONS = {
    "straight": ("straight ahead", "maneuver.direction_deg=0"),
    "sideways": ("sideways", "maneuver.direction_deg=90"),
    "diagonal": ("20 deg from ahead", "maneuver.direction_deg=20"),
    "turning": ("turning, 30 deg/s", "maneuver.yaw_rate_deg=30"),
}
_VARIANTS = ("unassisted", "assisted")
_QUANTITIES = ("orientation_change", "stopping_distance")
_DIFFERENCES = {
    "orientation_change": ("swerve_difference", "deg"),
    "stopping_distance": ("distance_difference", "1"),
}


class Options(Configuration):
    """Options of the study ``wheels``: number of wheel angles and of timed runs, and seed."""

    starts: int = parameter(16, minimum=2, maximum=1000)
    """number of initial wheel angles to average over"""
    seed: int = parameter(1, minimum=0)
    """seed of the initial wheel angles"""
    repeats: int = parameter(40, minimum=1, maximum=10_000)
    """number of runs whose computing time is measured"""


class _Mujoco(Configuration):
    """Options of ``mujoco``: vehicle and speed."""

    vehicle: str = parameter("mecanum_forklift")
    """vehicle: a file of config/vehicles/, a path, or a vehicle's folder"""
    speed: float = parameter(10.0, unit="m/s", above=0.5, maximum=20.0)
    """speed before braking"""


OPTIONS = {"mujoco": _Mujoco}


class Difference(NamedTuple):
    """Relative differences between individual rollers and the single-roller wheel model.

    Attributes:
        vehicle: name of the vehicle.
        trial: name of the trial.
        rollers: number of rollers of each wheel.
        motion: difference of the mean final positions, divided by the distance from the start [1].
        force: difference of the mean forces, as a share of `trials.Outcome.force_scale` [1].
    """

    vehicle: str
    trial: str
    rollers: int
    motion: float
    force: float


Outcomes = Mapping[tuple[str, str, str, int], trials.Outcome]
"""Outcomes of the trials, keyed by vehicle, trial, wheel model and number of rollers."""


Stops = Mapping[tuple[str, str, str], RunHistory]
"""Time histories of the stops, keyed by case, variant and engine."""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Compare the wheel models; write figures, data and metrics."""
    vehicles = {
        name: study.experiments.load("straight_line", "unassisted", [f"vehicle={vehicle}"]).vehicle
        for name, vehicle in _PLATFORMS.items()
    }
    outcomes = {}
    for name, vehicle in vehicles.items():
        angles = trials.start_angles(options.starts, len(vehicle.wheels), options.seed)
        for model, count in (
            (SINGLE, _COMPARED),
            (CONTACT, _COMPARED),
            *((ROLLERS, count) for count in _COUNTS),
        ):
            wheeled = with_wheels(vehicle, model, count)
            starts = angles[:1] if model == SINGLE else angles
            for key, trial in TRIALS.items():
                outcomes[name, key, model, count] = trials.outcome(wheeled, trial, starts)
    rows = _differences(outcomes)
    metrics = _agreement(rows) | _standing(vehicles) | _cost(vehicles["mecanum"], options.repeats)
    mecanum = vehicles["mecanum"]
    pushes = {kind: kinds.pushed(kinds.on_wheels(mecanum, kind)) for kind in kinds.KINDS}
    stops = {kind: kinds.stopped(kinds.on_wheels(mecanum, kind)) for kind in kinds.KINDS}
    metrics |= kinds.metrics(pushes, stops) | parts.metrics(mecanum, vehicles["three_wheel"])
    study.figure("kinds.png", kinds.draw(pushes, stops))
    study.figure("contact.png", _draw_contact(vehicles["mecanum"]))
    study.figure("forces.png", _draw_forces(vehicles))
    study.figure("motions.png", _draw_motions(outcomes))
    study.plot("differences", _draw_differences(rows))
    return study.result(metrics)


def _differences(outcomes: Outcomes) -> list[Difference]:
    rows = []
    for name in _PLATFORMS:
        for key in TRIALS:
            single = outcomes[name, key, SINGLE, _COMPARED]
            for count in _COUNTS:
                result = outcomes[name, key, ROLLERS, count]
                motion = trials.motion_difference(result, single)
                force = trials.force_difference(result, single)
                rows.append(Difference(name, key, count, motion, force))
    return rows


def _agreement(rows: Sequence[Difference]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for row in rows:
        case = f"{row.vehicle}_{row.trial}"
        if row.rollers == _COMPARED:
            metrics[f"force_difference.{case}"] = Metric(row.force, "1")
            metrics[f"motion_difference.{case}"] = Metric(row.motion, "1")
        # The largest difference for any wheel with at least `_COMPARED` rollers.
        if row.rollers >= _COMPARED:
            name = f"worst_difference.{case}"
            before = metrics[name].value if name in metrics else 0.0
            worst = max(before, row.force, row.motion)
            metrics[name] = Metric(worst, "1")
    return metrics


def _standing(vehicles: Mapping[str, VehicleConfiguration]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for name, vehicle in vehicles.items():
        for model in _MODELS:
            wheeled = with_wheels(vehicle, model, _COMPARED)
            stop = dataclasses.replace(TRIALS["brake"], duration=3.0)
            coarse, fine = (
                trials.stopping_distance(wheeled, stop, share * DEFAULT_PHYSICS_STEP, 0.1)
                for share in (1.0, 0.5)
            )
            # Use one wheel angle at which a single roller carries the load and one at which two
            # rollers share it.
            angles = (0.0, np.pi / _COMPARED)
            crept = max(trials.movement(wheeled, _SLOPE, 3.0, angle)[1] for angle in angles)
            _, moved = trials.movement(wheeled, stop, 4.0, 0.1)
            case = f"{name}_{model}"
            metrics |= {
                f"step_change.{case}": Metric(abs(coarse / fine - 1.0), "1"),
                f"creep.{case}": Metric(crept, "m"),
                f"moved_after_stop.{case}": Metric(moved, "m"),
            }
    return metrics


def _cost(vehicle: VehicleConfiguration, repeats: int) -> dict[str, Metric]:
    """Return the real-time factor of each wheel model, and the ratio of their computing times."""
    times = cost.processor_times(
        {model: with_wheels(vehicle, model, _COSTED) for model in _MODELS}, repeats
    )
    ratio = times[ROLLERS] / times[SINGLE]
    metrics = {
        f"real_time_factor.{model}": Metric(cost.DURATION / float(np.min(spent)), "1")
        for model, spent in times.items()
    }
    return metrics | {
        "cost_ratio.rollers_over_single": Metric(float(np.median(ratio)), "1", reference=100.0),
        "cost_ratio_low.rollers_over_single": Metric(float(np.quantile(ratio, 0.1)), "1"),
        "cost_ratio_high.rollers_over_single": Metric(float(np.quantile(ratio, 0.9)), "1"),
        "physics_step.rollers": Metric(DEFAULT_PHYSICS_STEP, "s"),
    }


def _draw_contact(vehicle: VehicleConfiguration) -> Figure:
    """Draw contact point and active direction versus the wheel angle, Eqs. (9), (10)."""
    title = "The contact runs along a roller and jumps to the next (45 deg rollers)"
    y = (
        "contact point along\nthe wheel axis [mm]",
        "active direction from\nthe rolling direction [deg]",
    )
    figure, ((place,), (direction,)) = style.panels(
        title, 2, size=(9.0, 6.0), x="wheel angle [deg]", y=y, sharex=True
    )
    angle = np.linspace(-np.pi / 3.0, np.pi / 3.0, 4001)
    for count, color in ((_COSTED, style.BLUE), (_COMPARED, style.VERMILLION)):
        geometry = with_wheels(vehicle, ROLLERS, count).roller_geometries[0]
        gamma = geometry.roller_angle(angle)
        changes = np.flatnonzero(np.diff(gamma) < 0.0)
        along = (geometry.contact_point(gamma) - geometry.center) @ geometry.wheel_axis[:2]
        axis = geometry.active_direction(gamma)
        rolling = np.array([np.sin(geometry.alpha), -np.cos(geometry.alpha)])
        across = geometry.wheel_axis[:2]
        tilt = np.degrees(np.arctan2(np.abs(axis @ across), np.abs(axis @ rolling)))
        along[changes] = np.nan  # interrupts the line at a jump
        label = f"{geometry.rollers} rollers, jump {1000.0 * geometry.jump:.0f} mm"
        place.plot(np.degrees(angle), 1000.0 * along, color=color, label=label)
        direction.plot(np.degrees(angle), tilt, color=color)
    direction.axhline(45.0, color=style.GRAY, linewidth=1.0, linestyle="--")
    style.note(direction, "ideal wheel", (-59.0, 45.0), (0, -4), va="top", color=style.GRAY)
    direction.set_ylim(44.0, None)
    place.legend(loc="upper right", ncols=2, bbox_to_anchor=(1.0, 1.02))
    low, high = place.get_ylim()
    place.set_ylim(low, high + 0.2 * (high - low))
    return figure


def _draw_forces(vehicles: Mapping[str, VehicleConfiguration]) -> Figure:
    """Draw the forces of one wheel versus its angle for every wheel model."""
    title = "Force of one wheel at 1 m/s, against a resistance of a fifth of the vehicle's weight"
    x = "wheel angle [deg]"
    y = ("along the nominal\nactive direction [N]", "across it [N]")
    figure, panels = style.panels(title, 2, len(vehicles), size=(12.0, 7.0), x=x, y=y, sharex=True)
    wheels = ((SINGLE, _COMPARED), (CONTACT, _COMPARED), (ROLLERS, _COSTED), (ROLLERS, _COMPARED))
    for column, (name, vehicle) in enumerate(vehicles.items()):
        axis = np.eye(2)
        for (model, count), look in zip(wheels, _STYLES, strict=True):
            wheeled = with_wheels(vehicle, model, count)
            turned, force = trials.force_trace(wheeled, 0, 2.0 * np.pi / 3.0)
            if model == SINGLE:
                active = force.mean(axis=0)
                active /= np.linalg.norm(active)
                axis = np.array([active, (-active[1], active[0])])
            angle = np.degrees(np.abs(turned - turned[0]))
            for axes, direction in zip(panels[:, column], axis, strict=True):
                axes.plot(angle, force @ direction, label=_label(model, count), **look)
        panels[0, column].set_title(_TITLES[name])
    for axes in panels[0]:
        axes.set_ylim(0.0, None)
    style.legend_below(figure, 4)
    return figure


def _label(model: str, count: int) -> str:
    return _MODELS[model] + ("" if model == SINGLE else f", {count}")


def _draw_motions(outcomes: Outcomes) -> Figure:
    """Draw braking and a sideways push for all wheel models."""
    heading = "Motion with all wheel models; bands span the initial angles of the wheels"
    figure, panels = style.panels(
        heading, len(_TITLES), 3, size=(13.0, 7.0), x="time [s]", sharex="col"
    )
    shown = (
        ("brake", 3, 1.0, "speed forward, full braking [m/s]"),
        ("brake", 2, 180.0 / np.pi, "heading, full braking [deg]"),
        ("push", 1, 1.0, "pushed sideways by [m]"),
    )
    for row, (name, title) in zip(panels, _TITLES.items(), strict=True):
        for axes, (trial, entry, scale, words) in zip(row, shown, strict=True):
            for model, look in zip(_MODELS, _STYLES, strict=False):
                result = outcomes[name, trial, model, _COMPARED]
                values = result.motion[:, :, entry] * scale
                if len(values) > 1:
                    band: dict[str, Any] = {"color": look["color"], "alpha": 0.2, "linewidth": 0.0}
                    axes.fill_between(result.time, values.min(axis=0), values.max(axis=0), **band)
                label = _label(model, _COMPARED)
                axes.plot(result.time, values.mean(axis=0), label=label, **look)
            axes.set_ylabel(words)
        row[0].set_ylabel(f"{title}\n\n{shown[0][3]}")
    style.legend_below(figure, 4)
    return figure


def _draw_differences(rows: Sequence[Difference], agreement: float = 0.05) -> Figure:
    """Draw the differences versus the number of rollers; `agreement` is the limit to draw [1]."""
    heading = "Individual rollers compared with the single roller, averaged over the wheel angles"
    x = "number of rollers per wheel"
    y = ("difference of the motion [%]", "difference of the mean force [%]")
    figure, panels = style.panels(
        heading, 2, len(_TITLES), size=(12.0, 7.0), x=x, y=y, sharex=True, sharey=True
    )
    for column, (name, title) in enumerate(_TITLES.items()):
        for axes, kind in zip(panels[:, column], ("motion", "force"), strict=True):
            for index, (key, trial) in enumerate(TRIALS.items()):
                own = [row for row in rows if (row.vehicle, row.trial) == (name, key)]
                percent = [100.0 * getattr(row, kind) for row in own]
                look = {"color": style.wheel_color(index), "label": trial.title}
                axes.plot(_COUNTS, percent, "o-", **look)
            ends = [_COMPARED, max(_COUNTS)]
            axes.plot(ends, [100.0 * agreement] * 2, color=style.GRAY, linestyle="--")
        panels[0, column].set_title(title)
    panels[0, 0].set_xticks(list(_COUNTS))
    panels[0, 0].set_ylim(0.0, None)
    style.legend_below(figure, 3)
    return figure


def _mujoco(options: _Mujoco, study: StudyRun) -> StudyResult:
    """Brake in every engine and write figure, data and metrics."""
    load_mujoco()
    same = [*WITHOUT_CAMERAS, f"vehicle={options.vehicle}", f"maneuver.speed={options.speed}"]
    stops = {}
    cases = [(case, variant) for case in _MOTIONS for variant in _VARIANTS]
    for index, (case, variant) in enumerate(cases):
        words, motion = _MOTIONS[case]
        study.report(index / len(cases), f"{words}, {variant}")
        for engine in _ENGINES:
            own = [*same, motion, f"vehicle.wheel_model={engine}"]
            experiment = study.experiments.load("straight_line", variant, own)
            stops[case, variant, engine] = run_closed_loop(experiment)
    metrics = {
        f"{quantity}.{'_'.join(key)}": found[quantity]
        for key, history in stops.items()
        for found in (run_metrics(history),)
        for quantity in _QUANTITIES
    }
    study.plot("paths", _draw_paths(stops))
    vehicle = study.experiments.vehicle(options.vehicle)
    return study.result(metrics | _engine_differences(metrics) | _mismounted(vehicle))


def _engine_differences(metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Return the differences between wheel models and MuJoCo, and their maxima, keyed by name."""
    found: dict[str, Metric] = {}
    pairs = [(case, engine) for case in _MOTIONS for engine in ("single", "rollers")]
    for variant, quantity in itertools.product(_VARIANTS, _QUANTITIES):
        values = []
        name, unit = _DIFFERENCES[quantity]
        for case, engine in pairs:
            ours, other = (
                metrics[f"{quantity}.{case}_{variant}_{one}"].value for one in (engine, "mujoco")
            )
            values.append(abs(ours - other) if unit == "deg" else abs(ours / other - 1.0))
            found[f"{name}.{case}_{variant}_{engine}"] = Metric(values[-1], unit)
        found[f"{name}.{variant}_largest"] = Metric(max(values), unit)
    return found


def _mismounted(vehicle: VehicleConfiguration, higher: float = 0.001) -> dict[str, Metric]:
    """Return the largest change of a wheel load due to a mounting error of the first wheel.

    The change is computed with soft and with stiff springs, in MuJoCo and in the simulator.

    Args:
        vehicle: the vehicle.
        higher: distance by which the first wheel is mounted too high [m].
    """
    offsets = np.zeros(len(vehicle.wheels))
    offsets[0] = higher
    metrics = {}
    for name, stiffness in (("sprung", 2.0e5), ("stiff", 2.0e7)):
        loads = []
        for height in (0.0 * offsets, offsets):
            machine = MujocoVehicle(vehicle, suspension=stiffness, height_offset=height)
            machine.advance(4000, 1.0, np.ones(len(offsets)), np.zeros(3), traced=False)
            loads.append(machine.wheels["load"])
        high = {next(iter(vehicle.wheels)): WheelCondition(mounted=higher)}
        sprung = changed(vehicle, suspension={"stiffness": stiffness})
        tilted_ones = (changed(sprung, conditions=wheels) for wheels in ({}, high))
        ours = [Vehicle(one).wheels["load"] for one in tilted_ones]
        for suffix, (level, tilted) in (("", loads), ("_ours", ours)):
            change = float(np.max(np.abs(tilted - level)))
            metrics[f"load_change_of_1_mm.{name}{suffix}"] = Metric(change, "N")
    return metrics


def _draw_paths(stops: Stops) -> Figure:
    """Draw path and rotation of the vehicle in each engine."""
    heading = "Full braking in three engines: solid unassisted, dashed with the assistant"
    x = "distance along the first velocity [m]"
    y = [f"{title}\nlateral [m]" for title, _ in _MOTIONS.values()]
    figure, panels = style.panels(heading, len(_MOTIONS), 2, size=(13.0, 9.0), x=x, y=y)
    for (case, variant, engine), history in stops.items():
        path, turn = panels[list(_MOTIONS).index(case)]
        start = history.brake_start or 0
        along = history.velocity_world[start] / np.hypot(*history.velocity_world[start])
        pose = history.pose[start:] - history.pose[start]
        ahead, lateral = pose[:, :2] @ along, pose[:, :2] @ np.array([-along[1], along[0]])
        label, color = _ENGINES[engine]
        look = {"color": color, "linestyle": "-" if variant == "unassisted" else "--"}
        path.plot(ahead, lateral, label=label if variant == "unassisted" else None, **look)
        turn.plot(ahead, np.degrees(pose[:, 2]), **look)
    for axes in panels[:, 1]:
        axes.set_ylabel("heading [deg]")
    for axes in panels.flat:
        axes.axhline(0.0, color=style.GRAY, linewidth=0.8)
    panels[0, 0].legend()
    return figure


RUNS = {"mujoco": _mujoco}
