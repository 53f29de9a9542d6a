"""Colors, sizes and file formats of all figures.

The colors are those of M. Okabe and K. Ito, which people with color-vision deficiencies can
distinguish. Figures are created with matplotlib's objects, never with pyplot. Importing this module
applies ``omni.mplstyle`` to all figures of the process.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
from matplotlib import artist

from omni_core.configuration import ConfigurationError
from omni_runs.history import RunHistory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The lists of the properties of each class, for its documentation, would take a quarter of
# matplotlib's import time.
artist.kwdoc = lambda artist: ""  # noqa: ARG005

ORANGE, SKY, GREEN = "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
BLACK, GRAY, PALE = "#222222", "#8A8A8A", "#DDDDDD"

# Successive colors also differ in lightness.
WHEEL_COLORS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILLION)

matplotlib.rcParams.update(
    matplotlib.rc_params_from_file(
        Path(__file__).with_name("omni.mplstyle"), use_default_template=False
    )
)
PAGE_WIDTH: float = matplotlib.rcParams["figure.figsize"][0]  # [in]


def wheel_color(index: int) -> str:
    """Return the color of the wheel with this index in the vehicle's order."""
    return WHEEL_COLORS[index % len(WHEEL_COLORS)]


def panels(
    title: str,
    rows: int = 1,
    columns: int = 1,
    *,
    size: tuple[float, float],
    x: str | Sequence[str] = "",
    y: str | Sequence[str] = "",
    **kwargs: Any,
) -> tuple[Figure, Any]:
    """Return a figure with a grid of axes, which is labeled along its lower and left edges.

    Args:
        title: title of the figure; may be empty.
        rows: number of rows of axes.
        columns: number of columns of axes.
        size: width and height [in].
        x: label of all x axes, or one label for each column.
        y: label of all y axes, or one label for each row.
        **kwargs: arguments of `Figure.subplots`, such as ``sharex=True``.

    Returns:
        The figure and its axes, shape (rows, columns).
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, **kwargs)
    if title:
        add_title(figure, title)
    for axes, words in zip(grid[-1], [x] * columns if isinstance(x, str) else x, strict=True):
        axes.set_xlabel(words)
    for axes, words in zip(grid[:, 0], [y] * rows if isinstance(y, str) else y, strict=True):
        axes.set_ylabel(words)
    return figure, grid


def add_title(figure: Figure, title: str) -> None:
    """Write the title of a figure at its upper left."""
    figure.suptitle(title, x=0.01, ha="left")


def tiles(
    title: str, count: int, columns: int, *, size: tuple[float, float], **look: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure with `count` equal panels in `columns` columns, and their axes.

    Args:
        title: title of the figure; may be empty.
        count: number of panels.
        columns: number of columns, of which some are empty if `count` is smaller.
        size: width and height of a panel with its share of the margins [in].
        **look: further arguments of `panels`.
    """
    rows = -(-count // columns)
    whole = size[0] * columns, size[1] * rows + 0.6
    figure, grid = panels(title, rows, columns, size=whole, **look)
    for axes in grid.flat[count:]:
        axes.set_visible(False)
    for axes in grid.flat[max(0, count - columns) : count]:  # the lowest panel of each column
        axes.set_xlabel(grid[-1, 0].get_xlabel())
        axes.tick_params(labelbottom=True)
    return figure, list(grid.flat[:count])


def legend_below(figure: Figure, columns: int, **look: Any) -> None:
    """Draw a legend with the labels of all axes below a figure, in at most `columns` columns.

    Args:
        figure: the figure.
        columns: limit on the number of columns.
        **look: further arguments of `Figure.legend`, such as the scale of small markers.
    """
    found: dict[str, Any] = {}
    for axes in figure.axes:
        handles, labels = axes.get_legend_handles_labels()
        found |= zip(labels, handles, strict=True)
    columns = min(columns, len(found))
    look |= {"ncols": columns}
    figure.legend(list(found.values()), list(found), loc="outside lower center", **look)


def draw_texture(axes: Axes, gray: Any, texel: float, edge: float) -> Any:
    """Draw a square section of a texture, and return its gray levels.

    Args:
        axes: axes to draw on.
        gray: gray levels of the texture, 0 to 255.
        texel: size of a pixel of the texture [m].
        edge: length of the section [m]; the whole texture is drawn if it is shorter.
    """
    count = min(len(gray), max(1, round(edge / texel)))
    piece, side = gray[:count, :count], 1e3 * count * texel
    axes.grid(False)
    axes.imshow(piece, cmap="gray", vmin=0, vmax=255, origin="lower", extent=(0, side, 0, side))
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    return piece


def note(
    axes: Axes, words: str, place: tuple[float, float], offset: tuple[float, float], **look: Any
) -> None:
    """Write `words` near the data point `place`, shifted from it by `offset` [points]."""
    axes.annotate(words, place, offset, textcoords="offset points", **look)


def time_label(histories: Iterable[RunHistory]) -> str:
    """Return the label of a time axis whose zero is the start of braking.

    If no vehicle brakes, zero is the start of the run.
    """
    braking = any(history.brake_start is not None for history in histories)
    return "time since braking" if braking else "time since the start"


def picture_of(figure: Figure, dots_per_inch: int = 80) -> bytes:
    """Return a figure as the bytes of a PNG file."""
    stream = io.BytesIO()
    _write(figure, stream, dots_per_inch, format="png", metadata={"Software": None})
    return stream.getvalue()


def save_figure(figure: Figure, path: Path | str) -> Path:
    """Write a figure as PNG or SVG, depending on the suffix; equal figures give equal bytes.

    Raises:
        ConfigurationError: the suffix is neither PNG nor SVG.
    """
    target = Path(path)
    if target.suffix not in {".png", ".svg"}:
        raise ConfigurationError("--out", f"{target} must end in .png or .svg")
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.suffix == ".svg":
        with matplotlib.rc_context({"svg.hashsalt": "omni"}):
            _write(figure, target, 72, metadata={"Date": None})
    else:
        _write(figure, target, matplotlib.rcParams["savefig.dpi"], metadata={"Software": None})
    return target


def _write(figure: Figure, target: Path | io.BytesIO, dots_per_inch: float, **look: Any) -> None:
    """Lay out a figure and write it; `savefig` would draw it one more time for its layout."""
    figure.set_dpi(dots_per_inch)
    if layout := figure.get_layout_engine():
        layout.execute(figure)
        figure.set_layout_engine(None)
    figure.savefig(target, dpi=dots_per_inch, **look)
