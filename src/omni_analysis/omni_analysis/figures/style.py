"""What the project's figures share: colours, sizes, and how they reach a file.

Colours are those of M. Okabe and K. Ito, which readers with any common colour vision tell apart.
Figures are made with matplotlib's objects, never with pyplot, so nothing global changes.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_analysis.loop.history import RunHistory

ORANGE, SKY, GREEN = "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
BLACK, GREY, PALE = "#222222", "#8A8A8A", "#DDDDDD"

# Neighbours differ in lightness too.
WHEEL_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILLION)

DOTS_PER_INCH = 100
TITLE_SIZE, LABEL_SIZE, TICK_SIZE = 12.0, 11.0, 9.5


def wheel_colour(index: int) -> str:
    """Return the colour of a wheel by its place in the vehicle's order."""
    return WHEEL_COLOURS[index % len(WHEEL_COLOURS)]


def style_axes(axes: Axes) -> None:
    """Give axes the project's look: no frame on the right and top, a faint grid, small ticks."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(GREY)
    axes.grid(True, color=PALE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=TICK_SIZE, colors=BLACK, length=3)


def draw_title(figure: Figure, title: str) -> None:
    """Write the title of a figure at its left."""
    figure.suptitle(title, fontsize=TITLE_SIZE, x=0.01, ha="left")


def time_label(histories: Iterable[RunHistory]) -> str:
    """Return what `RunHistory.braking_time` of these runs counts."""
    braking = any(history.brake_start is not None for history in histories)
    return "time since braking" if braking else "time since the start"


def picture_of(figure: Figure, dots_per_inch: int = 80) -> bytes:
    """Return a figure as the bytes of a PNG file."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dots_per_inch, metadata={"Software": None})
    return stream.getvalue()


def save_figure(figure: Figure, path: Path | str) -> Path:
    """Write a figure as PNG or SVG, by the suffix; the same figure gives the same bytes.

    Raises:
        ValueError: another suffix.
    """
    target = Path(path)
    if target.suffix not in {".png", ".svg"}:
        raise ValueError(f"{target.name}: a figure is written as .png or .svg")
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.suffix == ".svg":
        import matplotlib

        with matplotlib.rc_context({"svg.hashsalt": "omni"}):
            figure.savefig(target, metadata={"Date": None})
    else:
        figure.savefig(target, dpi=DOTS_PER_INCH, metadata={"Software": None})
    return target
