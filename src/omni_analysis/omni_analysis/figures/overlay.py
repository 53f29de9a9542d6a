"""Several runs in one picture from above, as Figures 36 and 39."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from omni_analysis.figures import style
from omni_analysis.figures.scene import Scene, placed, rectangle
from omni_analysis.figures.top_view_drawing import draw_ground, patch_handles
from omni_analysis.loop.history import RunHistory
from omni_analysis.loop.metrics import RestCriterion
from omni_platform.quantities import FloatArray

_WIDTH, _GREATEST_HEIGHT, _MARGIN = 14.0, 6.0, 0.5  # [inch], [inch], [m]
_COLOURS = ("#7A1F1F", style.VERMILLION, style.SKY)  # dark, bright, marked


def overlay_view(
    scene: Scene,
    runs: Mapping[str, RunHistory],
    title: str,
    *,
    interval: float | None,
) -> Figure:
    """Draw the platforms of several runs over one another.

    Args:
        scene: vehicle and ground.
        runs: up to three, by name; earlier ones lie below.
        title: printed above.
        interval: time between snapshots from the start of braking [s]; None draws only the final
            position.
    """
    indices = {name: _snapshots(run, interval) for name, run in runs.items()}
    outline = rectangle(scene.chassis_length, scene.chassis_width)
    corners = np.concatenate(
        [placed(outline, runs[name].pose[i]) for name in runs for i in indices[name]]
    )
    low, high = corners.min(axis=0) - _MARGIN, corners.max(axis=0) + _MARGIN
    width = _WIDTH - 1.1
    height = min(width * (high[1] - low[1]) / (high[0] - low[0]), _GREATEST_HEIGHT)
    # What the height leaves free beside becomes ground.
    slack = max(width / height * (high[1] - low[1]) - (high[0] - low[0]), 0.0)
    low[0], high[0] = low[0] - slack / 2.0, high[0] + slack / 2.0
    total = height + 1.6
    figure = Figure(figsize=(_WIDTH, total), dpi=style.DOTS_PER_INCH)
    axes = figure.add_axes((0.8 / _WIDTH, 1.05 / total, 1.0 - 1.1 / _WIDTH, height / total))
    style.style_axes(axes)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]", fontsize=style.LABEL_SIZE)
    axes.set_ylabel("y [m]", fontsize=style.LABEL_SIZE)
    figure.suptitle(title, fontsize=style.TITLE_SIZE, y=1.0 - 0.12 / total, va="top")
    draw_ground(axes, scene)
    handles: list[Patch | Line2D] = []
    for layer, ((name, run), colour) in enumerate(zip(runs.items(), _COLOURS, strict=False)):
        start = run.brake_start or 0
        axes.plot(*run.pose[start:, :2].T, color=colour, linewidth=1.4, zorder=10 + layer)
        for place, index in enumerate(indices[name]):
            age = 1.0 - (place + 1) / len(indices[name])
            _draw_platform(axes, scene, run.pose[index], colour, 3.0 + layer, 0.75 - 0.5 * age)
        handles.append(Patch(facecolor=colour, label=name))
    handles.append(Line2D([], [], color=style.BLACK, marker="^", linestyle="", label="front"))
    if any(_in_view(patch.outline, low, high) for patch in scene.patches):
        handles += patch_handles(scene)
    figure.legend(
        handles=handles, loc="lower center", ncol=6, fontsize=style.TICK_SIZE, frameon=False
    )
    return figure


def _snapshots(run: RunHistory, interval: float | None) -> Sequence[int]:
    """Return the stamps to draw; the last is the final position."""
    last = len(run.stamp_ns) - 1
    if interval is None:
        return [last]
    start = run.brake_start or 0
    stop = RestCriterion().first_stamp(run.twist, start) or last
    times = np.arange(run.time[start], run.time[stop] - 0.25 * interval, interval)
    return [*np.searchsorted(run.time, times - 1e-9).tolist(), last]


def _in_view(outline: Sequence[tuple[float, float]], low: FloatArray, high: FloatArray) -> bool:
    points = np.array(outline)
    return bool(np.all(points.max(axis=0) > low) and np.all(points.min(axis=0) < high))


def _draw_platform(
    axes: Axes, scene: Scene, pose: FloatArray, colour: str, layer: float, alpha: float
) -> None:
    chassis = rectangle(scene.chassis_length, scene.chassis_width)
    axes.add_patch(
        Polygon(
            placed(chassis, pose),
            facecolor=colour,
            edgecolor=style.BLACK,
            alpha=alpha,
            zorder=layer,
        )
    )
    nose = scene.chassis_length * np.array([(0.48, 0.0), (0.36, 0.07), (0.36, -0.07)])
    axes.add_patch(Polygon(placed(nose, pose), color=style.BLACK, alpha=alpha, zorder=layer + 0.1))
    mounts = np.array([(mount.x, mount.y) for mount in scene.wheels.values()])
    axes.plot(
        *placed(mounts, pose).T,
        linestyle="",
        marker="s",
        markersize=5,
        color=style.BLACK,
        alpha=alpha,
        zorder=layer + 0.1,
    )
