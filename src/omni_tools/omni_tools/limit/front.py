"""Pareto front of stopping distance and rotation: shortest known stops, and control laws."""

import math
from collections.abc import Callable
from typing import NamedTuple

from matplotlib.figure import Figure

from omni_core.configuration import ConfigurationError
from omni_runs.compiled import run_fast_loop
from omni_runs.experiment import ExperimentConfiguration
from omni_runs.figures import style
from omni_runs.limit.stop_kinds import Maneuver
from omni_tools.limit.best import OptimalStop

ROTATIONS = (0.5, 5.0, 15.0, 30.0)
"""Limits on the rotation; `front` plans one stop for each of them [deg]."""


class LimitStop(NamedTuple):
    """Stopping distance [m] and change of heading [deg] of a stop; NaN if no stop was found."""

    distance: float
    rotation: float


IDEAL = (
    "feedback=velocity_sensor",
    *(
        f"velocity_sensor.{name}=0"
        for name in ("linear_noise", "yaw_rate_noise", "offset_x", "offset_y", "yaw_rate_offset")
    ),
)
"""Overrides of an experiment that make the velocity sensor ideal."""

_LAWS = {
    "unassisted": ("brake_assist.enabled=false",),
    "sliding_mode": ("brake_assist.enabled=true", "brake_assist.law=sliding_mode"),
}
_ALLOCATION = (
    "brake_assist.enabled=true",
    "brake_assist.law=allocation",
    "vehicle.brake.kind=proportional",
)

Load = Callable[[tuple[str, ...]], ExperimentConfiguration]
"""Function that composes the experiment with given ``dotted.key=value`` overrides."""


def front(load: Load, maneuver: Maneuver) -> dict[str, LimitStop]:
    """Return the shortest known stops and the stops with all control laws, keyed by name.

    Args:
        load: function that composes the experiment with the given overrides.
        maneuver: motion at the start of braking.

    Raises:
        ConfigurationError: CasADi is missing, or the ground is not level or has patches.
    """
    experiment = load(IDEAL)
    ground = experiment.ground
    if ground.patches or len(ground.elevation.table()):
        raise ConfigurationError("--best", "needs level ground of one friction, without patches")
    optimal = OptimalStop(experiment.vehicle, ground.friction, maneuver)
    stops, best = {}, LimitStop(math.nan, math.nan)
    for law, changes in _LAWS.items():
        run = run_fast_loop(load((*IDEAL, *changes)))
        stops[law] = LimitStop(run.stopping_distance, run.orientation_change)
    for rotation in ROTATIONS:
        setting = f"brake_assist.max_rotation={rotation}"
        run = run_fast_loop(load((*IDEAL, *_ALLOCATION, setting)))
        stops[f"allocation_{rotation:g}"] = LimitStop(run.stopping_distance, run.orientation_change)
        plan = optimal.plan(rotation, run)
        if plan.distance < best.distance or math.isnan(best.distance):
            best = LimitStop(plan.distance, plan.rotation)
        stops[f"best_{rotation:g}"] = best  # a smaller limit may give the shorter stop
    return stops


def draw_front(name: str, stops: dict[str, LimitStop], bound: float) -> Figure:
    """Draw stopping distance versus rotation of all stops, with the lower bound.

    Args:
        name: name of the experiment or the vehicle.
        stops: stops from `front`.
        bound: lower bound for stops that keep heading and line [m]; NaN if there is none.
    """
    title = f"{name.replace('_', ' ')}: shortest known stops, and stops of the laws"
    x = "stopping distance [m]"
    figure, ((axes,),) = style.panels(title, size=(8.0, 5.0), x=x, y="orientation change [deg]")
    if math.isfinite(bound):
        axes.axvline(bound, color=style.GRAY, linestyle="--", label="bound, heading kept")
    for prefix, words, marker, color in (
        ("best", "shortest known stops", "o-", style.BLACK),
        ("allocation", "allocation, several max_rotation", "o", style.VERMILLION),
        ("sliding_mode", "sliding mode", "s", style.BLUE),
        ("unassisted", "all brakes on", "D", style.PURPLE),
    ):
        chosen = [stop for case, stop in stops.items() if case.startswith(prefix)]
        distances, rotations = zip(*chosen, strict=True)
        axes.plot(distances, rotations, marker, color=color, label=words)
    axes.legend()
    return figure
