"""Elements of the top view: ground, paths, a platform with its wheels."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon

from omni_figures import style
from omni_figures.scene import Scene, placed
from omni_figures.snapshots import velocity_arrow
from omni_loop.history import RunHistory
from omni_platform.geometry import PlatformGeometry

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


def draw_ground(axes: Axes, scene: Scene) -> None:
    """Shade the patches of different friction, each with its friction factor."""
    for patch in scene.patches:
        axes.add_patch(Polygon(patch.outline, zorder=1, **_patch_look(patch.friction)))


def draw_paths(axes: Axes, history: RunHistory) -> None:
    """Draw the path of `base_link`, and the line of motion at the start of braking."""
    axes.plot(*history.pose[:, :2].T, zorder=8, **_TRAIL)
    start = history.brake_start
    if start is not None:
        x, y = history.pose[start, :2]
        v_x, v_y = history.velocity_world[start]
        if v_x or v_y:
            axes.axline((x, y), (x + v_x, y + v_y), zorder=2, **_FIRST_LINE)


def draw_snapshot(
    axes: Axes, scene: Scene, history: RunHistory, index: int, arrow_scale: float, age: float
) -> None:
    """Draw the platform as it was at one stamp.

    Args:
        axes: axes to draw on.
        scene: the vehicle.
        history: run of the vehicle.
        index: index of the stamp.
        arrow_scale: length of the velocity arrow per speed [m / (m/s)].
        age: 0 for the last snapshot, nearly 1 for the first one; older snapshots are fainter.
    """
    pose = history.pose[index]
    layer = 3.0 + 4.0 * (1.0 - age)
    faint = 1.0 - 0.65 * age
    chassis = placed(scene.chassis, pose)
    axes.add_patch(
        Polygon(chassis, facecolor=_CHASSIS, edgecolor=style.BLACK, alpha=faint, zorder=layer)
    )
    nose = scene.chassis_length * np.array([(0.48, 0.0), (0.38, 0.06), (0.38, -0.06)])
    axes.add_patch(Polygon(placed(nose, pose), color=style.BLACK, alpha=faint, zorder=layer + 0.1))
    _draw_wheels(axes, scene, history, index, layer + 0.2, faint)
    if scene.load_arm is not None:
        arm = placed(scene.load_arm, pose)
        axes.plot(arm[:, 0], arm[:, 1], alpha=faint, zorder=layer + 0.25, **_LOAD_ARM)
    for point, look, size in ((scene.load, _LOAD, 10.0), (scene.center_of_gravity, _GRAVITY, 7.0)):
        if point is not None:
            x, y = placed(np.array([point]), pose)[0]
            axes.plot([x], [y], markersize=size, alpha=faint, zorder=layer + 0.3, **look)
    arrow = velocity_arrow(scene, history, index, arrow_scale)
    if arrow is not None:
        axes.add_patch(FancyArrowPatch(*map(tuple, arrow), zorder=12, **_ARROW))


def _draw_wheels(
    axes: Axes, scene: Scene, history: RunHistory, index: int, layer: float, faint: float
) -> None:
    """Draw wheels with their active directions; the share of brake pressure determines the tint."""
    geometry = PlatformGeometry.from_wheels(scene.wheels)
    pose = history.pose[index]
    for row, (name, outline) in enumerate(zip(geometry.names, scene.wheel_outlines, strict=True)):
        color = style.wheel_color(row)
        face = _tinted(color, _share(history, index, name))
        patch = Polygon(placed(outline, pose), facecolor=face, edgecolor=color, linewidth=1.4)
        patch.set(alpha=faint, zorder=layer)
        axes.add_patch(patch)
        reach = 0.6 * geometry.radius[row] * geometry.active[row]
        ends = placed(geometry.position[row] + np.array([reach, -reach]), pose)
        axes.plot(*ends.T, color=style.BLACK, linewidth=1.6, alpha=faint, zorder=layer + 0.05)


def _share(history: RunHistory, index: int, wheel: str) -> float:
    """Return the share of the pedal's pressure at a wheel's brake [1]."""
    if wheel not in history.wheel_names or not history.pedal[index] > 0.0:
        return 0.0
    share = float(history.enable[index, history.wheel_names.index(wheel)])
    # Without an enable the brake is on, as on a real vehicle.
    return 1.0 if math.isnan(share) else share


def _tinted(color: str, share: float) -> tuple[float, ...]:
    """Return a mixture of white and a color, with the given share of the color [0 to 1]."""
    return tuple(1.0 - share * (1.0 - part) for part in to_rgb(color))


def legend_handles(scene: Scene, fastest: float, time_label: str) -> list[Line2D | Patch]:
    """Return the legend entries of a top view.

    Args:
        scene: determines the entries.
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
    """Return the color of a patch: a deeper blue for a lower friction."""
    depth = 0.15 + 0.5 * (1.0 - min(max(friction, 0.0), 1.0))
    return {"facecolor": (*to_rgb(style.SKY), depth), "edgecolor": style.SKY, "hatch": "//"}
