"""Figures of a tracked maneuver: snapshots from above, wheel speeds and errors over time."""

import math
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from omni_figures import style
from omni_figures.scene import Scene
from omni_figures.top_view_drawing import draw_snapshot, mass_handles
from omni_studies.wheels.tracking import Tracking

_WIDTH, _MARGINS = 14.0, 1.2  # [inch]: of the figure; for title and legend
_MOST_SNAPSHOTS = 12
_LONGEST_ARROW = 0.9  # of the fastest snapshot, in lengths of the chassis
_WHEEL_LINES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (4, 1.5, 1, 1.5)), (0, (1.5, 1)))


def draw_snapshots(scene: Scene, tracking: Tracking, title: str) -> Figure:
    """Draw the platform at regular intervals on its path, as Figures 19 and 21.

    Args:
        scene: the vehicle.
        tracking: its drive.
        title: printed above.
    """
    history = tracking.history()
    traveled = float(np.sum(np.hypot(*np.diff(tracking.pose[:, :2], axis=0).T)))
    size = math.hypot(scene.chassis_length, scene.chassis_width)
    count = min(max(int(1.05 * traveled / size) + 1, 2), _MOST_SNAPSHOTS)
    indices = np.unique(np.linspace(0, len(tracking.time) - 1, count).round().astype(int))
    fastest = float(np.max(np.hypot(tracking.twist[:, 0], tracking.twist[:, 1])))
    arrow_scale = _LONGEST_ARROW * scene.chassis_length / max(fastest, 1e-9)

    margin = 0.5 * size + 0.5
    low = np.min(tracking.pose[:, :2], axis=0) - margin
    high = np.max(tracking.pose[:, :2], axis=0) + margin
    height = _WIDTH * (high[1] - low[1]) / (high[0] - low[0]) + _MARGINS
    figure, ((axes,),) = style.panels(title, size=(_WIDTH, height), x="x [m]", y="y [m]")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.plot(*tracking.pose[:, :2].T, color=style.BLACK, zorder=8)
    axes.plot(*tracking.reference[:, :2].T, color=style.SKY, linewidth=4.0, zorder=7.9)
    for index in indices.tolist():
        draw_snapshot(axes, scene, history, index, arrow_scale, 0.5)
        x, y = tracking.pose[index, :2]
        axes.text(
            x,
            y - 0.62 * size,
            f"{tracking.time[index]:.3g} s\n{math.degrees(tracking.pose[index, 2]):.0f}°",
            ha="center",
            va="center",
            zorder=20,
            path_effects=[Stroke(linewidth=3, foreground="white"), Normal()],
        )
    handles: list[Line2D | Patch] = [
        Patch(facecolor="white", edgecolor=style.wheel_color(row), label=name.replace("_", " "))
        for row, name in enumerate(tracking.wheel_names)
    ]
    handles += [
        Line2D([], [], color=style.BLACK, marker="^", linestyle="", label="front"),
        *mass_handles(scene),
        Line2D([], [], color=style.SKY, linewidth=4.0, label="reference path"),
        Line2D([], [], color=style.BLACK, label="path driven"),
        Line2D([], [], color=style.VERMILLION, label=f"velocity (up to {fastest:.1f} m/s)"),
    ]
    _legend(figure, handles)
    return figure


def draw_commands(tracking: Tracking, title: str) -> Figure:
    """Draw wheel-speed commands over time, as Figures 20 and 22, and the tracking errors.

    Args:
        tracking: the drive.
        title: printed above.
    """
    figure, ((commands,), (position,), (heading,)) = style.panels(
        title,
        3,
        size=(_WIDTH, 8.5),
        x="time [s]",
        y=("wheel speed [rad/s]", "position\nerror [mm]", "heading\nerror [deg]"),
        sharex=True,
        height_ratios=(3.0, 1.0, 1.0),
    )
    handles: list[Line2D | Patch] = []
    for row, name in enumerate(tracking.wheel_names):
        look: dict[str, Any] = {"color": style.wheel_color(row), "linewidth": 2.2}
        dashes = _WHEEL_LINES[row % len(_WHEEL_LINES)]
        commands.plot(tracking.time, tracking.wheel_command[:, row], linestyle=dashes, **look)
        label = f"command {row + 1}, {name.replace('_', ' ')}"
        handles.append(Line2D([], [], linestyle=dashes, label=label, **look))
    measured: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.8}
    commands.plot(tracking.time, tracking.wheel_speed, **measured)
    handles.append(Line2D([], [], label="wheel speed reached", **measured))
    position.plot(tracking.time, 1000.0 * tracking.position_error, color=style.BLACK)
    heading.plot(tracking.time, np.degrees(tracking.heading_error), color=style.BLACK)
    heading.set_xlim(tracking.time[0], tracking.time[-1])
    _legend(figure, handles)
    return figure


def _legend(figure: Figure, handles: list[Line2D | Patch]) -> None:
    columns = min(len(handles), 6)
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, handlelength=3.0)
