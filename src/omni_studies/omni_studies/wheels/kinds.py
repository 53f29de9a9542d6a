"""The same platform on conventional, Mecanum and omni-wheels: a push (Figure 23) and a stop."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from omni_core.geometry import WheelMount
from omni_core.quantities import FloatArray
from omni_runs.experiment import changed
from omni_runs.figures import style
from omni_runs.figures.scene import Scene, ahead_up, placed
from omni_runs.metrics import Metric
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_studies.wheels.trials import WheelTrial, advance, start

KINDS = {
    "conventional": ("conventional wheels", style.BLUE),
    "mecanum": ("Mecanum wheels", style.VERMILLION),
    "omni": ("omni-wheels at 45 deg", style.ORANGE),
}
"""Name and color in figures of each kind of wheels"""
PUSH = 0.05
"""Push as a multiple of the vehicle's weight [1]"""
PUSH_ANGLE = math.radians(60.0)
"""Direction of the push, counter-clockwise from the forward direction [rad]"""
PUSH_TIME = 3.0
"""Duration of the push [s]"""
SPEED = 10.0
"""Speed before the emergency stop [m/s]"""

# With the pedal down, the clutch is open.
_PUSH = (PUSH * math.cos(PUSH_ANGLE), PUSH * math.sin(PUSH_ANGLE))
_PUSHED = WheelTrial("push", pedal=1.0, released=True, push=_PUSH, duration=PUSH_TIME)
_STOPPED = WheelTrial("stop", twist=(SPEED, 0.0, 0.0), pedal=1.0, duration=4.0)


class Trial(NamedTuple):
    """Motion of a vehicle in a trial.

    Attributes:
        vehicle: the vehicle.
        path: x, y [m], yaw [rad] of base_link and their time derivatives, shape (T, 6).
    """

    vehicle: VehicleConfiguration
    path: FloatArray


def on_wheels(vehicle: VehicleConfiguration, kind: str) -> VehicleConfiguration:
    """Return a Mecanum vehicle on wheels of another kind at the same positions.

    The omni-wheels stand at 45 deg, so their active directions are those of the Mecanum wheels.

    Args:
        vehicle: a vehicle on Mecanum wheels with headings of 0.
        kind: a key of `KINDS`.
    """
    wheels = dict(vehicle.wheels)
    for name, mount in vehicle.wheels.items():
        if kind == "conventional":
            wheels[name] = WheelMount(kind=kind, x=mount.x, y=mount.y, radius=mount.radius)
        elif kind == "omni":
            wheels[name] = changed(mount, heading_deg=mount.roller_angle_deg, roller_angle_deg=0.0)
    return changed(vehicle, wheels=wheels)


def pushed(vehicle: VehicleConfiguration) -> Trial:
    """Push a vehicle whose wheels turn freely, with its load in the middle, from rest."""
    return _run(with_load_in_the_middle(vehicle), _PUSHED)


def stopped(vehicle: VehicleConfiguration, wheel_angle: float = 0.0) -> Trial:
    """Brake a vehicle fully from `SPEED` straight ahead.

    Args:
        vehicle: the vehicle.
        wheel_angle: initial angle of all wheels [rad].
    """
    return _run(vehicle, _STOPPED, wheel_angle)


def _run(vehicle: VehicleConfiguration, trial: WheelTrial, wheel_angle: float = 0.0) -> Trial:
    return Trial(vehicle, advance(start(vehicle, trial, wheel_angle), trial, trial.duration))


def with_load_in_the_middle(vehicle: VehicleConfiguration) -> VehicleConfiguration:
    """Return a vehicle whose load is above base_link."""
    return changed(vehicle, load={"x": 0.0, "y": 0.0})


def metrics(pushes: Mapping[str, Trial], stops: Mapping[str, Trial]) -> dict[str, Metric]:
    """Return direction and speed of the pushed vehicles, and rotation and distance of the stops.

    Args:
        pushes: results of `pushed`, keyed by kind.
        stops: results of `stopped`, keyed by kind.
    """
    found: dict[str, Metric] = {}
    for kind, trial in pushes.items():
        v_x, v_y = trial.path[-1, 3:5]
        found[f"push_direction.{kind}"] = Metric(math.degrees(math.atan2(v_y, v_x)), "deg")
        found[f"push_speed.{kind}"] = Metric(math.hypot(v_x, v_y), "m/s")
    found["push_angle.all"] = Metric(math.degrees(PUSH_ANGLE), "deg")
    for kind, trial in stops.items():
        found |= stop_metrics("", kind, trial)
    return found


def stop_metrics(prefix: str, case: str, trial: Trial) -> dict[str, Metric]:
    """Return rotation and distance of a stop, as quantities whose names begin with a prefix."""
    moved = trial.path[-1] - trial.path[0]
    return {
        f"{prefix}rotation.{case}": Metric(abs(math.degrees(moved[2])), "deg"),
        f"{prefix}distance.{case}": Metric(float(np.hypot(*moved[:2])), "m"),
    }


def draw(pushes: Mapping[str, Trial], stops: Mapping[str, Trial], apart: float = 3.4) -> Figure:
    """Draw the pushed vehicles and the stops, each beside each other; forward is up.

    Args:
        pushes: results of `pushed`, keyed by kind.
        stops: results of `stopped`, keyed by kind.
        apart: distance between the starts of two vehicles in the figure [m].
    """
    figure, ((push, stop),) = style.panels(
        "", 1, 2, size=(12.0, 6.4), x="right of the first start [m]", y="ahead of the start [m]"
    )
    push.set_title(
        f"wheels free, pushed for {PUSH_TIME:g} s at {math.degrees(PUSH_ANGLE):.0f} deg (arrow)"
    )
    stop.set_title(f"all brakes on at {SPEED:g} m/s, load at the front left")
    arrow = 1.5 / PUSH * np.array([_PUSH])
    for axes, trials in ((push, pushes), (stop, stops)):
        for index, (kind, trial) in enumerate(trials.items()):
            start = np.array([index * apart, 0.0])
            _draw_trial(axes, trial, start, *KINDS[kind])
            if axes is push:
                look = {"arrowstyle": "-|>", "lw": 2.0}
                axes.annotate("", start, start - ahead_up(arrow)[0], arrowprops=look)
        axes.set_aspect("equal")
        axes.margins(0.08)
    handles, labels = stop.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _draw_trial(axes: Axes, trial: Trial, start: FloatArray, label: str, color: str) -> None:
    """Draw the path of a trial, with the vehicle at its start and end.

    Args:
        axes: axes to draw on.
        trial: the trial.
        start: place of the start in the figure [m], shape (2,).
        label: entry of the legend.
        color: color of the vehicle.
    """
    vehicle = trial.vehicle
    scene = Scene(vehicle.chassis_length, vehicle.chassis_width, vehicle.wheels)
    axes.plot(*(ahead_up(trial.path[:, :2]) + start).T, color=color, label=label)
    for row, faint in ((0, 0.35), (-1, 1.0)):
        for outline in (scene.chassis, *scene.wheel_outlines):
            corners = ahead_up(placed(outline, trial.path[row, :3])) + start
            patch = Polygon(corners, facecolor="none", edgecolor=color, alpha=faint, linewidth=1.4)
            axes.add_patch(patch)
