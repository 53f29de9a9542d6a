"""The figures of section 3.6: velocities and errors of a run, and comparisons of two.

Figures 31, 32, 34, 35, 37, 38, 44-46 and 48 show the velocity of the platform in the body frame
with its yaw rate above, and the errors of the wheels below; Figures 40 and 42 compare velocities
component by component, and Figure 41 errors wheel by wheel.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_figures import style
from omni_loop.history import RunHistory
from omni_platform.quantities import FloatArray

_WIDTH, _ROW = 9.0, 2.6  # [inch]
_BEFORE = 0.2  # shown before the start of braking [s]
_COMPONENTS = ("$v_x$ [m/s]", "$v_y$ [m/s]", r"$\omega$ [rad/s]")
_REFERENCE, _COMPARED = style.BLUE, style.VERMILLION


def velocities_and_errors(history: RunHistory, title: str, *, errors: bool = True) -> Figure:
    """Draw velocity components and yaw rate, and below the errors of all wheels, over time.

    Args:
        history: the run.
        title: printed above.
        errors: False omits the lower part, as in Figure 44.
    """
    labels = ("velocity [m/s], [rad/s]", "error $s_i$ [m/s]")
    figure, panels = _rows(title, *labels[: 2 if errors else 1])
    colors = (style.BLUE, style.VERMILLION, style.GREEN)
    for column, (label, color) in enumerate(zip(_COMPONENTS, colors, strict=True)):
        panels[0].plot(history.braking_time, history.twist[:, column], color=color, label=label)
    if errors:
        for column, name in enumerate(history.wheel_names):
            error = _while_braking(history, history.error[:, column])
            color, label = style.wheel_color(column), name.replace("_", " ")
            panels[1].plot(history.braking_time, error, color=color, label=label, linewidth=1.1)
    _finish(panels, [history])
    return figure


def compare_velocities(runs: Mapping[str, tuple[RunHistory, FloatArray]], title: str) -> Figure:
    """Draw v_x, v_y and yaw rate in a row each, the runs over one another.

    Args:
        runs: history and twists of shape (T, 3), by name; two of them.
        title: printed above.
    """
    figure, panels = _rows(title, *_COMPONENTS)
    for row, axes in enumerate(panels):
        for (name, (history, twist)), look in zip(runs.items(), _looks(), strict=True):
            axes.plot(history.braking_time, twist[:, row], label=name, **look)
    _finish(panels, [history for history, _ in runs.values()], legends=1)
    return figure


def compare_errors(runs: Mapping[str, RunHistory], title: str) -> Figure:
    """Draw the errors of two runs over one another, one row for each wheel.

    Args:
        runs: runs by name; two of them, of one vehicle.
        title: printed above.
    """
    first = next(iter(runs.values()))
    labels = (f"{wheel.replace('_', ' ')}\n$s_i$ [m/s]" for wheel in first.wheel_names)
    figure, panels = _rows(title, *labels)
    for row, axes in enumerate(panels):
        for (name, history), look in zip(runs.items(), _looks(), strict=True):
            error = _while_braking(history, history.error[:, row])
            axes.plot(history.braking_time, error, label=name, **look)
    _finish(panels, list(runs.values()), legends=1)
    return figure


def _looks() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the lines of the two runs; the second is thin, so that the first stays visible."""
    return (
        {"color": _REFERENCE, "linewidth": 2.2, "zorder": 3},
        {"color": _COMPARED, "linewidth": 0.9, "zorder": 4},
    )


def _while_braking(history: RunHistory, values: FloatArray) -> FloatArray:
    shown = values.copy()
    shown[: history.brake_start] = np.nan
    return shown


def _rows(title: str, *labels: str) -> tuple[Figure, list[Axes]]:
    size = _WIDTH, 1.0 + len(labels) * _ROW
    x = "time since braking [s]"
    figure, grid = style.panels(title, len(labels), size=size, x=x, y=labels, sharex=True)
    for axes in grid[:, 0]:
        axes.axhline(0.0, color=style.GRAY, linewidth=0.8)
    return figure, list(grid[:, 0])


def _finish(panels: Sequence[Axes], runs: Sequence[RunHistory], legends: int | None = None) -> None:
    """Set a common time axis, mark the start of braking and add a legend."""
    low = max(-_BEFORE, min(float(run.braking_time[0]) for run in runs))
    high = max(float(run.braking_time[-1]) for run in runs)
    for place, axes in enumerate(panels):
        label = "pedal down" if place == 0 else None
        axes.axvline(0.0, color=style.BLACK, linestyle=":", linewidth=1.2, label=label)
        axes.set_xlim(low, high)
        if legends is None or place < legends:
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=1.6)
