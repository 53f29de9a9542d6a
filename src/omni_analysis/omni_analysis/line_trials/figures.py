"""Figures of the studies of one line camera: maps of errors over two parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from omni_analysis.figures.style import BLACK, LABEL_SIZE, TICK_SIZE
from omni_platform.quantities import FloatArray

_EDGES = (0.0, 1e-9, 0.5, 2.0, 8.0, 32.0, 128.0, 1024.0)
_SHADES = ("#FFFFFF", "#FDE7B0", "#F6C15C", "#E69F00", "#D55E00", "#8F2A00", "#3B0A00")
ERROR_COLOURS = ListedColormap(_SHADES)
ERROR_NORM = BoundaryNorm(_EDGES, len(_SHADES))


def draw_error_map(
    axes: Axes,
    x: Sequence[float],
    y: Sequence[float],
    error: FloatArray,
    overlap: FloatArray,
    levels: Sequence[float] = (0.4, 0.6, 0.8),
) -> None:
    """Draw mean errors over two parameters, with lines of equal overlap; white is no error.

    Args:
        axes: where to.
        x: values of the first parameter, evenly spaced.
        y: values of the second one.
        error: mean magnitude of (84) [px], shape (len(y), len(x)).
        overlap: of consecutive frames, same shape, 0..1.
        levels: of the lines of equal overlap.
    """
    axes.pcolormesh(
        np.asarray(x), np.asarray(y), error, cmap=ERROR_COLOURS, norm=ERROR_NORM, shading="nearest"
    )
    lines = axes.contour(
        np.asarray(x), np.asarray(y), overlap, levels=list(levels), colors=BLACK, linewidths=1.0
    )
    # Readable on the darkest shade too.
    labels = axes.clabel(lines, fmt=lambda level: f"{100.0 * level:.0f} %", fontsize=TICK_SIZE)
    for label in labels:
        label.set_path_effects([withStroke(linewidth=3.0, foreground="white")])
    lines.set_path_effects([withStroke(linewidth=2.4, foreground="white")])
    axes.tick_params(labelsize=TICK_SIZE, colors=BLACK, length=3)


def add_error_scale(figure: Figure, panels: Sequence[Axes]) -> None:
    """Add the colour scale of `draw_error_map` beside some panels."""
    bar = figure.colorbar(
        ScalarMappable(norm=ERROR_NORM, cmap=ERROR_COLOURS),
        ax=list(panels),
        spacing="uniform",
        ticks=_EDGES,
        shrink=0.9,
        pad=0.01,
    )
    bar.ax.set_yticklabels(["", "0", *(f"{edge:g}" for edge in _EDGES[2:])])
    bar.set_label("mean error [px]", fontsize=LABEL_SIZE)
