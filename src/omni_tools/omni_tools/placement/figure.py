"""Figure of camera placements under a chassis, with the velocity error at every point."""

import math
import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch, Polygon
from matplotlib.ticker import MaxNLocator

from omni_core.quantities import FloatArray
from omni_runs.figures import style
from omni_tools.placement.error import EvaluatedPlacement, MeanError, poses_of
from omni_tools.placement.mounting_area import MountingArea

_SHADES = LinearSegmentedColormap.from_list("error", ["#FFFFFF", "#FDE7B0", "#F0A830", "#B8480E"])
_ARROW_LOOK: dict[str, Any] = {
    "arrowstyle": "-|>", "mutation_scale": 11, "shrinkA": 0, "shrinkB": 0, "linewidth": 1.4,
    "color": style.BLUE, "zorder": 7,
}  # fmt: skip

_PANEL_WIDTH = 5.3  # width of a panel [in]
_LEVELS = 14  # number of colors
# Limits on the upper end of the color scale: multiple of the smallest error, and multiple of the
# mean error of the first placement [1].
_END = (1.5, 2.5)


def placement_figure(
    placements: Sequence[EvaluatedPlacement], criterion: MeanError, area: MountingArea, title: str
) -> Figure:
    """Draw placements side by side; the first one determines the color scale.

    Args:
        placements: placements to draw, at least one.
        criterion: criterion that computes the errors.
        area: the chassis.
        title: title of the figure.
    """
    low, high = _limits(placements, area)
    height = _PANEL_WIDTH * float((high[1] - low[1]) / (high[0] - low[0])) + 1.4
    look: dict[str, Any] = {"x": "forward [m]", "y": "left [m]", "sharex": True, "sharey": True}
    count = len(placements)
    size = (_PANEL_WIDTH + 1.2, height)
    figure, panels = style.tiles(title, count, min(count, 2), size=size, **look)
    norm = _norm(placements, criterion, area)
    for axes, placement in zip(panels, placements, strict=True):
        _draw(axes, placement, criterion, area, norm)
    panels[0].set_xlim(low[0], high[0])
    panels[0].set_ylim(low[1], high[1])
    words = "error of the velocity of a point of the platform [mm/s]"
    scale = ScalarMappable(norm=norm, cmap=_SHADES)
    figure.colorbar(scale, ax=figure.axes, shrink=0.8, pad=0.01, extend="max", label=words)
    handles: list[Line2D | Patch] = [
        Patch(color=style.BLUE, label="field of view"),
        Patch(facecolor="white", edgecolor=style.BLUE, label="housing"),
        Line2D([], [], color=style.BLUE, marker=">", markevery=[1], label="axis"),
        Patch(facecolor="#BBBBBB", edgecolor=style.GRAY, label="wheel"),
        Line2D([], [], color=style.BLACK, marker=">", linestyle="", label="front"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5)
    return figure


def _limits(
    placements: Sequence[EvaluatedPlacement], area: MountingArea
) -> tuple[FloatArray, FloatArray]:
    """Return two opposite corners of the area that every panel shows [m], shape (2,) each."""
    housings = [
        area.outline(pose, housing=True)
        for placement in placements
        for pose in poses_of(placement.sensors)
    ]
    points = np.concatenate([area.scene.drawn_points, *housings])
    margin = 0.03 * area.scene.chassis_length
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def _norm(
    placements: Sequence[EvaluatedPlacement], criterion: MeanError, area: MountingArea
) -> BoundaryNorm:
    """Return a color scale that starts at the smallest error of all panels.

    The scale ends at the largest error, within the limits `_END`.

    Args:
        placements: placements in the figure, at least one.
        criterion: criterion that gives the errors.
        area: the chassis.
    """
    regular = [p for p in placements if math.isfinite(p.mean_error) and not p.singular]
    if not regular:
        return BoundaryNorm(np.linspace(0.0, 1.0, _LEVELS + 1), _SHADES.N, extend="max")
    maps = np.array([_map(placement, criterion, area)[2] for placement in regular])
    lowest = float(np.min(maps))
    top = min(float(np.max(maps)), _END[1] * 1e3 * regular[0].mean_error)
    top = max(top, _END[0] * lowest)
    boundaries = MaxNLocator(_LEVELS, steps=(1.0, 2.0, 2.5, 5.0, 10.0)).tick_values(lowest, top)
    return BoundaryNorm(boundaries, _SHADES.N, extend="max")


def _map(
    placement: EvaluatedPlacement, criterion: MeanError, area: MountingArea
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a grid of points on the chassis: x, y [m] and RMS velocity error [mm/s]."""
    half = 0.5 * area.scene.chassis_length, 0.5 * area.scene.chassis_width
    x, y = np.meshgrid(*(np.linspace(-limit, limit, 81) for limit in half))
    return x, y, 1e3 * criterion.point_error(poses_of(placement.sensors), x, y)


def _draw(
    axes: Axes,
    placement: EvaluatedPlacement,
    criterion: MeanError,
    area: MountingArea,
    norm: BoundaryNorm,
) -> None:
    scene = area.scene
    if math.isfinite(placement.mean_error) and not placement.singular:
        x, y, error = _map(placement, criterion, area)
        axes.contourf(x, y, error, levels=norm.boundaries, cmap=_SHADES, norm=norm, extend="max")
        lines = axes.contour(x, y, error, levels=norm.boundaries, colors=style.GRAY, linewidths=0.6)
        axes.clabel(lines, fmt="%g", fontsize=8, zorder=2)
        headline = f"{placement.name}: {1e3 * placement.mean_error:.2f} mm/s"
        deviation = placement.deviation * (1e3, 1e3, 1e3)
        words = (
            f"v_x {deviation[0]:.2f} mm/s, v_y {deviation[1]:.2f} mm/s, "
            f"yaw rate {deviation[2]:.2f} mrad/s; condition number {placement.condition:.2f}"
        )
        if placement.mounting:
            words += f"; {placement.mounting}"
    else:
        axes.add_patch(Polygon(scene.chassis, facecolor=style.PALE, hatch="//", edgecolor="white"))
        headline = f"{placement.name}: singular"
        words = placement.singular or "the error is unbounded"
        _draw_axes_through(axes, placement, area)
    axes.add_patch(Polygon(scene.chassis, fill=False, edgecolor=style.BLACK, linewidth=1.4))
    nose = scene.chassis_length * np.array([(0.5, 0.0), (0.465, 0.025), (0.465, -0.025)])
    axes.add_patch(Polygon(nose, color=style.BLACK, zorder=4))
    for outline in scene.wheel_outlines:
        axes.add_patch(Polygon(outline, facecolor="#BBBBBB", edgecolor=style.GRAY, zorder=3))
    _draw_sensors(axes, placement, area)
    axes.set_title(headline, loc="left", pad=27)
    words = "\n".join(textwrap.wrap(words, 87)[:2])
    axes.text(0.0, 1.01, words, transform=axes.transAxes, fontsize=8.0, va="bottom")
    axes.grid(False)
    axes.set_aspect("equal")


def _draw_sensors(axes: Axes, placement: EvaluatedPlacement, area: MountingArea) -> None:
    size = area.scene.chassis_length
    for name, pose in zip(placement.sensors, poses_of(placement.sensors), strict=True):
        housing = area.outline(pose, housing=True)
        axes.add_patch(Polygon(housing, facecolor="white", edgecolor=style.BLUE, zorder=5))
        axes.add_patch(Polygon(area.outline(pose, housing=False), color=style.BLUE, zorder=6))
        direction = np.array([math.cos(pose[2]), math.sin(pose[2])])
        reach = 0.065 * size  # half the length of an arrow
        tail, tip = pose[:2] - reach * direction, pose[:2] + reach * direction
        axes.add_patch(FancyArrowPatch(tuple(tail), tuple(tip), **_ARROW_LOOK))
        inward = -np.sign(pose[:2]) * (np.abs(pose[:2]) > 0.05 * size)
        across = np.array([-direction[1], direction[0]])
        side = across if float(across @ inward) >= 0.0 else -across
        at = pose[:2] + (0.04 + 0.05 * abs(side[0])) * size * side
        axes.text(
            at[0], at[1], name.replace("_", " "), fontsize=8.0, ha="center", va="center", zorder=8
        )


def _draw_axes_through(axes: Axes, placement: EvaluatedPlacement, area: MountingArea) -> None:
    """Draw the lines of all axes; they meet in a point if the placement is singular."""
    reach = math.hypot(area.scene.chassis_length, area.scene.chassis_width)
    for x, y, heading in poses_of(placement.sensors):
        step = reach * np.array([math.cos(heading), math.sin(heading)])
        line = np.array([x, y]) + np.outer((-1.0, 1.0), step)
        axes.plot(*line.T, "--", color=style.VERMILLION, scalex=False, scaley=False, zorder=4)
