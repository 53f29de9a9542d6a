"""Velocities and errors over time while braking, like Figures 31 and 32.

One column per variant: linear velocity in the body frame, yaw rate, the sliding-manifold values s_i
by wheel, and the times at which each brake was on. Time counts from the start of braking. All
panels of a row have the same scale, except a panel that would show only a flat line; the scale of
this panel is labeled. Solid lines show the truth, thin dashed lines the measurement of the
odometry.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from omni_figures import style
from omni_loop.history import RunHistory
from omni_platform.quantities import FloatArray

_ROWS = (2.4, 1.7, 2.4)  # heights of velocity, yaw rate, errors [inch]
_V_X, _V_Y, _YAW_RATE = style.BLUE, style.ORANGE, style.GREEN
_ODOMETRY: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": (0, (4, 3))}
_OWN_SCALE = "#FFF7DC"  # background of a panel with its own scale

Limits = tuple[float, float]


def time_series(
    histories: Mapping[str, RunHistory], *, title: str = "", before: float = 0.3
) -> Figure:
    """Draw velocities, errors and brake enables of every variant over time.

    Args:
        histories: runs by variant, in the order of the columns.
        title: title above the columns.
        before: time that is shown before the start of braking [s].

    Raises:
        ValueError: there is no history.
    """
    if not histories:
        raise ValueError("time series need at least one history")
    wheels = list(dict.fromkeys(name for h in histories.values() for name in h.wheel_names))
    runs = list(histories.values())
    scales = _choose_scales(runs, before)
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
    _set_scales(columns, runs, scales, before)
    _add_legends(columns[-1], wheels)
    return figure


def _draw_twist(panels: Sequence[Axes], history: RunHistory) -> None:
    for row, component, color in ((0, 0, _V_X), (0, 1, _V_Y), (1, 2, _YAW_RATE)):
        axes = panels[row]
        axes.axhline(0.0, color=style.GRAY, linewidth=0.8)
        axes.plot(history.braking_time, history.twist[:, component], color=color, linewidth=2.2)
        axes.plot(history.braking_time, history.estimate[:, component], **_ODOMETRY)


def while_braking(history: RunHistory, values: FloatArray) -> FloatArray:
    """Return values with NaN before the start of braking."""
    shown = values.copy()
    shown[: history.brake_start] = np.nan
    return shown


def _draw_errors(axes: Axes, history: RunHistory, wheels: Sequence[str]) -> None:
    axes.axhline(0.0, color=style.GRAY, linewidth=0.8)
    error = while_braking(history, history.error)
    for column, name in enumerate(history.wheel_names):
        axes.plot(history.braking_time, error[:, column], **_wheel_line(wheels.index(name)))


def _draw_brakes(axes: Axes, history: RunHistory, wheels: Sequence[str]) -> None:
    """Draw one strip per wheel; its height is the share of the brake pressure."""
    axes.grid(False, axis="y")
    axes.set_yticks(range(len(wheels)), [name.replace("_", " ") for name in wheels])
    axes.set_ylim(len(wheels) - 0.4, -0.6)  # the first wheel on top
    time = history.braking_time
    edges = np.append(time, time[-1])  # each enable applies until the next stamp
    pressed = history.pedal > 0.0
    for column, name in enumerate(history.wheel_names):
        row = wheels.index(name)
        # Without an enable the brake is on, as on a vehicle.
        share = np.where(pressed, np.nan_to_num(history.enable[:, column], nan=1.0), 0.0)
        share = np.append(share, share[-1])
        drawn = (share > 0.0) | (np.append(0.0, share[:-1]) > 0.0)  # up to the end of the period
        top = row + 0.35 - 0.7 * share
        look: dict[str, Any] = {"color": style.wheel_color(row), "linewidth": 0.0}
        axes.fill_between(edges, row + 0.35, top, where=drawn, step="post", **look)


def _choose_scales(histories: Sequence[RunHistory], before: float) -> list[list[Limits]]:
    """Return the limits of the rows velocity, yaw rate and error, for each history."""
    shown = [h.braking_time >= -before for h in histories]
    pairs = list(zip(histories, shown, strict=True))
    return [
        _row_scales([h.twist[i, :2] for h, i in pairs], [h.estimate[i, :2] for h, i in pairs]),
        _row_scales([h.twist[i, 2] for h, i in pairs], [h.estimate[i, 2] for h, i in pairs]),
        _row_scales([while_braking(h, h.error)[i] for h, i in pairs], []),
    ]


def _row_scales(
    shown: Sequence[FloatArray],
    noisy: Sequence[FloatArray],
    share: float = 0.125,
    least: float = 1e-3,
) -> list[Limits]:
    """Return a common scale, and separate scales for panels that it would make unreadable.

    Args:
        shown: values of each panel.
        noisy: values of each panel whose outliers may be cut off.
        share: share of the common scale below which a panel gets its own scale [1].
        least: range of values below which a panel keeps the common scale [m/s] or [rad/s].
    """
    common = _limits(shown, noisy)
    scales = []
    for place, values in enumerate(shown):
        known = np.append(values[np.isfinite(values)], 0.0)
        hidden = least < np.ptp(known) < share * (common[1] - common[0])
        low, high = _limits([values], noisy[place : place + 1]) if hidden else common
        # Room for the label of the separate scale.
        scales.append((low, high + (0.15 * (high - low) if hidden else 0.0)))
    return scales


def _set_scales(
    columns: Sequence[Sequence[Axes]],
    histories: Sequence[RunHistory],
    scales: Sequence[Sequence[Limits]],
    before: float,
) -> None:
    """Set the limits, and label scales that differ from that of the panel to the left."""
    first = max(-before, min(float(h.braking_time[0]) for h in histories))
    last = max(float(h.braking_time[-1]) for h in histories)
    for place, panels in enumerate(columns):
        for axes in panels:
            axes.set_xlim(first, max(last, first + 1e-3))
        for axes, row in zip(panels, scales, strict=False):
            axes.set_ylim(row[place])
            axes.tick_params(labelleft=place == 0 or row[place] != row[place - 1])
            finer = max(high - low for low, high in row) / (row[place][1] - row[place][0])
            if finer > 1.0:
                axes.set_facecolor(_OWN_SCALE)
                words = rf"own scale, {finer:.0f}$\times$ finer"
                halo = [Stroke(linewidth=3, foreground=_OWN_SCALE), Normal()]
                look: dict[str, Any] = {"transform": axes.transAxes, "path_effects": halo}
                axes.text(0.98, 0.97, words, ha="right", va="top", **look)


def _limits(shown: Sequence[FloatArray], noisy: Sequence[FloatArray] = ()) -> Limits:
    """Return limits that show zero, all of `shown` and all but the outliers of `noisy`."""
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
    by_wheel = [
        Line2D([], [], label=name.replace("_", " "), **_wheel_line(row))
        for row, name in enumerate(wheels)
    ]
    rows: tuple[list[Line2D | Patch], ...] = (
        [_truth(_V_X, "$v_x$"), _truth(_V_Y, "$v_y$"), odometry, pedal],
        [_truth(_YAW_RATE, "yaw rate"), odometry],
        [*by_wheel],
        [Patch(facecolor=style.GRAY, label="brake on")],
    )
    for axes, handles in zip(panels, rows, strict=True):
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.3)


def _wheel_line(row: int) -> dict[str, Any]:
    """Return the style of a wheel's line; dashes distinguish lines with similar gray levels."""
    dashes = ("-", "-", (0, (4, 1)), (0, (4, 1)), (0, (1, 1)), (0, (1, 1)))
    color = style.wheel_color(row)
    return {"color": color, "linewidth": 1.5, "linestyle": dashes[row % len(dashes)]}


def _truth(color: str, label: str) -> Line2D:
    return Line2D([], [], color=color, linewidth=2.2, label=label)
