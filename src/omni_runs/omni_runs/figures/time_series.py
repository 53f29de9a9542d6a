"""Velocities and errors over time while braking, like Figures 31 and 32 of the dissertation.

The figure has one column per variant. Its rows show the linear velocity in the body frame, the yaw
rate, the switching functions s_i of the wheels ("errors"), and the times at which each brake was
on. Time zero is the start of braking. All panels of a row have the same scale, except that a panel
whose lines would look flat has a scale of its own, which is labeled. Solid lines show the true
motion, and thin dashed lines the measurement of the odometry.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omni_runs.figures import style

# isort: split
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from omni_core.quantities import FloatArray
from omni_runs.history import RunHistory

_ROWS = (2.4, 1.7, 2.4)  # heights of the rows for velocity, yaw rate and errors [inch]
_TRUTH: tuple[dict[str, Any], ...] = (
    {"label": "$v_x$", "color": style.BLUE, "linewidth": 2.2},
    {"label": "$v_y$", "color": style.ORANGE, "linewidth": 2.2},
    {"label": "yaw rate", "color": style.GREEN, "linewidth": 2.2},
)
_ODOMETRY: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": (0, (4, 3))}
_OWN_SCALE = "#FFF7DC"  # background of a panel that has its own scale

AxisLimits = tuple[float, float]
_BEFORE = 0.3  # time that is shown before the start of braking [s]
# A panel whose values span less than this share of the common scale gets its own scale [1].
_OWN_SHARE = 0.125
# A panel whose values span no more than this keeps the common scale [m/s] or [rad/s].
_LEAST_SPAN = 1e-3


def time_series(histories: Mapping[str, RunHistory], *, title: str = "") -> Figure:
    """Draw velocities, errors and brake enables of every variant over time.

    Args:
        histories: time history of each variant's run, keyed by variant, in the order of the
            columns.
        title: title above the columns.

    Raises:
        ValueError: there is no history.
    """
    if not histories:
        raise ValueError("time series need at least one history")
    wheels = list(dict.fromkeys(name for h in histories.values() for name in h.wheel_names))
    runs = list(histories.values())
    heights = (*_ROWS, 0.22 * len(wheels))
    size = (style.PAGE_WIDTH, sum(heights) + 1.6)  # with margins
    x = [f"{style.time_label([history])} [s]" for history in runs]
    y = ("velocity [m/s]", "yaw rate [rad/s]", "error $s_i$ [m/s]", "")
    figure, grid = style.panels(
        title, len(heights), len(runs), size=size, x=x, y=y, sharex=True, height_ratios=heights
    )
    columns = [list(panels) for panels in grid.T]
    for panels, (name, history) in zip(columns, histories.items(), strict=True):
        panels[0].set_title(name)
        panels[-1].tick_params(labelleft=panels is columns[0])
        _draw_twist(panels, history)
        _draw_errors(panels[2], history, wheels)
        _draw_brakes(panels[3], history, wheels)
        for axes in panels if history.brake_start is not None else ():
            axes.axvline(0.0, color=style.BLACK, linestyle=":", linewidth=1.2)
    _set_scales(columns, runs, _BEFORE)
    _add_legends(columns[-1], wheels)
    return figure


def _draw_twist(panels: Sequence[Axes], history: RunHistory) -> None:
    time = history.braking_time
    for component, (axes, look) in enumerate(zip((panels[0], *panels), _TRUTH, strict=False)):
        axes.axhline(0.0, color=style.GRAY, linewidth=0.8)
        axes.plot(time, history.twist[:, component], **look)
        label = f"odometry, {look['label']}"
        axes.plot(time, history.estimate[:, component], label=label, **_ODOMETRY)


def while_braking(history: RunHistory, values: FloatArray) -> FloatArray:
    """Return a copy of `values`, shape (T, ...), with NaN in all rows before braking starts."""
    shown = values.copy()
    shown[: history.brake_start] = np.nan
    return shown


def _draw_errors(axes: Axes, history: RunHistory, wheels: Sequence[str]) -> None:
    axes.axhline(0.0, color=style.GRAY, linewidth=0.8)
    error = while_braking(history, history.error)
    for column, name in enumerate(history.wheel_names):
        axes.plot(history.braking_time, error[:, column], **_wheel_line(name, wheels))


def _draw_brakes(axes: Axes, history: RunHistory, wheels: Sequence[str]) -> None:
    """Draw a strip for each wheel.

    Its height is the share of the demanded brake pressure that acts on the wheel.
    """
    axes.grid(False, axis="y")
    axes.set_yticks(range(len(wheels)), [name.replace("_", " ") for name in wheels])
    axes.set_ylim(len(wheels) - 0.4, -0.6)  # the first wheel on top
    time = history.braking_time
    edges = np.append(time, time[-1])  # each enable applies until the next stamp
    pressed = history.pedal > 0.0
    for column, name in enumerate(history.wheel_names):
        row = wheels.index(name)
        # Without an enable the brake is on, as on a real vehicle.
        share = np.where(pressed, np.nan_to_num(history.enable[:, column], nan=1.0), 0.0)
        share = np.append(share, share[-1])
        drawn = (share > 0.0) | (np.append(0.0, share[:-1]) > 0.0)  # up to the end of the period
        top = row + 0.35 - 0.7 * share
        look: dict[str, Any] = {"color": style.wheel_color(row), "linewidth": 0.0}
        axes.fill_between(edges, row + 0.35, top, where=drawn, step="post", **look)


def _set_scales(
    columns: Sequence[Sequence[Axes]], histories: Sequence[RunHistory], before: float
) -> None:
    """Set the limits of all panels; the time axis starts `before` seconds before braking."""
    first = max(-before, min(float(h.braking_time[0]) for h in histories))
    last = max(float(h.braking_time[-1]) for h in histories)
    for axes in (axes for panels in columns for axes in panels):
        axes.set_xlim(first, max(last, first + 1e-3))
    velocity, yaw_rate, error, _ = zip(*columns, strict=True)
    shown = [(h, h.braking_time >= -before) for h in histories]
    twist = [h.twist[i] for h, i in shown]
    estimate = [h.estimate[i] for h, i in shown]
    _scale_row(velocity, [t[:, :2] for t in twist], [e[:, :2] for e in estimate])
    _scale_row(yaw_rate, [t[:, 2] for t in twist], [e[:, 2] for e in estimate])
    _scale_row(error, [while_braking(h, h.error)[i] for h, i in shown], [])


def _scale_row(
    row: Sequence[Axes], shown: Sequence[FloatArray], noisy: Sequence[FloatArray]
) -> None:
    """Give all panels of a row a common scale, except for panels with much smaller values.

    Such a panel gets a scale of its own, which is labeled.

    Args:
        row: panels of one quantity.
        shown: values of each panel, all of which are within its limits.
        noisy: values of each panel whose outliers may be cut off.
    """
    common = _limits(shown, noisy)
    whole = common[1] - common[0]
    left: AxisLimits | None = None  # limits of the panel to the left
    for place, (axes, values) in enumerate(zip(row, shown, strict=True)):
        low, high = common
        known = np.append(values[np.isfinite(values)], 0.0)
        if _LEAST_SPAN < np.ptp(known) < _OWN_SHARE * whole:
            low, high = _limits([values], noisy[place : place + 1])
            high += 0.15 * (high - low)  # room for the label of the scale
            axes.set_facecolor(_OWN_SCALE)
            words = rf"own scale, {whole / (high - low):.0f}$\times$ finer"
            halo = [Stroke(linewidth=3, foreground=_OWN_SCALE), Normal()]
            look: dict[str, Any] = {"transform": axes.transAxes, "path_effects": halo}
            axes.text(0.98, 0.97, words, ha="right", va="top", **look)
        axes.set_ylim(low, high)
        axes.tick_params(labelleft=(low, high) != left)
        left = low, high


def _limits(shown: Sequence[FloatArray], noisy: Sequence[FloatArray] = ()) -> AxisLimits:
    """Return the limits of an axis, which include zero.

    Args:
        shown: arrays of values, all of which are within the limits.
        noisy: arrays of values; those from the 1st to the 99th percentile are within the limits.
    """
    values = [np.zeros(1), *(rows[np.isfinite(rows)] for rows in shown)]
    for rows in noisy:
        known = rows[np.isfinite(rows)]
        if known.size:
            values.append(np.percentile(known, (1.0, 99.0)))
    everything = np.concatenate(values)
    low, high = float(np.min(everything)), float(np.max(everything))
    margin = 0.08 * (high - low) or 1.0
    return low - margin, high + margin


def _add_legends(panels: Sequence[Axes], wheels: Sequence[str]) -> None:
    """Draw the legend of each row next to its last panel."""
    pedal = Line2D([], [], color=style.BLACK, linestyle=":", linewidth=1.2, label="pedal down")
    odometry = Line2D([], [], label="odometry", **_ODOMETRY)
    v_x, v_y, yaw_rate = (Line2D([], [], **look) for look in _TRUTH)
    rows: tuple[list[Line2D | Patch], ...] = (
        [v_x, v_y, odometry, pedal],
        [yaw_rate, odometry],
        [Line2D([], [], **_wheel_line(name, wheels)) for name in wheels],
        [Patch(facecolor=style.GRAY, label="brake on")],
    )
    for axes, handles in zip(panels, rows, strict=True):
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.3)


def _wheel_line(name: str, wheels: Sequence[str]) -> dict[str, Any]:
    """Return the style of a wheel's line; dashes distinguish lines with similar gray levels."""
    dashes = ("-", "-", (0, (4, 1)), (0, (4, 1)), (0, (1, 1)), (0, (1, 1)))
    row, label = wheels.index(name), name.replace("_", " ")
    look = {"color": style.wheel_color(row), "linestyle": dashes[row % len(dashes)]}
    return {"label": label, "linewidth": 1.5, **look}
