"""``./omni limit``: compute lower bounds of the stopping distance.

Compute lower bounds of the stopping distance from friction, loads and pedal, both for stops that
keep heading and line of motion and for all stops, with all brakes or after the loss of brakes.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core.commands.command_options import CommandOptions, option, overrides_option
from omni_core.commands.command_report import Report
from omni_core.configuration import ConfigurationError, check_choice
from omni_core.kinematics import require_omni_wheels
from omni_runs.workspace import ExperimentWorkspace

if TYPE_CHECKING:
    from omni_core.commands.wrapped_table import WrappedTable
    from omni_runs.experiment import ExperimentConfiguration, ExperimentLibrary
    from omni_runs.limit.stop_kinds import Maneuver
    from omni_sim.configuration import GroundConfiguration
    from omni_sim.vehicle.configuration import VehicleConfiguration
    from omni_tools.limit.front import Load

_WORDS = {
    "bound": "keeps heading and line",
    "bound_heading": "keeps heading, any path",
    "bound_any_heading": "any heading, any path",
    "bound_all_brakes": "keeps heading and line, no loss",
    "bound_heading_all_brakes": "keeps heading, any path, no loss",
    "bound_any_heading_all_brakes": "any heading, any path, no loss",
}

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
    lost_brake: tuple[str, ...] = option((), metavar="WHEEL")
    """wheel whose brake has no torque; repeat the option for each such wheel"""
    since: float | None = option(None, flag="--from", unit="s", minimum=0.0, maximum=3600.0)
    """time from the start of braking to the loss of the brakes of --lost-brake (default: 0)"""
    best: bool = option(False)
    """also plan the shortest stops for several allowed rotations, and draw them together with
    the stops of the laws; takes minutes, requires CasADi"""
    out: Path | None = option(None, metavar="DIR")
    """folder for the figure of --best (default: results/limit/NAME)"""
    overrides: tuple[str, ...] = overrides_option()


def run(options: Options, workspace: ExperimentWorkspace) -> Report:
    """Compute the bounds, and with ``--best`` the shortest stops."""
    from omni_runs.figures.tables.comparison_table import ComparisonTable
    from omni_runs.limit.bounds import any_heading_bound, heading_bound, maneuver_of, straight_bound
    from omni_runs.metrics import Metric, results_document

    if options.out is not None and not options.best:
        raise ConfigurationError("--out", "can only be used with --best, which draws a figure")
    name, load = _question(options, workspace.checked_experiments())
    sound = load(())
    maneuver = maneuver_of(sound.maneuver)
    loss = _loss(options, sound)
    experiment = load(loss)
    vehicle, ground = experiment.vehicle, experiment.ground
    bounds = {
        f"{case}{word}": bound_of(one.vehicle, one.ground, maneuver)
        for word, one in {"": experiment, **({"_all_brakes": sound} if loss else {})}.items()
        for case, bound_of in {
            "bound": straight_bound,
            "bound_heading": heading_bound,
            "bound_any_heading": any_heading_bound,
        }.items()
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

        stops = front(lambda changes: load((*loss, *changes)), maneuver)
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
        require_omni_wheels(library.vehicle(options.vehicle).wheels, "limit")
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


def _loss(options: Options, experiment: ExperimentConfiguration) -> tuple[str, ...]:
    """Return the overrides of the experiment with which the given brakes are lost.

    Raises:
        ConfigurationError: the vehicle has no such wheel, or options contradict each other.
    """
    if options.since is not None and not options.lost_brake:
        raise ConfigurationError("--from", "can only be used with --lost-brake")
    if options.since and options.best:
        raise ConfigurationError(
            "--from", "cannot be used with --best, which plans for brakes lost from the start"
        )
    for wheel in options.lost_brake:
        check_choice("--lost-brake", wheel, experiment.vehicle.wheels)
    onset = experiment.maneuver.brake_time + (options.since or 0.0)
    changes = ("brake=0", f"onset={onset}")
    return tuple(f"vehicle.conditions.{w}.{c}" for w in options.lost_brake for c in changes)


def _forces(
    vehicle: VehicleConfiguration, ground: GroundConfiguration, maneuver: Maneuver
) -> WrappedTable:
    """Return a table of the wheel forces at the largest deceleration without rotation.

    The friction is that of the ground without its patches. Brakes have failed as at the end of the
    stop.
    """
    import numpy as np

    from omni_core.commands.wrapped_table import WrappedTable
    from omni_runs.limit.forces import Case, LimitVehicle

    velocity = maneuver.twist[:2]
    torque = np.where(vehicle.by_wheel("brake") > 0.0, math.inf, 0.0)
    case = Case(np.full(len(vehicle.wheels), ground.friction), straight=True, torque=torque)
    best = LimitVehicle(vehicle).strongest(velocity / math.hypot(*velocity), case)
    wheels = [] if best is None else [wheel.replace("_", " ") for wheel in vehicle.wheels]
    columns = {} if best is None else {"force": np.abs(best.force), "load": best.load}
    return WrappedTable(
        {"strongest deceleration": wheels},
        {f"{name} [N]": [f"{value:.0f}" for value in own] for name, own in columns.items()},
    )
