"""Trade-off between rotation and stopping distance, and recommended settings for a vehicle.

Each combination of weighting, k and dwell time is run with the dead time and the time constant of
the vehicle's own brakes, and with those of other brakes (option `brakes`). A combination is
evaluated by the worst result in several situations (`omni_studies.tuning.trials`).
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_core.commands.command_options import option
from omni_core.configuration import ConfigurationError, parameter
from omni_runs.experiment import WITHOUT_CAMERAS, short_name
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_runs.options import LoopOptions
from omni_studies.study import StudyResult, StudyRun
from omni_studies.tuning import trials
from omni_studies.tuning.trials import OFF, BrakeLag, Setting, TuningTrial, distance_at, front
from omni_tools.campaign.runner import CampaignOptions

_QUANTITIES = (
    ("orientation_change", "worst_rotation", "deg"),
    ("stopping_distance", "worst_distance", "m"),
)


class Options(CampaignOptions, LoopOptions):
    """Options of the study ``tuning``: settings to try, and limits for the recommendation."""

    vehicle: str | None = parameter(None)
    """a file of config/vehicles/, or a path that ends in .yaml (default: the experiment's)"""
    experiment: str = parameter("turn_while_translate")
    """experiment whose maneuver and ground are used"""
    max_rotation: float | None = option(None, metavar="DEG", above=0.0, maximum=360.0)
    """recommend the setting with the shortest stop among those with at most this rotation"""
    max_distance: float | None = option(None, metavar="M", above=0.0, maximum=1.0e4)
    """recommend the setting with the smallest rotation among those that stop within this
    distance"""
    k: tuple[int, ...] = option((1, 3, 5, 7, 11, 31), metavar="K", minimum=1, maximum=999)
    """values to try for the tuning constant k of the weighting `enhanced`"""
    dwell: tuple[float, ...] = option(
        (0.0, 0.02, 0.05, 0.1, 0.2), metavar="S", minimum=0.0, maximum=1.0
    )
    """values to try for the minimum dwell time of the valves"""
    brakes: tuple[str, ...] = option(("0.005:0.01", "0.02:0.05"), metavar="DEAD:LAG")
    """dead time and time constant [s] of other brakes for comparison"""
    situations: int = parameter(8, minimum=1, maximum=10_000)
    """number of slightly different maneuvers in which a setting is evaluated"""
    seed: int = parameter(1, minimum=0)
    """seed of the situations"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Try every setting, and recommend one within the limits."""
    overrides = [f"vehicle={options.vehicle}"] if options.vehicle else []
    overrides += [*WITHOUT_CAMERAS, *options.changes]
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
    named = {f"{t.setting.label}_dwell_{1e3 * t.setting.dwell_time:g}_ms": t for t in best}
    metrics = {
        f"{quantity}.{case}": Metric(getattr(trial, worst), unit)
        for quantity, worst, unit in _QUANTITIES
        for case, trial in {"unassisted": unassisted[0], **named}.items()
    }
    limits = options.max_rotation, options.max_distance
    choice: TuningTrial | None = None
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
    vehicle = f", {short_name(options.vehicle)}" if options.vehicle else ""
    title = f"{base.description}{vehicle}: worst of {len(bases)} situations"
    study.table("settings.csv", *_settings_table(every, best), digits=6)
    study.figure("trade_off.png", trade_off(tried, unassisted, choice, limits, title))
    study.plot("cost", draw_costs(costs))
    return study.result(metrics, *findings)


def _settings(ks: Sequence[int], dwells: Sequence[float]) -> tuple[Setting, ...]:
    """Return all settings, sorted by dwell time.

    For each dwell time, the order is from the shortest stops to the smallest rotations.
    """
    laws = (("cosine", 7), *(("enhanced", k) for k in sorted(set(ks))), ("zero", 7))
    return tuple(Setting(*law, dwell) for dwell in sorted(set(dwells)) for law in laws)


def _settings_table(
    trials: Sequence[TuningTrial], best: Sequence[TuningTrial]
) -> tuple[Sequence[str], list[tuple[Any, ...]]]:
    """Return header and rows of the table of settings."""
    header = (
        "dead time [s]", "time constant [s]", "weighting", "dwell time [s]",
        "orientation change, worst [deg]", "stopping distance, worst [m]",
        "orientation change, undisturbed [deg]", "stopping distance, undisturbed [m]",
        "brake switchings, mean", "best of the vehicle's brakes",
    )  # fmt: skip
    chosen = {id(trial) for trial in best}
    return header, [
        (
            *dataclasses.astuple(trial.lag), trial.setting.label, trial.setting.dwell_time,
            trial.worst_rotation, trial.worst_distance, trial.rotation[0], trial.distance[0],
            np.mean(trial.switchings), int(id(trial) in chosen),
        )
        for trial in trials
    ]  # fmt: skip


def _lag(text: str) -> BrakeLag:
    try:
        dead_time, time_constant = map(float, text.split(":"))
    except ValueError:
        problem = f"{text!r} must have the form DEAD:LAG, such as 0.02:0.05"
        raise ConfigurationError("--brakes", problem) from None
    return BrakeLag(dead_time, time_constant)


_MARKERS = "osD^vP"
_LABEL_SIZE = 0.05  # height of a label as a share of the range of the points in a panel
_CHOSEN: dict[str, Any] = {
    "color": style.VERMILLION, "marker": "o", "markerfacecolor": "none", "linestyle": "",
    "markeredgewidth": 2.0, "zorder": 6,
}  # fmt: skip


def trade_off(
    trials: Sequence[TuningTrial],
    unassisted: Sequence[TuningTrial],
    choice: TuningTrial | None,
    limits: tuple[float | None, float | None],
    title: str,
) -> Figure:
    """Draw the worst rotation versus the worst distance, one panel per brake lag.

    Args:
        trials: trials of all settings and brake lags.
        unassisted: trials without the assistant, one per lag, in the order of the panels.
        choice: recommended trial; None if there is none.
        limits: limits on rotation [deg] and distance [m]; None for no limit.
        title: title of the figure.
    """
    size, x = (1.2 + 4.4 * len(unassisted), 5.6), "stopping distance [m]"
    y = "orientation change [deg]"
    figure, (panels,) = style.panels(
        title, 1, len(unassisted), size=size, x=x, y=y, sharex=True, sharey=True
    )
    for axes, without in zip(panels, unassisted, strict=True):
        _draw_settings(axes, [trial for trial in trials if trial.lag == without.lag])
        axes.plot(*_places([without]), "X", color=style.BLACK, ms=9, label="unassisted")
        for limit, draw in zip(limits, (axes.axhline, axes.axvline), strict=True):
            if limit is not None:
                draw(limit, color=style.VERMILLION, linestyle="--", linewidth=1.2, label="limit")
        if choice is not None and choice.lag == without.lag:
            axes.plot(*_places([choice]), ms=17, label="recommended", **_CHOSEN)
        axes.set_title(_words(without.lag))
    panels[0].set_ylim(bottom=0.0)
    style.legend_below(figure, 9)
    return figure


def _draw_settings(axes: Axes, trials: Sequence[TuningTrial]) -> None:
    """Draw the results of all settings for one brake lag.

    A line connects the results with the same dwell time; the wide line marks the best settings.
    """
    best = front(trials)
    look: dict[str, Any] = {"color": style.PALE, "linewidth": 7.0, "zorder": 1}
    axes.plot(*_places(best), solid_capstyle="round", label="best settings", **look)
    dwells = sorted({trial.setting.dwell_time for trial in trials})
    colors = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.9, len(dwells)))
    for dwell, color, marker in zip(dwells, colors, itertools.cycle(_MARKERS), strict=False):
        line = [trial for trial in trials if trial.setting.dwell_time == dwell]
        look = {"ms": 4.5, "linewidth": 1.0, "zorder": 3, "color": color, "marker": marker}
        words = f"dwell {1e3 * dwell:g} ms" if dwell else "no dwell"
        axes.plot(*_places(line), label=words, **look)
    axes.margins(x=0.15)  # room for labels next to their points
    stopped = [place for place in map(_place, trials) if np.isfinite(place).all()]
    for words, place in _labels(best, np.ptp(stopped, axis=0) if stopped else (0.0, 0.0)):
        style.note(axes, words, place, (-3, -5), ha="right", va="top", rotation=45)


def _labels(
    best: Sequence[TuningTrial], spans: Sequence[float]
) -> list[tuple[str, tuple[float, float]]]:
    """Return the label of each weighting and its place; labels of near points are joined.

    Args:
        best: trials with the best settings, sorted along their curve.
        spans: ranges of distance [m] and rotation [deg] that the points of a panel cover.
    """
    labels: list[tuple[str, tuple[float, float]]] = []
    for words, trial in {_weighting(trial): trial for trial in reversed(best)}.items():
        place = _place(trial)
        near = [
            index
            for index, (_, other) in enumerate(labels)
            if all(
                abs(one - two) <= _LABEL_SIZE * span
                for one, two, span in zip(place, other, spans, strict=True)
            )
        ]
        if near:
            before, other = labels[near[0]]
            labels[near[0]] = f"{words}, {before}", other
        else:
            labels.append((words, place))
    return labels


class Cost(NamedTuple):
    """Best results that settings reach with one brake lag and one dwell time.

    Attributes:
        lag: lag of the brakes.
        dwell_time: minimum dwell time of the valves [s].
        rotation: smallest worst-case rotation of all settings [deg].
        distance: stopping distance at half the worst rotation of the unassisted stops [m]; NaN if
            no setting halves this rotation.
    """

    lag: BrakeLag
    dwell_time: float
    rotation: float
    distance: float

    @classmethod
    def of(
        cls, lag: BrakeLag, dwell_time: float, trials: Sequence[TuningTrial], half: float
    ) -> Cost:
        """Return the best results with one brake lag and one dwell time.

        Args:
            lag: lag of the brakes.
            dwell_time: minimum dwell time of the valves [s].
            trials: all trials, of which those with this lag and this dwell time are used.
            half: half the worst rotation of the unassisted stops [deg].
        """
        tried = [t for t in trials if (t.lag, t.setting.dwell_time) == (lag, dwell_time)]
        rotation = min(trial.worst_rotation for trial in tried)
        return cls(lag, dwell_time, rotation, distance_at(tried, half))


def draw_costs(costs: Sequence[Cost]) -> Figure:
    """Draw the best results versus the dwell time, for each brake lag."""
    figure, (panels,) = style.panels(
        "Effect of slow valves", 1, 2, size=(9.6, 4.2), x="minimum dwell time [ms]"
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
        return "brakes without lag"
    return f"dead time {1e3 * lag.dead_time:g} ms, time constant {1e3 * lag.time_constant:g} ms"


def _weighting(trial: TuningTrial) -> str:
    setting = trial.setting
    symbols = {"zero": r"$\psi = 0$", "cosine": r"$\cos\delta$"}
    return symbols.get(setting.weighting, f"k = {setting.k}")


def _place(trial: TuningTrial) -> tuple[float, float]:
    return trial.worst_distance, trial.worst_rotation


def _places(trials: Sequence[TuningTrial]) -> tuple[list[float], list[float]]:
    return [t.worst_distance for t in trials], [t.worst_rotation for t in trials]
