"""Trade-off of rotation and distance: recommended settings of the brake assistant for a vehicle.

Every weighting and k is run with every dwell time, with the brakes of the vehicle and with slower
brakes, and evaluated by the worst of several situations (`omni_studies.tuning.trials`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from omni_figures import style
from omni_loop.metrics import Metric
from omni_loop.options import LoopOptions
from omni_platform import command_options, configuration
from omni_studies.study import StudyResult, StudyRun
from omni_studies.tuning import trials
from omni_studies.tuning.trials import OFF, BrakeLag, Setting, Trial, distance_at, front
from omni_tools.campaign.runner import CampaignOptions

_QUANTITIES = (
    ("orientation_change", "worst_rotation", "deg"),
    ("stopping_distance", "worst_distance", "m"),
)


class Options(CampaignOptions, LoopOptions):
    """Settings to try, and limits of the recommendation."""

    vehicle: str | None = configuration.parameter(None)
    """a file of config/vehicles/, or a path that ends in .yaml (default: the experiment's)"""
    experiment: str = configuration.parameter("turn_while_translate")
    """experiment whose maneuver and ground are used"""
    max_rotation: float | None = command_options.option(None, metavar="DEG", above=0.0)
    """recommend the setting that stops shortest and rotates by at most this angle"""
    max_distance: float | None = command_options.option(None, metavar="M", above=0.0)
    """recommend the setting that rotates least and stops within this distance"""
    k: tuple[int, ...] = command_options.option((1, 3, 5, 7, 11, 31), metavar="K")
    """tuning constant of the enhanced weighting to try"""
    dwell: tuple[float, ...] = command_options.option(
        (0.0, 0.02, 0.05, 0.1, 0.2), metavar="S", minimum=0.0
    )
    """minimum dwell time of the valves to try"""
    brakes: tuple[str, ...] = command_options.option(
        ("0.005:0.01", "0.02:0.05"), metavar="DEAD:LAG"
    )
    """dead time and time constant [s] of other brakes to compare"""
    situations: int = configuration.parameter(8, minimum=1)
    """number of slightly different maneuvers by which a setting is judged"""
    seed: int = configuration.parameter(1, minimum=0)
    """seed of the situations"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Try every setting, and recommend one within the limits."""
    overrides = [f"vehicle={options.vehicle}"] if options.vehicle else []
    overrides += ["feedback=velocity_sensor", "simulation.render_lines=false", *options.changes]
    variant = study.experiments.variants(options.experiment)[0]
    base = study.experiments.load(options.experiment, variant, overrides)
    brake = base.vehicle.brake
    own = BrakeLag(brake.dead_time, brake.time_constant)
    lags = tuple(dict.fromkeys((own, *map(_lag, options.brakes))))
    bases = trials.situations(base, options.situations, options.seed)
    work = trials.Trials(bases, (OFF, *_settings(options.k, options.dwell)), lags)
    rows = study.campaign(
        work.run, range(work.count), trials.Numbers, options, work.fingerprint, "trials.csv"
    )
    if len(rows) < work.count:
        words = f"{len(rows)} of {work.count} runs are done; combine the parts with --merge"
        return study.result({"runs.all": Metric(len(rows), "1")}, words)
    every = work.collected(rows)
    unassisted = [trial for trial in every if trial.setting == OFF]
    tried = [trial for trial in every if trial.setting != OFF]
    mine = [trial for trial in tried if trial.lag == own]
    best = trials.front(mine)
    metrics = {
        f"{quantity}.{case}": Metric(getattr(trial, worst), unit)
        for quantity, worst, unit in _QUANTITIES
        for case, trial in (
            ("unassisted", unassisted[0]),
            *((f"{t.setting.label}_dwell_{1e3 * t.setting.dwell_time:g}_ms", t) for t in best),
        )
    }
    limits = options.max_rotation, options.max_distance
    choice: Trial | None = None
    findings = []
    if any(limit is not None for limit in limits):
        choice, sentence = trials.recommended(mine, *limits)
        findings.append(sentence)
        for (quantity, worst, unit), limit in zip(_QUANTITIES, limits, strict=True):
            value = getattr(choice, worst) if choice else math.nan
            recommended = Metric(value, unit, at_most=limit, note=sentence)
            metrics[f"{quantity}.recommended"] = recommended
    costs = [
        Cost.of(lag, dwell, tried, unassisted[0].worst_rotation / 2.0)
        for lag, dwell in dict.fromkeys((one.lag, one.setting.dwell_time) for one in tried)
    ]
    for cost in costs:
        case = f"{cost.lag.label}_dwell_{1e3 * cost.dwell_time:g}_ms"
        metrics[f"smallest_rotation.{case}"] = Metric(cost.rotation, "deg")
        metrics[f"distance_at_half_rotation.{case}"] = Metric(cost.distance, "m")
    vehicle = f", {Path(options.vehicle).stem}" if options.vehicle else ""
    title = f"{base.description}{vehicle}: worst of {len(bases)} situations"
    study.table("settings.csv", *_settings_table(every, best), digits=6)
    study.table("cost.csv", *_cost_table(costs), digits=6)
    study.figure("trade_off.png", trade_off(tried, unassisted, choice, limits, title))
    study.figure("cost.png", draw_costs(costs))
    return study.result(metrics, *findings)


def _settings(ks: Sequence[int], dwells: Sequence[float]) -> tuple[Setting, ...]:
    """Return all settings by dwell time, from the shortest stop to the smallest rotation."""
    return tuple(
        Setting(weighting, k, dwell)
        for dwell in sorted(set(dwells))
        for weighting, k in (
            ("cosine", 7),
            *(("enhanced", k) for k in sorted(set(ks))),
            ("zero", 7),
        )
    )


Table = tuple[Sequence[str], list[tuple[Any, ...]]]
"""Header and rows of a table."""


def _cost_table(costs: Sequence[Cost]) -> Table:
    header = (
        "dead time [s]", "time constant [s]", "dwell time [s]",
        "smallest orientation change [deg]", "distance at half of the unassisted [m]",
    )  # fmt: skip
    return header, [(one.lag.dead_time, one.lag.time_constant, *one[1:]) for one in costs]


def _settings_table(trials: Sequence[Trial], best: Sequence[Trial]) -> Table:
    header = (
        "dead time [s]", "time constant [s]", "weighting", "dwell time [s]",
        "orientation change, worst [deg]", "stopping distance, worst [m]",
        "orientation change, undisturbed [deg]", "stopping distance, undisturbed [m]",
        "brake switchings, mean", "best of the vehicle's brakes",
    )  # fmt: skip
    chosen = {id(trial) for trial in best}
    return header, [
        (
            trial.lag.dead_time, trial.lag.time_constant,
            trial.setting.label, trial.setting.dwell_time,
            trial.worst_rotation, trial.worst_distance,
            trial.rotation[0], trial.distance[0],
            np.mean(trial.switchings), int(id(trial) in chosen),
        )
        for trial in trials
    ]  # fmt: skip


def _lag(text: str) -> BrakeLag:
    try:
        dead_time, time_constant = map(float, text.split(":"))
    except ValueError:
        problem = f"{text!r} must have the form DEAD:LAG, such as 0.02:0.05"
        raise configuration.ConfigurationError("--brakes", problem) from None
    return BrakeLag(dead_time, time_constant)


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
        unassisted: trials without the assistant, one per lag, in the order of the panels.
        choice: the recommended trial, if any.
        limits: limits of the rotation [deg] and of the distance [m], if any.
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

    `near` returns whether the labels of two trials would overlap.
    """
    best = front(trials)
    axes.plot(*_places(best), solid_capstyle="round", zorder=1, **_FRONT)
    thin: dict[str, Any] = {"ms": 4.5, "linewidth": 1.0, "zorder": 3}
    for dwell in dwells:
        line = [trial for trial in trials if trial.setting.dwell_time == dwell]
        axes.plot(*_places(line), **_look(dwells, dwell), **thin)
    axes.margins(x=0.15)  # room for labels next to their points
    labeled: list[Trial] = []
    for trial in reversed([t for t in trials if t.setting.dwell_time == dwells[0]]):
        if not math.isfinite(trial.worst_distance) or (labeled and near(labeled[-1], trial)):
            continue
        labeled.append(trial)
        last = trial is labeled[0]  # right end of the line
        offset, side = ((8, -7), "left") if last else ((-7, -4), "right")
        place = trial.worst_distance, trial.worst_rotation
        style.note(axes, _weighting(trial), place, offset, ha=side, va="center")


class Cost(NamedTuple):
    """Effect of the lag of the brakes and of the dwell time.

    Attributes:
        lag: lag of the brakes.
        dwell_time: minimum dwell time of the valves [s].
        rotation: smallest rotation of all settings [deg].
        distance: distance at half the unassisted rotation [m], NaN if no setting halves it.
    """

    lag: BrakeLag
    dwell_time: float
    rotation: float
    distance: float

    @classmethod
    def of(cls, lag: BrakeLag, dwell_time: float, trials: Sequence[Trial], half: float) -> Cost:
        """Return the effect from all trials; `half` is half the unassisted rotation [deg]."""
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
