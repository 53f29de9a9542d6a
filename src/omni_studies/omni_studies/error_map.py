"""Figure of error maps: errors of a line camera as functions of two parameters."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from omni_core.quantities import FloatArray
from omni_runs.figures.style import BLACK, draw_texture, panels
from omni_sim.texture.texture import GroundTexture
from omni_studies.line_trials import view_grid

_EDGES = (0.0, 1e-9, 0.5, 2.0, 8.0, 32.0, 128.0, 1024.0)  # [px]
_SHADES = ("#FFFFFF", "#FDE7B0", "#F6C15C", "#E69F00", "#D55E00", "#8F2A00", "#3B0A00")
_NORM, _COLORS = BoundaryNorm(_EDGES, len(_SHADES)), ListedColormap(_SHADES)


class Scale(NamedTuple):
    """Axis of a map: its label and evenly spaced parameter values."""

    label: str
    values: Sequence[float]


def view_lengths(lengths: Sequence[float]) -> Scale:
    """Return the axis of a map for the given lengths of the field of view [m]."""
    return Scale("length of field of view [mm]", [1e3 * length for length in lengths])


def draw_error_maps(
    title: str,
    rows: Sequence[Mapping[str, FloatArray]],
    overlap: FloatArray,
    scales: tuple[Scale, Scale] | None = None,
    levels: Sequence[float] = (0.4, 0.6, 0.8),
    grounds: Mapping[str, GroundTexture] | None = None,
) -> Figure:
    """Draw maps of the mean error versus two parameters, with contours of the overlap.

    White areas have zero error.

    Args:
        title: title of the figure.
        rows: rows of maps; the maps of a row are keyed by title. A map contains the mean magnitude
            of the error in whole pixels, Eq. (84) [px], shape (y, x).
        overlap: overlap of consecutive lines, 0 to 1, shape (y, x).
        scales: axes along x and y; None for the lengths and shapes of the field of view in
            `view_grid`.
        levels: overlaps at which contour lines are drawn, 0 to 1.
        grounds: ground whose picture is drawn at the start of a row, keyed by row title.
    """
    if scales is None:
        shapes = Scale("width over length [%]", [100.0 * shape for shape in view_grid.SHAPES])
        scales = view_lengths(view_grid.LENGTHS), shapes
    first = 1 if grounds else 0
    columns = first + max(len(row) for row in rows)
    size = (3.6 * columns + 1.0, 3.6 * len(rows) + 0.6)
    figure, grid = panels(title, len(rows), columns, size=size)
    for own, (name, ground) in zip(grid, (grounds or {}).items(), strict=False):
        # As in Figure 59.
        draw_texture(own[0], ground.gray, ground.texel, 0.02)
        own[0].set_title(name)
    for own, row in zip(grid, rows, strict=True):
        maps = own[first : first + len(row)]
        for axes, (name, error) in zip(maps, row.items(), strict=True):
            _draw_map(axes, error, overlap, scales, levels)
            axes.set_title(name)
        for axes in own[first + len(row) :]:
            axes.set_visible(False)
    scale, every = ScalarMappable(_NORM, _COLORS), grid.ravel().tolist()
    bar = figure.colorbar(scale, ax=every, ticks=_EDGES, shrink=0.9, pad=0.01)
    bar.ax.set_yticklabels(["", "0", *(f"{edge:g}" for edge in _EDGES[2:])])
    bar.set_label("mean error [px], Eq. (84)")
    return figure


def _draw_map(
    axes: Axes,
    error: FloatArray,
    overlap: FloatArray,
    scales: tuple[Scale, Scale],
    levels: Sequence[float],
) -> None:
    x, y = (np.asarray(scale.values) for scale in scales)
    axes.grid(False)
    axes.pcolormesh(x, y, error, cmap=_COLORS, norm=_NORM, shading="nearest")
    lines = axes.contour(x, y, overlap, levels=list(levels), colors=BLACK, linewidths=1.0)
    # The outline makes the labels readable on the darkest shade.
    lines.set_path_effects([withStroke(linewidth=2.4, foreground="white")])
    for text in axes.clabel(lines, fmt=lambda level: f"{100.0 * level:.0f} %"):
        text.set_path_effects([withStroke(linewidth=3.0, foreground="white")])
    axes.set_xlabel(scales[0].label)
    axes.set_ylabel(scales[1].label)
