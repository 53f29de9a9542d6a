"""Braking seen from above: snapshots of every variant, like Figures 24 and 30.

One panel per variant, all at the same scale, so that distances compare by eye. Snapshots follow
at regular intervals of time from the start of braking; the last one is the final position.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from omni_analysis import figure_style as style
from omni_analysis.metrics import RestCriterion, run_metrics
from omni_analysis.run_history import RunHistory
from omni_analysis.scene import Scene, placed, rectangle
from omni_analysis.top_view_drawing import draw_ground, draw_paths, draw_snapshot, legend_handles

FloatArray = NDArray[np.float64]

_WIDTH, _GREATEST_HEIGHT, _LEAST_PANEL = 14.0, 10.0, 1.3  # [inch]
_LEFT, _RIGHT, _BOTTOM, _GAP, _LEGEND_ROW = 0.75, 0.3, 0.6, 0.25, 0.25  # [inch]
_LEGEND_COLUMNS = 6
_FEWEST_SNAPSHOTS, _MOST_SNAPSHOTS = 3, 7
_INTERVALS = (0.05, 0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0)  # [s]
_LABEL_POINTS, _LABEL_WIDTH, _LABEL_HEIGHT = 9.0, 0.55, 0.2  # the last two in [inch]
# The arrow of the fastest snapshot, in lengths of the chassis.
_LONGEST_ARROW = 1.2


@dataclasses.dataclass(frozen=True)
class _Snapshots:
    """Indices of the stamps to draw and what to write beside them."""

    indices: tuple[int, ...]
    labels: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class _View:
    """The piece of ground that every panel shows, and how it is laid out on the page."""

    low: FloatArray  # [m]
    high: FloatArray  # [m]
    side_by_side: bool
    inches_per_metre: float


def top_view(
    scene: Scene,
    histories: Mapping[str, RunHistory],
    *,
    title: str = "",
    rest: RestCriterion | None = None,
) -> Figure:
    """Draw snapshots of every variant's braking from above.

    Args:
        scene: vehicle and ground.
        histories: runs by variant, in the order of the panels.
        title: printed above the panels.
        rest: when a vehicle counts as stopped.

    Raises:
        ValueError: there is no history.
    """
    if not histories:
        raise ValueError("a top view needs at least one history")
    criterion = rest or RestCriterion()
    snapshots = _choose_snapshots(histories, criterion, scene.chassis_length)
    fastest = max(_greatest_speed(histories[name], snapshots[name]) for name in histories)
    arrow_scale = _LONGEST_ARROW * scene.chassis_length / fastest if fastest > 0.0 else 0.0
    view = _choose_view(scene, histories, snapshots, arrow_scale)
    handles = legend_handles(scene, fastest)
    figure, panels = _lay_out(view, len(histories), len(handles), title)
    for axes, (name, history) in zip(panels, histories.items(), strict=True):
        axes.set_title(
            _panel_title(name, history, criterion, "\n" if view.side_by_side else ", "),
            fontsize=style.LABEL_SIZE,
            loc="left",
        )
        draw_ground(axes, scene)
        draw_paths(axes, history)
        chosen = snapshots[name].indices
        for age, index in enumerate(reversed(chosen)):
            draw_snapshot(axes, scene, history, index, arrow_scale, age / len(chosen))
        _label_snapshots(axes, scene, history, snapshots[name], view)
    figure.legend(
        handles=handles,
        loc="lower center",
        ncol=min(_LEGEND_COLUMNS, len(handles)),
        fontsize=style.TICK_SIZE,
        frameon=False,
    )
    return figure


def _choose_snapshots(
    histories: Mapping[str, RunHistory], rest: RestCriterion, chassis_length: float
) -> dict[str, _Snapshots]:
    """Choose one interval for all variants: a few snapshots that do not hide one another."""
    spans: dict[str, tuple[int, int]] = {}
    duration = distance = 0.0
    for name, history in histories.items():
        start = history.brake_start or 0
        stop = rest.first_stamp(history.twist, start)
        spans[name] = start, len(history.stamp_ns) - 1 if stop is None else stop
        duration = max(duration, float(history.time[spans[name][1]] - history.time[start]))
        distance = max(distance, math.hypot(*(history.pose[-1, :2] - history.pose[start, :2])))
    most = min(max(int(distance / chassis_length) + 2, _FEWEST_SNAPSHOTS), _MOST_SNAPSHOTS)
    interval = next((step for step in _INTERVALS if duration / step <= most - 1), duration / 2)
    return {
        name: _snapshots_of(histories[name], start, stop, interval)
        for name, (start, stop) in spans.items()
    }


def _snapshots_of(history: RunHistory, start: int, stop: int, interval: float) -> _Snapshots:
    time = history.time - history.time[start]
    # A regular snapshot just before the last one would only hide behind it.
    regular = np.arange(0.0, max(float(time[stop]) - 0.25 * interval, 1e-9), interval)
    indices = np.searchsorted(time, regular - 1e-9).tolist()
    labels = [f"{instant:g} s" for instant in np.round(regular, 3).tolist()]
    last = len(time) - 1  # the vehicle may still rock a little after it stops
    if last not in indices:
        indices.append(last)
        labels.append(f"{time[stop]:.2f} s")
    return _Snapshots(tuple(indices), tuple(labels))


def _greatest_speed(history: RunHistory, snapshots: _Snapshots) -> float:
    twist = history.twist[list(snapshots.indices)]
    return float(np.max(np.hypot(twist[:, 0], twist[:, 1])))


def _choose_view(
    scene: Scene,
    histories: Mapping[str, RunHistory],
    snapshots: Mapping[str, _Snapshots],
    arrow_scale: float,
) -> _View:
    """Frame all snapshots of all variants and find the largest scale that fits the page."""
    points = []
    outline = rectangle(scene.chassis_length, scene.chassis_width)
    for name, history in histories.items():
        indices = list(snapshots[name].indices)
        points += [placed(outline, history.pose[index]) for index in indices]
        points.append(history.pose[indices, :2] + arrow_scale * history.velocity_world[indices])
        points.append(history.pose[indices[0] :, :2])
    everything = np.concatenate(points)
    margin = 0.15 * max(scene.chassis_length, scene.chassis_width)
    low, high = np.min(everything, axis=0) - margin, np.max(everything, axis=0) + margin
    span = high - low
    side_by_side = bool(span[1] > span[0]) and len(histories) > 1
    columns, rows = (len(histories), 1) if side_by_side else (1, len(histories))
    width = (_WIDTH - _LEFT - _RIGHT - (columns - 1) * _GAP) / columns
    height = _GREATEST_HEIGHT / rows
    # Labels stand on the left of platforms that move up the page, else above them.
    label = np.array([_LABEL_WIDTH, 0.0] if side_by_side else [0.0, _LABEL_HEIGHT])
    scale = float(np.min((np.array([width, height]) - label) / span))
    low, high = low - (label * [1, 0]) / scale, high + (label * [0, 1]) / scale
    # What the scale leaves free becomes ground, so that every panel fills its place.
    wanted = np.array([width, max(_LEAST_PANEL, (high - low)[1] * scale)])
    slack = np.maximum(wanted / scale - (high - low), 0.0)
    return _View(low - slack / 2.0, high + slack / 2.0, side_by_side, scale)


def _lay_out(view: _View, count: int, entries: int, title: str) -> tuple[Figure, list[Axes]]:
    """Return a figure with equal panels, placed in inches so that nothing overlaps."""
    width, height = (view.high - view.low) * view.inches_per_metre
    heading = 0.85 if view.side_by_side else 0.38
    top = 0.4 if title else 0.1
    bottom = _BOTTOM + 0.05 + _LEGEND_ROW * math.ceil(entries / _LEGEND_COLUMNS)
    rows = 1 if view.side_by_side else count
    total = top + rows * (height + heading) + bottom
    figure = Figure(figsize=(_WIDTH, total), dpi=style.DOTS_PER_INCH)
    panels = []
    for place in range(count):
        column, row = (place, 0) if view.side_by_side else (0, place)
        left = _LEFT + column * (width + _GAP)
        lower = total - top - (row + 1) * (height + heading)
        box = (left / _WIDTH, lower / total, width / _WIDTH, height / total)
        axes = figure.add_axes(box)
        style.style_axes(axes)
        axes.set_xlim(view.low[0], view.high[0])
        axes.set_ylim(view.low[1], view.high[1])
        axes.set_aspect("equal")
        axes.tick_params(labelbottom=row == rows - 1, labelleft=column == 0)
        axes.xaxis.set_major_locator(MaxNLocator(max(int(width * 1.2), 2), prune="both"))
        if row == rows - 1:
            axes.set_xlabel("x [m]", fontsize=style.LABEL_SIZE)
        if column == 0:
            axes.set_ylabel("y [m]", fontsize=style.LABEL_SIZE)
        panels.append(axes)
    if title:
        figure.suptitle(title, fontsize=style.TITLE_SIZE, y=1.0 - 0.12 / total, va="top")
    return figure, panels


def _panel_title(name: str, history: RunHistory, rest: RestCriterion, joint: str) -> str:
    metrics = run_metrics(history, rest=rest)
    distance = metrics["stopping_distance"]
    if math.isnan(distance.value):
        return f"{name}:{joint.strip(',')}{distance.note}"
    turned = f"turned {metrics['orientation_change'].value:.1f}°"
    stopped = f"stopped in {distance.value:.2f} m, {metrics['stopping_time'].value:.2f} s"
    return f"{name}:{joint.strip(',')}{joint.join((turned, stopped))}"


def _label_snapshots(
    axes: Axes, scene: Scene, history: RunHistory, snapshots: _Snapshots, view: _View
) -> None:
    """Write the time since the start of braking beside each snapshot, where there is room."""
    outline = rectangle(scene.chassis_length, scene.chassis_width)
    chassis = [placed(outline, history.pose[index]) for index in snapshots.indices]
    line = _LABEL_POINTS / 72.0 / view.inches_per_metre  # [m]
    taken: list[tuple[float, float]] = []
    for place in (len(chassis) - 1, *range(len(chassis) - 1)):  # the last one matters most
        x, y = history.pose[snapshots.indices[place], :2].tolist()
        label = snapshots.labels[place]
        width = 0.65 * line * (len(label) + 1)
        # Beside the path, which leads up the page when panels stand side by side.
        if view.side_by_side:
            x = float(np.min(chassis[place][:, 0])) - 0.5 * width
        else:
            y = float(np.max(chassis[place][:, 1])) + 0.8 * line
        hidden = any(Path(other).contains_point((x, y)) for other in chassis[place + 1 :])
        crowded = any(abs(x - x0) < width and abs(y - y0) < 1.5 * line for x0, y0 in taken)
        if not hidden and not crowded:
            taken.append((x, y))
            axes.text(
                x,
                y,
                label,
                fontsize=_LABEL_POINTS,
                ha="center",
                va="center",
                zorder=20,
                path_effects=[Stroke(linewidth=3, foreground="white"), Normal()],
            )
