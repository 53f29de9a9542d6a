"""Rotation and stopping distance of the forklift in MuJoCo and in the simulator.

The same vehicle brakes fully from the same motion on the single-roller wheel, on individual rollers
and in MuJoCo (`omni_sim.vehicle.mujoco_vehicle` describes the model), unassisted and with the brake
assistant in the loop. MuJoCo is optional; without it the study prints how to install it. The study
also shows why the wheels of that model are sprung.
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_loop.metrics import Metric
from omni_platform.configuration import Configuration, parameter
from omni_sim.vehicle.configuration import VehicleConfiguration, WheelCondition
from omni_sim.vehicle.mujoco_vehicle import MujocoVehicle, load_mujoco
from omni_sim.vehicle.suspension import SuspensionConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.study import StudyResult, StudyRun
from omni_studies.wheels.engines import ENGINES, Stop, brake_to_rest, in_engine

_LABELS = {"single": "single roller", "rollers": "individual rollers", "mujoco": "MuJoCo"}
_COLORS = {"single": style.BLUE, "rollers": style.ORANGE, "mujoco": style.VERMILLION}
_CASES = {
    "straight": "straight ahead",
    "sideways": "sideways",
    "diagonal": "20 deg from ahead",
    "turning": "turning, 30 deg/s",
}
_VARIANTS = ("unassisted", "assisted")
_MISMOUNTED = 0.001  # [m]

Stops = Mapping[tuple[str, str, str], Stop]
"""Stops by case, variant and engine."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Vehicle and speed."""

    vehicle: str = parameter("mecanum_forklift")
    """vehicle in config/vehicles"""
    speed: float = parameter(10.0, unit="m/s", above=0.5, maximum=20.0)
    """speed before braking"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Brake in every engine and write figure, data and metrics."""
    load_mujoco()
    experiments = {
        variant: study.experiments.load("straight_line", variant, [f"vehicle={options.vehicle}"])
        for variant in _VARIANTS
    }
    vehicle = experiments["assisted"].vehicle
    stops: dict[tuple[str, str, str], Stop] = {}
    cases = [(case, variant) for case in _CASES for variant in _VARIANTS]
    for index, (case, variant) in enumerate(cases):
        study.report(index / len(cases), f"{_CASES[case]}, {variant}")
        for engine in ENGINES:
            moving = in_engine(vehicle, engine, _twist(case, options.speed))
            stops[case, variant, engine] = brake_to_rest(moving, experiments[variant].brake_assist)
    metrics = _metrics(stops) | _mismounted(vehicle)
    study.figure("paths.png", _draw(stops))
    header = ("case", "variant", "engine", "swerve_deg", "distance_m", "stopped")
    rows = ((*key, stop.swerve, stop.distance, int(stop.stopped)) for key, stop in stops.items())
    study.table("stops.csv", header, rows, digits=6)
    return study.result(metrics)


def _twist(case: str, speed: float) -> tuple[float, float, float]:
    direction = math.radians({"sideways": 90.0, "diagonal": 20.0}.get(case, 0.0))
    rate = math.radians(30.0) if case == "turning" else 0.0
    return speed * math.cos(direction), speed * math.sin(direction), rate


def _metrics(stops: Stops) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for (case, variant, engine), stop in stops.items():
        name = f"{case}_{variant}_{engine}"
        missing = math.nan
        metrics[f"orientation_change.{name}"] = Metric(
            abs(stop.swerve) if stop.stopped else missing, "deg"
        )
        metrics[f"stopping_distance.{name}"] = Metric(
            stop.distance if stop.stopped else missing, "m"
        )
    for case in _CASES:
        for variant in _VARIANTS:
            other = stops[case, variant, "mujoco"]
            for engine in ("single", "rollers"):
                ours = stops[case, variant, engine]
                name = f"{case}_{variant}_{engine}"
                metrics[f"swerve_difference.{name}"] = Metric(
                    abs(ours.swerve - other.swerve), "deg"
                )
                metrics[f"distance_difference.{name}"] = Metric(
                    abs(ours.distance / other.distance - 1.0), "1"
                )
    for variant in _VARIANTS:
        for quantity, unit in (("swerve_difference", "deg"), ("distance_difference", "1")):
            values = [
                metric.value
                for name, metric in metrics.items()
                if name.startswith(quantity) and f"_{variant}_" in name
            ]
            metrics[f"{quantity}.{variant}_largest"] = Metric(max(values), unit)
    return metrics


def _mismounted(vehicle: VehicleConfiguration) -> dict[str, Metric]:
    """Compute the load change by a millimeter of height at the first wheel in both engines."""
    offsets = np.zeros(len(vehicle.wheels))
    offsets[0] = _MISMOUNTED
    metrics = {}
    for name, stiffness in (("sprung", 2.0e5), ("stiff", 2.0e7)):
        loads = []
        for height in (0.0 * offsets, offsets):
            machine = MujocoVehicle(vehicle, suspension=stiffness, height_offset=height)
            machine.advance(4000, 1.0, np.ones(len(offsets)), np.zeros(3), traced=False)
            loads.append(machine.wheels["load"])
        high = {next(iter(vehicle.wheels)): WheelCondition(mounted=_MISMOUNTED)}
        springs = SuspensionConfiguration(stiffness=stiffness)
        ours = [
            Vehicle(dataclasses.replace(vehicle, suspension=springs, conditions=conditions)).wheels[
                "load"
            ]
            for conditions in ({}, high)
        ]
        for engine, (level, tilted) in (("", loads), ("_ours", ours)):
            change = float(np.max(np.abs(tilted - level)))
            metrics[f"load_change_of_1_mm.{name}{engine}"] = Metric(change, "N")
    return metrics


def _draw(stops: Stops) -> Figure:
    """Draw path and rotation of the vehicle in every engine."""
    figure, panels = style.panels(
        "Full braking in three engines: solid unassisted, dashed with the assistant",
        len(_CASES),
        2,
        size=(13.0, 9.0),
        x="way along the first velocity [m]",
        y=[f"{title}\naside [m]" for title in _CASES.values()],
    )
    for (case, variant, engine), stop in stops.items():
        way, turn = panels[list(_CASES).index(case)]
        path = stop.path
        start = path[1, :2] - path[0, :2]
        along = start / np.linalg.norm(start)
        moved = path[:, :2] - path[0, :2]
        ahead, aside = moved @ along, moved @ np.array([-along[1], along[0]])
        look = {"color": _COLORS[engine], "linestyle": "-" if variant == "unassisted" else "--"}
        label = _LABELS[engine] if variant == "unassisted" else None
        way.plot(ahead, aside, label=label, **look)
        turn.plot(ahead, np.degrees(path[:, 2] - path[0, 2]), **look)
    for axes in panels:
        axes[1].set_ylabel("heading [deg]")
        for panel in axes:
            panel.axhline(0.0, color=style.GRAY, linewidth=0.8)
    panels[0, 0].legend()
    return figure
