"""Figures of the trade-off of rotation and distance, and of the effect of slow valves."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from omni_figures import style
from omni_studies.tuning.trials import BrakeLag, Trial, distance_at, front

_MARKERS = "osD^vP"
_CHOSEN: dict[str, Any] = {
    "color": style.VERMILLION, "marker": "o", "markerfacecolor": "none", "linestyle": "",
    "markeredgewidth": 2.0, "zorder": 6,
}  # fmt: skip
_FRONT: dict[str, Any] = {"color": style.PALE, "linewidth": 7.0}


def trade_off(
    trials: Sequence[Trial],
    unassisted: Sequence[Trial],
    choice: Trial | None,
    limits: tuple[float | None, float | None],
    title: str,
    label: tuple[float, float] = (0.13, 0.04),
) -> Figure:
    """Draw worst rotation against worst distance, one panel per lag of the brakes.

    Args:
        trials: trials of all settings and lags.
        unassisted: without the assistant, one per lag, in the order of the panels.
        choice: the recommended trial, if any.
        limits: of the rotation [deg] and of the distance [m], if any.
        title: title of the figure.
        label: width and height of the label of a point, as shares of the axes [1].
    """
    panels = len(unassisted)
    size = (1.2 + 4.4 * panels, 5.6)
    x = "stopping distance [m]"
    figure, (all_axes,) = style.panels(
        title, 1, panels, size=size, x=x, y="orientation change [deg]", sharex=True, sharey=True
    )
    dwells = sorted({trial.setting.dwell_time for trial in trials})
    finite = [trial for trial in (*trials, *unassisted) if math.isfinite(trial.worst_distance)]
    width = np.ptp([trial.worst_distance for trial in finite]) if finite else 0.0
    height = max((trial.worst_rotation for trial in finite), default=0.0)

    def near(one: Trial, other: Trial) -> bool:
        across = abs(one.worst_distance - other.worst_distance)
        along = abs(one.worst_rotation - other.worst_rotation)
        return bool(across < label[0] * width and along < label[1] * height)

    for axes, without in zip(all_axes, unassisted, strict=True):
        here = [trial for trial in trials if trial.lag == without.lag]
        _panel(axes, here, dwells, near)
        axes.plot([without.worst_distance], [without.worst_rotation], "X", color=style.BLACK, ms=9)
        for limit, draw in zip(limits, (axes.axhline, axes.axvline), strict=True):
            if limit is not None:
                draw(limit, color=style.VERMILLION, linestyle="--", linewidth=1.2)
        if choice is not None and choice.lag == without.lag:
            axes.plot([choice.worst_distance], [choice.worst_rotation], ms=17, **_CHOSEN)
        axes.set_title(_words(without.lag))
    all_axes[0].set_ylim(bottom=0.0)
    handles = _legend(dwells, choice is not None, limits != (None, None))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 9))
    return figure


def _legend(dwells: Sequence[float], recommended: bool, limited: bool) -> list[Line2D]:
    handles = [
        Line2D([], [], label=words, **_look(dwells, dwell))
        for dwell, words in ((d, f"dwell {1e3 * d:g} ms" if d else "no dwell") for d in dwells)
    ]
    handles += [
        Line2D([], [], label="best settings", **_FRONT),
        Line2D([], [], color=style.BLACK, marker="X", ms=9, linestyle="", label="unassisted"),
    ]
    if recommended:
        handles.append(Line2D([], [], ms=12, label="recommended", **_CHOSEN))
    if limited:
        handles.append(Line2D([], [], color=style.VERMILLION, linestyle="--", label="limit"))
    return handles


def _panel(
    axes: Axes,
    trials: Sequence[Trial],
    dwells: Sequence[float],
    near: Callable[[Trial, Trial], bool],
) -> None:
    """Draw the settings with one lag: a line over the weightings for each dwell time.

    `near` collects labels that would overlap.
    """
    best = front(trials)
    axes.plot(*_places(best), solid_capstyle="round", zorder=1, **_FRONT)
    thin: dict[str, Any] = {"ms": 4.5, "linewidth": 1.0, "zorder": 3}
    for dwell in dwells:
        line = [trial for trial in trials if trial.setting.dwell_time == dwell]
        axes.plot(*_places(line), **_look(dwells, dwell), **thin)
    axes.margins(x=0.15)  # the labels stand beside their points
    labeled: list[Trial] = []
    for trial in reversed([t for t in trials if t.setting.dwell_time == dwells[0]]):
        if not math.isfinite(trial.worst_distance) or (labeled and near(labeled[-1], trial)):
            continue
        labeled.append(trial)
        last = trial is labeled[0]  # at the right end of the line
        offset, side = ((8, -7), "left") if last else ((-7, -4), "right")
        place = trial.worst_distance, trial.worst_rotation
        style.note(axes, _weighting(trial), place, offset, ha=side, va="center")


class Cost(NamedTuple):
    """Effect of the lag of the brakes and of the dwell time.

    Attributes:
        lag: lag of the brakes.
        dwell_time: [s].
        rotation: smallest rotation of all settings [deg].
        distance: distance at half the unassisted rotation [m], NaN if no setting halves it.
    """

    lag: BrakeLag
    dwell_time: float
    rotation: float
    distance: float

    @classmethod
    def of(cls, lag: BrakeLag, dwell_time: float, trials: Sequence[Trial], half: float) -> Cost:
        """Return the cost from all trials; `half` is half the unassisted rotation [deg]."""
        tried = [t for t in trials if (t.lag, t.setting.dwell_time) == (lag, dwell_time)]
        rotation = min(trial.worst_rotation for trial in tried)
        return cls(lag, dwell_time, rotation, distance_at(tried, half))


def draw_costs(costs: Sequence[Cost]) -> Figure:
    """Draw the effect of dwell time and lag of the brakes."""
    figure, (panels,) = style.panels(
        "What slow valves cost", 1, 2, size=(9.6, 4.2), x="minimum dwell time [ms]"
    )
    for index, lag in enumerate(dict.fromkeys(cost.lag for cost in costs)):
        _, dwells, *columns = zip(*(cost for cost in costs if cost.lag == lag), strict=True)
        look = {"marker": _MARKERS[index % len(_MARKERS)], "color": style.wheel_color(index)}
        for axes, values in zip(panels, columns, strict=True):
            axes.plot([1e3 * dwell for dwell in dwells], values, label=_words(lag), **look)
    panels[0].set_ylabel("smallest orientation change [deg]")
    panels[1].set_ylabel("stopping distance at half of the\nunassisted orientation change [m]")
    panels[0].set_ylim(bottom=0.0)
    panels[0].legend()
    return figure


def _words(lag: BrakeLag) -> str:
    if lag == BrakeLag():
        return "brakes that follow at once"
    return f"dead time {1e3 * lag.dead_time:g} ms, time constant {1e3 * lag.time_constant:g} ms"


def _weighting(trial: Trial) -> str:
    setting = trial.setting
    symbols = {"zero": r"$\psi = 0$", "cosine": r"$\cos\delta$"}
    return symbols.get(setting.weighting, f"k = {setting.k}")


def _places(trials: Sequence[Trial]) -> tuple[list[float], list[float]]:
    return [t.worst_distance for t in trials], [t.worst_rotation for t in trials]


def _look(dwells: Sequence[float], dwell: float) -> dict[str, Any]:
    """Return color and marker of a dwell time."""
    place = dwells.index(dwell)
    shade = matplotlib.colormaps["viridis"](0.9 * place / max(len(dwells) - 1, 1))
    return {"color": to_hex(shade), "marker": _MARKERS[place % len(_MARKERS)]}
