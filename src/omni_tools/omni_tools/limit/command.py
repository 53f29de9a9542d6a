"""``./omni limit``: compute lower bounds of the stopping distance.

Compute lower bounds of the stopping distance from friction, loads and pedal, both for stops that
keep heading and line of motion and for all stops.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core.commands.command_options import CommandOptions, option, overrides_option
from omni_core.commands.command_report import Report
from omni_core.configuration import ConfigurationError
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_core.commands.wrapped_table import WrappedTable
    from omni_runs.experiment import ExperimentLibrary
    from omni_runs.limit.bounds import Maneuver
    from omni_sim.configuration import GroundConfiguration
    from omni_sim.vehicle.configuration import VehicleConfiguration
    from omni_tools.limit.front import Load

_WORDS = {"bound": "keeps heading and line", "bound_any_heading": "any heading, any path"}

WORK = "bounding the stop"


class Options(CommandOptions):
    """Options of ``omni limit``: an experiment, or a vehicle and its motion."""

    experiment: str | None = option(None, positional=True, metavar="EXPERIMENT")
    """a file of config/experiments/, or a path that ends in .yaml (default: straight_line)"""
    vehicle: str | None = option(None)
    """vehicle instead of an experiment: a file of config/vehicles/, a path, or a folder"""
    speed: float | None = option(None, unit="m/s", minimum=0.0, maximum=50.0)
    """speed of --vehicle before braking (default: 10)"""
    direction: float | None = option(None, unit="deg", minimum=-360.0, maximum=360.0)
    """direction of motion of --vehicle, counter-clockwise from forward (default: 0)"""
    friction: float | None = option(None, minimum=0.0, maximum=2.0)
    """friction factor of the ground under --vehicle (default: 1)"""
    best: bool = option(False)
    """also plan the shortest stops for several allowed rotations, and draw them together with
    the stops of the laws; takes minutes, requires CasADi"""
    out: Path | None = option(None, metavar="DIR")
    """folder for the figure of --best (default: results/limit/NAME)"""
    overrides: tuple[str, ...] = overrides_option()


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Compute the bounds, and with ``--best`` the shortest stops."""
    from omni_runs.figures.tables.comparison_table import ComparisonTable
    from omni_runs.limit.bounds import any_heading_bound, maneuver_of, straight_bound
    from omni_runs.metrics import Metric, results_document

    if options.out is not None and not options.best:
        raise ConfigurationError("--out", "can only be used with --best, which draws a figure")
    name, load = _question(options, workspace.checked_experiments())
    experiment = load(())
    vehicle, ground = experiment.vehicle, experiment.ground
    maneuver = maneuver_of(experiment.maneuver)
    bounds = {
        "bound": straight_bound(vehicle, ground, maneuver),
        "bound_any_heading": any_heading_bound(vehicle, ground, maneuver),
    }
    metrics = {
        case: {
            "stopping_distance": Metric(bound.distance, "m", note=bound.reason),
            "duality_gap": Metric(bound.gap, "1"),
            "tolerance": Metric(bound.tolerance, "m"),
        }
        for case, bound in bounds.items()
    }
    text: list[Any] = []
    if options.best:
        from omni_runs.figures.style import save_figure
        from omni_tools.limit.front import draw_front, front

        stops = front(load, maneuver)
        metrics |= {
            case: {
                "stopping_distance": Metric(stop.distance, "m"),
                "orientation_change": Metric(stop.rotation, "deg"),
            }
            for case, stop in stops.items()
        }
        drawn = draw_front(name, stops, bounds["bound"].distance)
        figure = save_figure(drawn, workspace.results(options.out, "limit", name) / "front.png")
        text = [f"figure: {figure}"]
    shown = {_WORDS.get(case, case.replace("_", " ")): found for case, found in metrics.items()}
    table = ComparisonTable(shown, title=f"{name}: lower bounds of the stopping distance")
    if not math.isnan(bounds["bound"].distance):
        text.append(_forces(vehicle, ground, maneuver))
    return Report(**results_document(name, metrics), text=(table, *text))


def _question(options: Options, library: ExperimentLibrary) -> tuple[str, Load]:
    """Return the name of the given experiment or vehicle, and a function that loads it.

    The function has one argument: a sequence of further overrides, ``dotted.key=value`` texts.

    Raises:
        ConfigurationError: options contradict each other.
    """
    keys = {
        "speed": "maneuver.speed",
        "direction": "maneuver.direction_deg",
        "friction": "ground.friction",
    }
    given = {name: value for name in keys if (value := getattr(options, name)) is not None}
    name, overrides = options.experiment or "straight_line", options.overrides
    if options.vehicle is not None:
        if options.experiment is not None:
            raise ConfigurationError("--vehicle", f"cannot be combined with experiment {name}")
        if overrides:
            raise ConfigurationError(
                "--set", "can only be used with an experiment, not with --vehicle"
            )
        moving = (f"{keys[word]}={value}" for word, value in given.items())
        overrides = (f"vehicle={options.vehicle}", *moving)
    elif given:
        flag = f"--{next(iter(given))}"
        raise ConfigurationError(
            flag, "can only be used with --vehicle; change an experiment with --set"
        )
    from omni_runs.experiment import short_name

    return (
        short_name(options.vehicle or name),
        lambda changes: library.load(name, overrides=(*overrides, *changes)),
    )


def _forces(
    vehicle: VehicleConfiguration, ground: GroundConfiguration, maneuver: Maneuver
) -> WrappedTable:
    """Return a table of the wheel forces at the largest deceleration without rotation.

    The friction is that of the ground without its patches.
    """
    import numpy as np

    from omni_core.commands.wrapped_table import WrappedTable
    from omni_runs.limit.forces import Case, LimitVehicle

    velocity = maneuver.twist[:2]
    case = Case(np.full(len(vehicle.wheels), ground.friction), straight=True)
    best = LimitVehicle(vehicle).strongest(velocity / math.hypot(*velocity), case)
    wheels = [] if best is None else [wheel.replace("_", " ") for wheel in vehicle.wheels]
    columns = {} if best is None else {"force": np.abs(best.force), "load": best.load}
    return WrappedTable(
        {"strongest deceleration": wheels},
        {f"{name} [N]": [f"{value:.0f}" for value in own] for name, own in columns.items()},
    )
