"""Trade-off of rotation and distance: recommended settings of the brake assistant for a vehicle.

Every weighting and k is run with every dwell time, with the brakes of the vehicle and with slower
ones, and evaluated by the worst of several situations (`omni_studies.tuning.trials`).
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omni_loop.metrics import Metric
from omni_loop.options import LoopOptions
from omni_platform import command_options, configuration
from omni_studies.study import StudyResult, StudyRun
from omni_studies.tuning import figures, trials
from omni_studies.tuning.trials import OFF, BrakeLag, Setting, Trial
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
        figures.Cost.of(lag, dwell, tried, unassisted[0].worst_rotation / 2.0)
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
    study.figure("trade_off.png", figures.trade_off(tried, unassisted, choice, limits, title))
    study.figure("cost.png", figures.draw_costs(costs))
    return study.result(metrics, *findings)


def _settings(ks: Sequence[int], dwells: Sequence[float]) -> tuple[Setting, ...]:
    """Return all settings, for each dwell time from the shortest stop to the smallest rotation."""
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


def _cost_table(costs: Sequence[figures.Cost]) -> Table:
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
