"""Rotation and stopping distance of the forklift in MuJoCo and in the simulator.

The same vehicle brakes fully from the same motion on single-roller wheels, on individual rollers,
and in MuJoCo, both unassisted and with the brake assistant, whose feedback is the velocity sensor.
`omni_sim.vehicle.mujoco_vehicle` describes the model in MuJoCo. MuJoCo is optional; without it, the
study explains how to install it. The study also shows why the wheels of the model in MuJoCo are
sprung.
"""

import dataclasses
import itertools
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_loop.history import RunHistory
from omni_loop.loop import run_closed_loop
from omni_loop.metrics import Metric, run_metrics
from omni_platform.configuration import Configuration, parameter
from omni_sim.vehicle.configuration import VehicleConfiguration, WheelCondition
from omni_sim.vehicle.mujoco_vehicle import MujocoVehicle, load_mujoco
from omni_sim.vehicle.suspension import SuspensionConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.study import StudyResult, StudyRun

_ENGINES = {
    "single": ("single roller", style.BLUE),
    "rollers": ("individual rollers", style.ORANGE),
    "mujoco": ("MuJoCo", style.VERMILLION),
}
_CASES = {
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

Stops = Mapping[tuple[str, str, str], RunHistory]
"""Stops, by case, variant and engine."""


class Options(Configuration):
    """Vehicle and speed."""

    vehicle: str = parameter("mecanum_forklift")
    """a file of config/vehicles/, a path, or the folder of a vehicle"""
    speed: float = parameter(10.0, unit="m/s", above=0.5, maximum=20.0)
    """speed before braking"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Brake in every engine and write figure, data and metrics."""
    load_mujoco()
    same = [
        f"vehicle={options.vehicle}",
        f"maneuver.speed={options.speed}",
        "feedback=velocity_sensor",
        "simulation.render_lines=false",
    ]
    stops = {}
    cases = [(case, variant) for case in _CASES for variant in _VARIANTS]
    for index, (case, variant) in enumerate(cases):
        words, motion = _CASES[case]
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
    study.plot("paths", _draw(stops))
    vehicle = study.experiments.vehicle(options.vehicle)
    return study.result(metrics | _differences(metrics) | _mismounted(vehicle))


def _differences(metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Return the differences between the simulator's wheel models and MuJoCo, and the largest."""
    found: dict[str, Metric] = {}
    pairs = [(case, engine) for case in _CASES for engine in ("single", "rollers")]
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
    """Return the load change if the first wheel is mounted `higher` [m], in both engines."""
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
        springs = SuspensionConfiguration(stiffness=stiffness)
        sprung = dataclasses.replace(vehicle, suspension=springs)
        tilted_ones = (dataclasses.replace(sprung, conditions=wheels) for wheels in ({}, high))
        ours = [Vehicle(one).wheels["load"] for one in tilted_ones]
        for suffix, (level, tilted) in (("", loads), ("_ours", ours)):
            change = float(np.max(np.abs(tilted - level)))
            metrics[f"load_change_of_1_mm.{name}{suffix}"] = Metric(change, "N")
    return metrics


def _draw(stops: Stops) -> Figure:
    """Draw path and rotation of the vehicle in each engine."""
    heading = "Full braking in three engines: solid unassisted, dashed with the assistant"
    x = "distance along the first velocity [m]"
    y = [f"{title}\nlateral [m]" for title, _ in _CASES.values()]
    figure, panels = style.panels(heading, len(_CASES), 2, size=(13.0, 9.0), x=x, y=y)
    for (case, variant, engine), history in stops.items():
        path, turn = panels[list(_CASES).index(case)]
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
