"""Top view of braking: snapshots of every variant, like Figures 24 and 30 of the dissertation.

Every variant or stop has a panel, all with the same scale, so that distances can be compared by
eye. Times are counted from the start of braking; `scene` selects the moments.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from omni_runs.figures import scene as scenes
from omni_runs.figures import style

# isort: split
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from omni_core.geometry import PlatformGeometry
from omni_core.quantities import FloatArray
from omni_runs.history import RunHistory
from omni_runs.metrics import run_metrics

_CHASSIS = "#F2EBDD"
_LOAD: dict[str, Any] = {"marker": "o", "color": style.GRAY, "markeredgecolor": style.BLACK}
_LOAD_ARM: dict[str, Any] = {"color": style.BLACK, "linewidth": 2.5}
_GRAVITY: dict[str, Any] = {"marker": "P", "color": "white", "markeredgecolor": style.BLACK}
_ARROW: dict[str, Any] = {
    "arrowstyle": "-|>", "mutation_scale": 12, "shrinkA": 0, "shrinkB": 0, "linewidth": 2.0,
    "color": style.VERMILLION,
}  # fmt: skip
_VELOCITY: dict[str, Any] = {
    "color": style.VERMILLION, "linewidth": 2, "marker": ">", "markevery": [1],
}  # fmt: skip
_ACTIVE: dict[str, Any] = {"marker": (2, 0, -45), "markersize": 11, "markeredgewidth": 1.6}
_TIME: dict[str, Any] = {
    "marker": r"$\mathrm{0.5\ s}$", "markersize": 22, "markeredgewidth": 0.1,
}  # fmt: skip
_TRAIL: dict[str, Any] = {"label": "path of base_link", "color": style.BLACK, "linewidth": 1.2}
_FIRST_LINE: dict[str, Any] = {"color": style.GRAY, "linewidth": 1.2, "linestyle": (0, (6, 3))}

# Length of the velocity arrow at the highest speed, as a multiple of the chassis length.
_ARROW_LENGTH = 0.9
_ENTRIES = 7  # number of entries in a row of the legend
_LABEL_SIZE = 9.0  # font size of the labels of snapshots [points]


def draw_ground(axes: Axes, scene: scenes.Scene) -> None:
    """Shade the patches of different friction, each with its friction factor."""
    for patch in scene.patches:
        axes.add_patch(Polygon(patch.outline, zorder=1, **_patch_look(patch.friction)))


def draw_paths(axes: Axes, history: RunHistory) -> None:
    """Draw the path of `base_link`, and a line along its velocity at the start of braking."""
    axes.plot(*history.pose[:, :2].T, zorder=8, **_TRAIL)
    start = history.brake_start
    if start is not None:
        x, y = history.pose[start, :2]
        v_x, v_y = history.velocity_world[start]
        if v_x or v_y:
            axes.axline((x, y), (x + v_x, y + v_y), zorder=2, **_FIRST_LINE)


def draw_snapshot(
    axes: Axes, scene: scenes.Scene, history: RunHistory, index: int, arrow_scale: float, age: float
) -> None:
    """Draw the platform with its pose, velocity and brake pressures at one time stamp.

    Args:
        axes: axes to draw on.
        scene: the vehicle.
        history: run of the vehicle.
        index: index of the time stamp in the history.
        arrow_scale: length of the velocity arrow per speed [m / (m/s)].
        age: 0 for the last snapshot, nearly 1 for the first one; older snapshots are fainter.
    """
    pose = history.pose[index]
    layer = 3.0 + 4.0 * (1.0 - age)
    faint = 1.0 - 0.65 * age
    chassis = scenes.placed(scene.chassis, pose)
    axes.add_patch(
        Polygon(chassis, facecolor=_CHASSIS, edgecolor=style.BLACK, alpha=faint, zorder=layer)
    )
    nose = scene.on_chassis((0.48, 0.0), (0.38, 0.06), (0.38, -0.06))
    axes.add_patch(
        Polygon(scenes.placed(nose, pose), color=style.BLACK, alpha=faint, zorder=layer + 0.1)
    )
    _draw_wheels(axes, scene, history, index, layer + 0.2, faint)
    if scene.load_arm is not None:
        arm = scenes.placed(scene.load_arm, pose)
        axes.plot(arm[:, 0], arm[:, 1], alpha=faint, zorder=layer + 0.25, **_LOAD_ARM)
    for point, look, size in ((scene.load, _LOAD, 10.0), (scene.center_of_gravity, _GRAVITY, 7.0)):
        if point is not None:
            x, y = scenes.placed(np.array([point]), pose)[0]
            axes.plot([x], [y], markersize=size, alpha=faint, zorder=layer + 0.3, **look)
    arrow = scenes.velocity_arrow(scene, history, index, arrow_scale)
    if arrow is not None:
        axes.add_patch(FancyArrowPatch(*map(tuple, arrow), zorder=12, **_ARROW))


def _draw_wheels(
    axes: Axes, scene: scenes.Scene, history: RunHistory, index: int, layer: float, faint: float
) -> None:
    """Draw the wheels with their active directions at one time stamp.

    The tint of a wheel shows the share of the demanded brake pressure that acts on it.

    Args:
        axes: axes to draw on.
        scene: the vehicle.
        history: run of the vehicle.
        index: index of the time stamp in the history.
        layer: order of drawing; higher layers cover lower ones.
        faint: opacity, 0 to 1.
    """
    geometry = PlatformGeometry.from_wheels(scene.wheels)
    pose = history.pose[index]
    for row, (name, outline) in enumerate(zip(geometry.names, scene.wheel_outlines, strict=True)):
        color = style.wheel_color(row)
        face = _tinted(color, _share(history, index, name))
        patch = Polygon(
            scenes.placed(outline, pose), facecolor=face, edgecolor=color, linewidth=1.4
        )
        patch.set(alpha=faint, zorder=layer)
        axes.add_patch(patch)
        reach = 0.6 * geometry.radius[row] * geometry.active[row]
        ends = scenes.placed(geometry.position[row] + np.array([reach, -reach]), pose)
        axes.plot(*ends.T, color=style.BLACK, linewidth=1.6, alpha=faint, zorder=layer + 0.05)


def _share(history: RunHistory, index: int, wheel: str) -> float:
    """Return the share of the demanded brake pressure that acts on a wheel, 0 to 1."""
    if wheel not in history.wheel_names or not history.pedal[index] > 0.0:
        return 0.0
    share = float(history.enable[index, history.wheel_names.index(wheel)])
    # Without an enable the brake is on, as on a real vehicle.
    return 1.0 if math.isnan(share) else share


def _tinted(color: str, share: float) -> tuple[float, ...]:
    """Return a mixture of white and `color` as RGB values; `share` of `color` is 0 to 1."""
    return tuple(1.0 - share * (1.0 - part) for part in to_rgb(color))


def legend_handles(scene: scenes.Scene, fastest: float, time_label: str) -> list[Line2D | Patch]:
    """Return the legend entries of a top view.

    Args:
        scene: vehicle and ground, which determine the entries.
        fastest: speed of the longest arrow [m/s].
        time_label: meaning of the times next to the snapshots.
    """
    handles: list[Line2D | Patch] = [
        Patch(facecolor=style.wheel_color(row), label=name.replace("_", " "))
        for row, name in enumerate(scene.wheels)
    ]
    handles += [
        Patch(facecolor="white", edgecolor=style.GRAY, label="brake released"),
        Line2D([], [], color=style.BLACK, linestyle="", label="active direction", **_ACTIVE),
        Line2D([], [], color=style.BLACK, marker="^", linestyle="", label="front"),
    ]
    if scene.load is not None:
        handles.append(Line2D([], [], linestyle="", markersize=9, label="load", **_LOAD))
    if scene.center_of_gravity is not None:
        look = {"linestyle": "", "markersize": 7, **_GRAVITY}
        handles.append(Line2D([], [], label="center of gravity", **look))
    handles += [
        Line2D([], [], **_TRAIL),
        Line2D([], [], label="line along initial velocity", **_FIRST_LINE),
        Line2D([], [], label=f"velocity (longest {fastest:.1f} m/s)", **_VELOCITY),
        Line2D([], [], color=style.BLACK, linestyle="", label=time_label, **_TIME),
    ]
    handles += [
        Patch(label=f"friction factor {friction:g}", **_patch_look(friction))
        for friction in sorted({patch.friction for patch in scene.patches})
    ]
    return handles


def _patch_look(friction: float) -> dict[str, Any]:
    """Return the drawing style of a patch: a deeper blue for a lower friction."""
    depth = 0.15 + 0.5 * (1.0 - min(max(friction, 0.0), 1.0))
    return {"facecolor": (*to_rgb(style.SKY), depth), "edgecolor": style.SKY, "hatch": "//"}


@dataclasses.dataclass(frozen=True)
class _View:
    """Area of the ground that the first panel shows, and the layout of the panels."""

    low: FloatArray  # lower left corner [m]
    high: FloatArray  # upper right corner [m]
    offsets: Mapping[str, FloatArray]  # of the area of each panel from that of the first [m]
    side_by_side: bool
    inches_per_meter: float

    def moved(self, offset: FloatArray) -> "_View":
        """Return the view of a panel whose area has an offset [m], shape (2,)."""
        return dataclasses.replace(self, low=self.low + offset, high=self.high + offset)


def top_view(
    scene: scenes.Scene, histories: Mapping[str, RunHistory], *, title: str = ""
) -> Figure:
    """Draw snapshots of every variant's braking from above.

    Args:
        scene: vehicle and ground.
        histories: time history of each variant's run, keyed by variant, in the order of the panels.
        title: title above the panels.

    Raises:
        ValueError: there is no history.
    """
    if not histories:
        raise ValueError("a top view needs at least one history")
    greatest = max(_greatest_speed(h, slice(h.brake_start or 0, None)) for h in histories.values())
    arrow_scale = _ARROW_LENGTH * scene.chassis_length / greatest if greatest > 0.0 else 0.0
    snapshots = scenes.choose_snapshots(scene, histories, arrow_scale)
    fastest = max(_greatest_speed(h, list(snapshots[n].indices)) for n, h in histories.items())
    view = _choose_view(scene, histories, snapshots, arrow_scale)
    handles = legend_handles(scene, fastest, style.time_label(histories.values()))
    figure, panels = _lay_out(view, handles, title)
    for axes, (name, history) in zip(panels, histories.items(), strict=True):
        here = view.moved(view.offsets[name])
        axes.set(xlim=(here.low[0], here.high[0]), ylim=(here.low[1], here.high[1]))
        joint = "\n" if view.side_by_side else ", "
        axes.set_title(_panel_title(name, history, joint))
        draw_ground(axes, scene)
        draw_paths(axes, history)
        chosen = snapshots[name].indices
        for age, index in enumerate(reversed(chosen)):
            draw_snapshot(axes, scene, history, index, arrow_scale, age / len(chosen))
        covered = [scenes.snapshot_outlines(scene, history, i, arrow_scale) for i in chosen]
        _label_snapshots(axes, covered, snapshots[name].labels, here)
    return figure


def _greatest_speed(history: RunHistory, stamps: slice | list[int]) -> float:
    twist = history.twist[stamps]
    return float(np.max(np.hypot(twist[:, 0], twist[:, 1])))


def _choose_view(
    scene: scenes.Scene,
    histories: Mapping[str, RunHistory],
    snapshots: Mapping[str, scenes.Snapshots],
    arrow_scale: float,
    height: float = 10.0,
    lowest: float = 1.3,
) -> _View:
    """Choose an area that contains the snapshots of all variants, and its largest possible scale.

    Args:
        scene: vehicle and ground.
        histories: time history of each variant's run, keyed by variant.
        snapshots: snapshots, keyed by variant.
        arrow_scale: length of an arrow per speed [m / (m/s)].
        height: height of all panels together [in].
        lowest: minimum height of a panel [in].
    """
    offsets = _offsets(scene, histories)
    points = []
    for name, history in histories.items():
        indices = list(snapshots[name].indices)
        own = [scenes.placed(scene.drawn_points, history.pose[index]) for index in indices]
        own.append(history.pose[indices, :2] + arrow_scale * history.velocity_world[indices])
        own.append(history.pose[indices[0] :, :2])
        points += [part - offsets[name] for part in own]
    everything = np.concatenate(points)
    margin = 0.15 * max(scene.chassis_length, scene.chassis_width)
    low, high = np.min(everything, axis=0) - margin, np.max(everything, axis=0) + margin
    span = high - low
    side_by_side = bool(span[1] > span[0]) and len(histories) > 1
    columns, rows = (len(histories), 1) if side_by_side else (1, len(histories))
    # Width of a panel, without axis labels, titles and legend.
    width = (style.PAGE_WIDTH - 1.0 - 0.3 * (columns - 1)) / columns
    room = np.array([width, height / rows])
    # Labels are to the left of platforms that move up the page, and above all others.
    label = np.array([0.55, 0.0] if side_by_side else [0.0, 0.2])
    scale = float(np.min((room - label) / span))
    low, high = low - (label * [1, 0]) / scale, high + (label * [0, 1]) / scale
    # Enlarge the shown area, so that every panel fills its space.
    wanted = np.array([room[0], max(lowest, (high - low)[1] * scale)])
    slack = np.maximum(wanted / scale - (high - low), 0.0)
    return _View(low - slack / 2.0, high + slack / 2.0, offsets, side_by_side, scale)


def _offsets(scene: scenes.Scene, histories: Mapping[str, RunHistory]) -> dict[str, FloatArray]:
    """Return the offset of each panel's area from that of the first panel [m], shape (2,).

    All panels show the same area, unless the runs brake at different places, as in a drive with
    several stops.
    """
    starts = {name: h.pose[h.brake_start or 0, :2] for name, h in histories.items()}
    first = next(iter(starts.values()))
    offsets = {name: start - first for name, start in starts.items()}
    if all(np.hypot(*offset) < scene.chassis_length for offset in offsets.values()):
        return dict.fromkeys(offsets, np.zeros(2))
    return offsets


def _lay_out(view: _View, handles: Sequence[Any], title: str) -> tuple[Figure, Any]:
    """Return a figure with equal panels and a legend of `_ENTRIES` entries per row."""
    width, height = (view.high - view.low) * view.inches_per_meter
    count, same = len(view.offsets), not any(map(np.any, view.offsets.values()))
    rows, columns = (1, count) if view.side_by_side else (count, 1)
    legend = 0.25 * math.ceil(len(handles) / _ENTRIES)
    total = rows * (height + (1.3 if view.side_by_side else 0.38)) + 1.1 + legend
    size = style.PAGE_WIDTH, total
    figure, grid = style.panels(
        title, rows, columns, size=size, x="x [m]", y="y [m]", sharex=same, sharey=same
    )
    for axes in grid.flat:
        axes.set_aspect("equal")
        axes.xaxis.set_major_locator(MaxNLocator(max(int(width * 1.2), 2), prune="both"))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(_ENTRIES, len(handles)))
    return figure, grid.flat


def _panel_title(name: str, history: RunHistory, joint: str) -> str:
    metrics = run_metrics(history)
    distance = metrics["stopping_distance"]
    if math.isnan(distance.value):
        return f"{name}:{joint.strip(',')}{distance.note}"
    turned = f"turned {metrics['orientation_change'].value:.1f}°"
    stopped = f"stopped in {distance.value:.2f} m, {metrics['stopping_time'].value:.2f} s"
    return f"{name}:{joint.strip(',')}{joint.join((turned, stopped))}"


def _label_snapshots(
    axes: Axes, covered: Sequence[Sequence[FloatArray]], labels: Sequence[str], view: _View
) -> None:
    """Write each label next to its snapshot; omit a label for which there is no free place.

    Args:
        axes: axes to draw on.
        covered: outlines of each snapshot in `odom` [m], the chassis first.
        labels: label of each snapshot.
        view: area that the axes show.
    """
    line = _LABEL_SIZE / 72.0 / view.inches_per_meter  # [m]
    outlines = [outline for snapshot in covered for outline in snapshot]
    taken: list[Bbox] = []
    for place in (len(labels) - 1, *range(len(labels) - 1)):  # last label first: it matters most
        label = labels[place]
        size = np.array([0.6 * line * (len(label) + 1), 1.4 * line])
        for center in _label_places(covered[place][0], size, view.side_by_side):
            box = Bbox([center - size / 2.0, center + size / 2.0])
            on_page = np.all(box.min > view.low) and np.all(box.max < view.high)
            corners = scenes.rectangle(*size.tolist()) + center
            crowded = any(scenes.overlap(corners, outline) for outline in outlines)
            if on_page and not crowded and not box.count_overlaps(taken):
                taken.append(box)
                halo = [Stroke(linewidth=3, foreground="white"), Normal()]
                x, y = center.tolist()
                look: dict[str, Any] = {"fontsize": _LABEL_SIZE, "path_effects": halo}
                axes.text(x, y, label, ha="center", va="center", zorder=20, **look)
                break


def _label_places(chassis: FloatArray, size: FloatArray, beside: bool) -> Iterator[FloatArray]:
    """Yield possible centers of a label next to a chassis in `odom` [m], shape (2,), best first.

    Args:
        chassis: corners of the chassis in `odom` [m], shape (4, 2).
        size: width and height of the label [m].
        beside: whether to try places to the left and right first; otherwise those above and below
            are first.
    """
    low, high = np.min(chassis, axis=0), np.max(chassis, axis=0)
    # Next to the path, which points up the page if panels are side by side.
    sides = [(-1, 0), (1, 0)] if beside else [(0, 1), (0, -1)]
    for first, second in (sides, [(y, x) for x, y in sides]):
        for gap in (0.1, 0.6):  # gap in label heights
            reach = (high - low + size) / 2.0 + gap * size[1]
            yield (low + high) / 2.0 + reach * first
            yield (low + high) / 2.0 + reach * second
