"""Curves of the tire models (Figures 4 to 6), with checks of convergence, rest and zero slip."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.geometry import turned
from omni_core.quantities import FloatArray
from omni_runs.experiment import ExperimentLibrary
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_sim.configuration import SimulationConfiguration
from omni_sim.tire.combined_slip import combined_forces
from omni_sim.tire.interface.configuration import TireConfiguration, TMeasyConfiguration
from omni_sim.tire.models import tmeasy
from omni_sim.tire.tire import Tire
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import DEFAULT_PHYSICS_STEP, Vehicle
from omni_studies.study import StudyResult, StudyRun
from omni_studies.wheels import trials

_EXPERIMENT = "straight_line"  # experiment from which the vehicle is taken
_TABLE_1 = "rill_table_1"
_TIRES = (_TABLE_1, "linear", "magic_formula")
_SETTLING = 2.0  # time in which the tires reach their deflection [s]
_CROSSING_SPEED = 0.5  # commanded speed before and after the zero crossing [m/s or rad/s]


class Options(Configuration):
    """Options of the study ``tires``: tires, vehicle and slope."""

    tire: tuple[str, ...] = parameter(_TIRES)
    """a file of config/tires/, or a path that ends in .yaml"""
    vehicle: str = parameter("mecanum_forklift")
    """vehicle that is simulated on these tires"""
    slope: float = parameter(0.05, minimum=0.0, maximum=0.5)
    """grade of the slope on which the vehicle is parked"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Draw the characteristics, and test each tire on the vehicle."""
    table = _vehicle(study.experiments, options.vehicle, _TABLE_1).tire.tmeasy
    vehicles = {}
    for name in options.tire:
        case = Path(name).stem
        if case in vehicles:
            raise ConfigurationError("--tire", f"two of the tires are called {case!r}")
        vehicles[case] = _vehicle(study.experiments, options.vehicle, name)
    tires = {name: Tire(vehicle.tire) for name, vehicle in vehicles.items()}
    loads = np.linspace(0.25, 1.0, 4) * table.nominal_load_2
    model = Tire(TireConfiguration(tmeasy=table))  # model of the longitudinal direction
    study.plot("figure_4", _slip_figure(model, table))
    study.plot("figure_5", _load_figure(model, loads))
    study.plot("figure_6", _interpolation_figure(table))
    study.plot("combined_slip", _combined_figure(table))
    study.plot("models", _model_figure(tires, (table.nominal_load_1, table.nominal_load_2)))
    metrics = _characteristic_metrics(model)
    for name, vehicle in vehicles.items():
        give, creep = slope_creep(vehicle, options.slope)
        change = stopping_distance_change(vehicle)
        after_stop = creep_after_stop(vehicle)
        unevenness = zero_crossing_unevenness(vehicle)
        metrics |= {
            f"stopping_distance_change.{name}": Metric(change, "1"),
            f"slope_creep.{name}": Metric(creep, "m"),
            f"slope_give.{name}": Metric(give, "m"),
            f"creep_after_stop.{name}": Metric(after_stop, "m"),
            f"zero_crossing_unevenness.{name}": Metric(unevenness, "1"),
        }
    return study.result(metrics)


def _vehicle(library: ExperimentLibrary, vehicle: str, tire: str) -> VehicleConfiguration:
    overrides = (f"vehicle={vehicle}", f"vehicle.tire={tire}")
    return library.load(_EXPERIMENT, overrides=overrides).vehicle


def _characteristic_metrics(model: Tire) -> dict[str, Metric]:
    """Return the values of Table 1, computed from the curves."""
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


def _slip_figure(model: Tire, tire: TMeasyConfiguration) -> Figure:
    """Draw force versus slip with the five numbers that define it (Figure 4)."""
    load = tire.nominal_load_1
    figure, axes = _axes("Slip s [1]", "Longitudinal force F [kN]")
    point = tmeasy.curve_of(tire, load)
    right = 1.35 * point.slide_slip
    slip = np.linspace(0.0, right, 800)
    sections = (
        ("adhesion", slip <= point.peak_slip, style.BLUE),
        ("transition", (slip >= point.peak_slip) & (slip <= point.slide_slip), style.ORANGE),
        ("full sliding", slip >= point.slide_slip, style.VERMILLION),
    )
    for label, where, color in sections:
        carried = 1e-3 * model.force(slip[where], load)
        axes.plot(slip[where], carried, color=color, linewidth=2.4, label=label)
    top = 1e-3 * point.peak_force
    tangent = np.array([0.0, 1.12 * point.peak_force / point.slope])
    axes.plot(tangent, 1e-3 * point.slope * tangent, "--", color=style.BLACK, linewidth=1.0)
    words = f"slope $dF_0$ = {1e-3 * point.slope:.0f} kN"
    style.note(axes, words, (float(tangent[1]), 1.12 * top), (6, -2))
    guide: dict[str, Any] = {"color": style.GRAY, "linewidth": 0.9, "linestyle": ":"}
    for place, force, names in (
        (point.peak_slip, point.peak_force, ("$s_{max}$", "$F_{max}$")),
        (point.slide_slip, point.slide_force, ("$s_{slide}$", "$F_{slide}$")),
    ):
        height = 1e-3 * force
        axes.plot([place, place, 0.0], [0.0, height, height], **guide)
        axes.plot(place, height, "o", color=style.BLACK, markersize=5)
        words = f"{names[0]} = {place:g}\n{names[1]} = {height:g} kN"
        style.note(axes, words, (place, height), (8, -34))
    axes.set_xlim(0.0, right)
    axes.set_ylim(0.0, 1.2 * top)
    axes.set_title(f"Force versus slip at {1e-3 * load:g} kN (Figure 4)")
    axes.legend(loc="lower right")
    return figure


def _load_figure(tire: Tire, loads: FloatArray) -> Figure:
    """Draw force versus slip at several loads [N] (Figure 5)."""
    figure, axes = _axes("Slip s [1]", "Longitudinal force F [kN]")
    slip = np.linspace(0.0, 0.6, 700)
    for load, color in zip(loads, _shades(len(loads)), strict=True):
        force = 1e-3 * tire.force(slip, load)
        words = f"$F_z$ = {1e-3 * load:g} kN"
        axes.plot(slip, force, color=color, linewidth=2.0, label=words)
        style.note(axes, words, (float(slip[-1]), float(force[-1])), (5, 0), va="center")
    axes.set_xlim(0.0, float(slip[-1]))
    axes.set_ylim(bottom=0.0)
    axes.set_title("Load dependence of the force (Figure 5)")
    return figure


def _interpolation_figure(tire: TMeasyConfiguration) -> Figure:
    """Draw the parabola (3) of the longitudinal slope versus load (Figure 6)."""
    figure, axes = _axes("Wheel load $F_z$ [kN]", "Slope $dF_0$ at zero slip [kN]")
    load_1, load_2 = tire.nominal_load_1, tire.nominal_load_2
    c = tmeasy.direction_coefficients(tire)
    end = -c[0] / c[1] if c[1] < 0.0 else 2.0 * load_2
    inside, outside = np.linspace(0.0, load_2, 300), np.linspace(load_2, end, 300)
    clamped = np.full(300, tire.x.slope_2)
    beyond = _parabola(tire, outside)
    for load, slope, color, dashes, label in (
        (inside, _parabola(tire, inside), style.BLUE, "-", "model"),
        (outside, beyond, style.GRAY, "--", "parabola beyond the model, no physical meaning"),
        (outside, clamped, style.VERMILLION, "-", "used there: clamped, and reported"),
    ):
        axes.plot(1e-3 * load, 1e-3 * slope, dashes, color=color, label=label)
    for name, x, y in (("1", load_1, tire.x.slope_1), ("2", load_2, tire.x.slope_2)):
        place = 1e-3 * x, 1e-3 * y
        axes.plot(*place, "o", color=style.BLACK)
        style.note(axes, f"$Load_{name}$", place, (-8, 4), ha="right")
    axes.axvspan(1e-3 * load_2, 1e-3 * end, color=style.PALE, alpha=0.35, linewidth=0.0)
    axes.set_xlim(0.0, 1e-3 * end)
    axes.set_ylim(0.0, 1.4e-3 * float(np.max(beyond)))
    axes.set_title("Quadratic interpolation of the slope (Figure 6)")
    axes.legend(loc="upper center")
    return figure


def _parabola(tire: TMeasyConfiguration, load: FloatArray) -> FloatArray:
    """Return the longitudinal slope [N] at each load [N] by Eq. (3), for loads of any size."""
    c = tmeasy.direction_coefficients(tire)
    return np.asarray((c[0] + c[1] * load) * load, dtype=np.float64)


def _model_figure(tires: Mapping[str, Tire], loads: Sequence[float]) -> Figure:
    """Draw force versus slip for several tires at the same loads [N], one panel per load."""
    figure, (panels,) = style.panels(
        "", 1, len(loads), size=(11.0, 4.6), x="Slip s [1]", y="Force F [kN]", sharey=True
    )
    slip = np.linspace(0.0, 0.6, 700)
    for axes, load in zip(panels, loads, strict=True):
        for index, (name, tire) in enumerate(tires.items()):
            label = f"{name} ({tire.configuration.model})"
            force = 1e-3 * tire.force(slip, load)
            axes.plot(slip, force, color=style.wheel_color(index), label=label)
        axes.set_xlim(0.0, 0.6)
        axes.set_title(f"$F_z$ = {1e-3 * load:g} kN")
    panels[0].set_ylim(bottom=0.0)
    panels[-1].legend(loc="lower right")
    return figure


def _combined_figure(tire: TMeasyConfiguration) -> Figure:
    """Draw lateral force versus longitudinal force under combined slip (section 2.3.1)."""
    load = tire.nominal_load_1
    figure, axes = _axes("Longitudinal force $F_x$ [kN]", "Lateral force $F_y$ [kN]")
    figure.set_size_inches(7.6, 6.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    for slip, color in zip((0.02, 0.05, 0.1, 0.18, 0.8), _shades(5), strict=True):
        force = 1e-3 * combined_forces(tire, slip * np.cos(angle), slip * np.sin(angle), load)
        axes.plot(force[:, 0], force[:, 1], color=color, linewidth=2.0, label=f"|s| = {slip:g}")
    reach = 1.08e-3 * tmeasy.curve_of(tire, load).peak_force
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), box_aspect=1.0)
    axes.set_title(f"Combined slip at {1e-3 * load:g} kN")
    figure.legend(loc="outside right center")
    return figure


def _axes(x: str, y: str) -> tuple[Figure, Axes]:
    figure, grid = style.panels("", size=(8.0, 5.0), x=x, y=y)
    return figure, grid[0, 0]


def _shades(count: int) -> Any:
    """Return colors from light to dark blue."""
    return matplotlib.colormaps["Blues"](np.linspace(0.4, 1.0, count))


_DIRECTIONS = turned(np.array([1.0, 0.0]), np.radians([0.0, 45.0, 90.0, 180.0, 240.0, 300.0]))
_PERIOD = SimulationConfiguration.control_period  # period of the drive's commands [s]


def stopping_distance_change(vehicle: VehicleConfiguration, speed: float = 4.0) -> float:
    """Return the relative change of the stopping distance if the physics step is halved [1].

    The result is the largest change over six directions of motion.

    Args:
        vehicle: the vehicle.
        speed: speed at the start of each stop [m/s].
    """
    changes = []
    for direction in _DIRECTIONS:
        twist = (*(speed * direction), 0.0)
        trial = trials.WheelTrial("stop", twist=twist, pedal=1.0, duration=4.0)
        whole, half = (
            trials.stopping_distance(vehicle, trial, step)
            for step in (DEFAULT_PHYSICS_STEP, 0.5 * DEFAULT_PHYSICS_STEP)
        )
        changes.append(abs(half / whole - 1.0))
    return max(changes)


def slope_creep(vehicle: VehicleConfiguration, slope: float) -> tuple[float, float]:
    """Return how far a vehicle moves while its brakes hold it on a slope.

    The results are the largest values over six directions of the slope.

    Args:
        vehicle: the vehicle.
        slope: grade of the slope [1].

    Returns:
        Initial deflection of the tires [m], and displacement in the following minute [m].
    """
    pushes = math.sin(math.atan(slope)) * _DIRECTIONS
    parked = [trials.WheelTrial("slope", pedal=1.0, push=tuple(push)) for push in pushes]
    give, creep = np.max([trials.movement(vehicle, one, _SETTLING) for one in parked], axis=0)
    return float(give), float(creep)


def creep_after_stop(vehicle: VehicleConfiguration, speed: float = 4.0) -> float:
    """Return how far a vehicle moves in the minute after a stop [m].

    The result is the largest movement over six directions of the stop. The minute begins 6 s
    after the start of braking from `speed` [m/s].
    """
    twists = [(*(speed * direction), 0.3) for direction in _DIRECTIONS]
    stops = [trials.WheelTrial("stop", twist=twist, pedal=1.0) for twist in twists]
    return max(trials.movement(vehicle, stop, 6.0)[1] for stop in stops)


def zero_crossing(vehicle: VehicleConfiguration, direction: FloatArray) -> FloatArray:
    """Return the speed of a vehicle while the commanded speed decreases linearly through zero.

    Args:
        vehicle: the vehicle.
        direction: direction of the body twist, a unit vector [1], shape (3,).

    Returns:
        Speed along `direction` at the control stamps [m/s or rad/s], shape (201,).
    """
    moving = Vehicle(vehicle, twist=_CROSSING_SPEED * direction)
    enable = np.ones(len(vehicle.wheels))
    periods = round(2.0 / _PERIOD)
    steps = round(_PERIOD / moving.physics_step)
    speeds = [_CROSSING_SPEED]
    for k in range(periods):
        command = _CROSSING_SPEED * direction * (1.0 - 2.0 * (k + 1) / periods)
        moving.advance(steps, 0.0, enable, command)
        speeds.append(float(moving.twist @ direction))
    return np.array(speeds)


def zero_crossing_unevenness(vehicle: VehicleConfiguration) -> float:
    """Return the largest jump of the acceleration while the speed passes through zero [1].

    A jump is the change from one control period to the next, divided by the commanded acceleration.
    The result is the maximum over all directions and over 25 periods before and after the commanded
    speed is zero. If the vehicle stayed at zero speed for some time, the result would be about 1.
    """
    worst = []
    for direction in _DIRECTIONS:
        speed = zero_crossing(vehicle, np.append(direction, 0.0))
        acceleration = np.diff(speed) / _PERIOD
        near = np.abs(np.arange(len(acceleration)) - len(acceleration) // 2) <= 25
        worst.append(np.max(np.abs(np.diff(acceleration[near]))) / speed[0])
    return float(max(worst))
