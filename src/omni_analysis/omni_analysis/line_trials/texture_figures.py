"""Figures of what a ground does to a line camera: error surfaces, and pictures of the ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import PercentFormatter

from omni_analysis.figures.style import (
    BLACK,
    LABEL_SIZE,
    TICK_SIZE,
    draw_title,
    style_axes,
    wheel_colour,
)
from omni_analysis.line_trials.view_grid import LENGTHS, SHAPES
from omni_platform.quantities import FloatArray
from omni_sim.texture.texture import GroundTexture

_EDGES = (0.0, 0.1, 1.0, 5.0, 20.0, 80.0, 512.0)  # [px]
_SHADES = ("#FFFFFF", "#FCE9C4", "#F3BE62", "#E07B1F", "#A63A0B", "#3F0C05")
_SAMPLE = 0.02  # edge of the pictures, as in Figure 59 [m]


def draw_error_surfaces(
    title: str,
    grounds: Mapping[str, GroundTexture],
    rows: Sequence[Mapping[str, FloatArray]],
    overlap: FloatArray,
) -> Figure:
    """Draw mean errors over the field of view, in rows that begin with a picture of the ground.

    Args:
        title: of the figure.
        grounds: one for each row, by what is written over its picture.
        rows: by title, maps of mean errors [px], shape (shapes, lengths).
        overlap: of consecutive lines for the same shapes, 0..1.
    """
    columns = 1 + max(len(row) for row in rows)
    figure = Figure(figsize=(3.3 * columns + 0.8, 3.3 * len(rows) + 0.6), layout="constrained")
    panels = figure.subplots(len(rows), columns, squeeze=False)
    draw_title(figure, title)
    norm, colours = BoundaryNorm(_EDGES, len(_SHADES)), ListedColormap(_SHADES)
    lengths, shares = [1e3 * x for x in LENGTHS], [100.0 * y for y in SHAPES]
    for axes_row, (label, ground), row in zip(panels, grounds.items(), rows, strict=True):
        texels = min(len(ground.grey), round(_SAMPLE / ground.texel))
        edge = 1e3 * texels * ground.texel
        axes_row[0].imshow(
            ground.grey[:texels, :texels],
            cmap="gray",
            vmin=0,
            vmax=255,
            origin="lower",
            extent=(0, edge, 0, edge),
        )
        axes_row[0].set_title(label, fontsize=LABEL_SIZE, loc="left")
        axes_row[0].set_xlabel("x [mm]", fontsize=LABEL_SIZE)
        axes_row[0].set_ylabel("y [mm]", fontsize=LABEL_SIZE)
        for axes, (name, error) in zip(axes_row[1:], row.items(), strict=True):
            axes.pcolormesh(lengths, shares, error, cmap=colours, norm=norm, shading="nearest")
            lines = axes.contour(
                lengths, shares, overlap, levels=[0.4, 0.6, 0.8], colors=BLACK, linewidths=0.9
            )
            lines.set_path_effects([withStroke(linewidth=2.2, foreground="white")])
            for text in axes.clabel(lines, fmt=_percent, fontsize=TICK_SIZE):
                text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])
            axes.set_title(name, fontsize=LABEL_SIZE, loc="left")
            axes.set_xlabel("length of field of view [mm]", fontsize=LABEL_SIZE)
            axes.set_ylabel("width over length [%]", fontsize=LABEL_SIZE)
        for axes in axes_row:
            axes.tick_params(labelsize=TICK_SIZE, colors=BLACK, length=3)
    _add_scale(figure, norm, colours, panels[:, -1].tolist())
    return figure


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _add_scale(
    figure: Figure, norm: BoundaryNorm, colours: ListedColormap, panels: list[Axes]
) -> None:
    bar = figure.colorbar(
        ScalarMappable(norm=norm, cmap=colours), ax=panels, spacing="uniform", ticks=_EDGES
    )
    bar.ax.set_yticklabels([f"{edge:g}" for edge in _EDGES])
    bar.set_label("mean error [px], Eq. (84); lines: overlap", fontsize=LABEL_SIZE)
    bar.ax.tick_params(labelsize=TICK_SIZE)


def draw_speed_limits(
    computed: Mapping[str, float],
    speeds: Mapping[str, FloatArray],
    right: Mapping[str, Mapping[str, FloatArray]],
    needed: float,
) -> Figure:
    """Draw the share of right measurements over sideways speed, a panel for each sensor.

    Args:
        computed: speed at 60 % overlap by sensor [m/s].
        speeds: tried, by sensor [m/s].
        right: share at each of them, by sensor and ground.
        needed: share that counts as measured.
    """
    figure = Figure(figsize=(5.2 * len(speeds), 4.2), layout="constrained")
    panels = figure.subplots(1, len(speeds), sharey=True, squeeze=False)[0]
    draw_title(figure, "Medians of 10 within 1.5 px while moving sideways at 89 deg (Table 4)")
    for axes, (sensor, tried) in zip(panels, speeds.items(), strict=True):
        style_axes(axes)
        for i, (ground, share) in enumerate(right[sensor].items()):
            axes.plot(tried, share, color=wheel_colour(i), label=ground, linewidth=1.6)
        axes.axvline(computed[sensor], color=BLACK, linewidth=1.0, linestyle="--")
        axes.axhline(needed, color=BLACK, linewidth=0.8, linestyle=":")
        axes.annotate(
            f"60 % overlap:\n{computed[sensor]:.3g} m/s",
            (computed[sensor], 0.06),
            xytext=(5, 0),
            textcoords="offset points",
            fontsize=TICK_SIZE,
        )
        axes.set_title(sensor, fontsize=LABEL_SIZE, loc="left")
        axes.set_xlabel("speed [m/s]", fontsize=LABEL_SIZE)
        axes.set_ylim(0.0, 1.03)
        axes.set_xlim(left=0.0)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    panels[0].set_ylabel("right medians", fontsize=LABEL_SIZE)
    panels[0].legend(fontsize=TICK_SIZE, frameon=False, loc="center left")
    return figure
