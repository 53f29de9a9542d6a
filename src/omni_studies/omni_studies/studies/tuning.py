"""Trade-off of rotation and distance: recommended settings of the brake assistant for a vehicle.

Every weighting and k is run with every dwell time, with the brakes of the vehicle and with slower
ones, and evaluated by the worst of several situations (`omni_studies.tuning.trials`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omni_loop.metrics import Metric
from omni_loop.options import LoopOptions
from omni_platform import command_options, configuration
from omni_studies.study import StudyResult, StudyRun
from omni_studies.tuning import figures as tuning_figures
from omni_studies.tuning.trials import (
    OFF,
    BrakeLag,
    Numbers,
    Setting,
    Trial,
    Trials,
    distance_at,
    front,
    recommended,
    situations,
)
from omni_tools.campaign.runner import CampaignOptions

Cost = tuple[BrakeLag, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Options(CampaignOptions, LoopOptions):
    """Settings to try, and limits of the recommendation."""

    vehicle: str | None = configuration.parameter(None)
    """a file of config/vehicles/, or a path that ends in .yaml (default: the experiment's)"""
    experiment: str = configuration.parameter("turn_while_translate")
    """whose maneuver and ground it brakes on"""
    max_rotation: float | None = command_options.option(None, metavar="DEG", above=0.0)
    """recommend the setting that stops shortest without turning further than this"""
    max_distance: float | None = command_options.option(None, metavar="M", above=0.0)
    """recommend the setting that turns least without needing more than this to stop"""
    k: tuple[int, ...] = command_options.option((1, 3, 5, 7, 11, 31), metavar="K")
    """tuning constant of the enhanced weighting to try"""
    dwell: tuple[float, ...] = command_options.option((0.0, 0.02, 0.05, 0.1, 0.2), metavar="S")
    """minimum dwell time of the valves to try"""
    brakes: tuple[str, ...] = command_options.option(
        ("0.005:0.01", "0.02:0.05"), metavar="DEAD:LAG"
    )
    """dead time and time constant [s] of other brakes to compare"""
    situations: int = configuration.parameter(8, minimum=1)
    """slightly different maneuvers that a setting is judged by"""
    seed: int = configuration.parameter(1, minimum=0)
    """of the situations"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Try every setting, and recommend one within the limits."""
    overrides = [f"vehicle={options.vehicle}"] if options.vehicle else []
    overrides += ["feedback=velocity_sensor", "simulation.render_lines=false", *options.changes]
    variant = study.experiments.variants(options.experiment)[0]
    base = study.experiments.load(options.experiment, variant, overrides)
    brake = base.vehicle.brake
    own = BrakeLag(brake.dead_time, brake.time_constant)
    lags = tuple(dict.fromkeys((own, *map(_lag, options.brakes))))
    settings = _settings(options.k, options.dwell)
    bases = situations(base, options.situations, options.seed)
    trials_of = Trials(bases, (OFF, *settings), lags)
    numbers = range(trials_of.count)
    rows = study.campaign(
        trials_of.run, numbers, Numbers, options, trials_of.fingerprint, "trials.csv"
    )
    if len(rows) < trials_of.count:
        words = f"{len(rows)} of {trials_of.count} runs are done; --merge puts all pieces together"
        return study.result({"runs.all": Metric(len(rows), "1")}, words)
    every = trials_of.collected(rows)
    unassisted = [trial for trial in every if trial.setting == OFF]
    trials = [trial for trial in every if trial.setting != OFF]
    mine = [trial for trial in trials if trial.lag == own]
    limits = options.max_rotation, options.max_distance
    choice: Trial | None = None
    findings = []
    metrics = _metrics(mine, unassisted[0])
    if any(limit is not None for limit in limits):
        choice, sentence = recommended(mine, *limits)
        findings.append(sentence)
        metrics |= _recommendation(choice, sentence, *limits)
    costs = _costs(trials, unassisted[0].worst_rotation / 2.0)
    for lag, dwell, rotation, distance in costs:
        case = f"{lag.label}_dwell_{1e3 * dwell:g}_ms"
        metrics[f"smallest_rotation.{case}"] = Metric(rotation, "deg")
        metrics[f"distance_at_half_rotation.{case}"] = Metric(distance, "m")
    vehicle = f", {Path(options.vehicle).stem}" if options.vehicle else ""
    title = f"{base.description}{vehicle}: worst of {len(bases)} situations"
    study.columns("settings.csv", _settings_table(every, front(mine)))
    study.columns("cost.csv", _cost_table(costs))
    trade_off = tuning_figures.trade_off(trials, unassisted, choice, *limits, title)
    study.figure("trade_off.png", trade_off)
    study.figure("cost.png", tuning_figures.cost(costs))
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


def _case(trial: Trial) -> str:
    return f"{trial.setting.label}_dwell_{1e3 * trial.setting.dwell_time:g}_ms"


def _metrics(trials: Sequence[Trial], unassisted: Trial) -> dict[str, Metric]:
    """Return the front with the vehicle's own brakes."""
    cases = {"unassisted": unassisted} | {_case(trial): trial for trial in front(trials)}
    rotation = {
        f"orientation_change.{case}": Metric(trial.worst_rotation, "deg")
        for case, trial in cases.items()
    }
    distance = {
        f"stopping_distance.{case}": Metric(trial.worst_distance, "m")
        for case, trial in cases.items()
    }
    return rotation | distance


def _recommendation(
    choice: Trial | None, sentence: str, max_rotation: float | None, max_distance: float | None
) -> dict[str, Metric]:
    rotation = choice.worst_rotation if choice else math.nan
    distance = choice.worst_distance if choice else math.nan
    return {
        "orientation_change.recommended": Metric(
            rotation, "deg", at_most=max_rotation, note=sentence
        ),
        "stopping_distance.recommended": Metric(distance, "m", at_most=max_distance, note=sentence),
    }


def _costs(trials: Sequence[Trial], half: float) -> list[Cost]:
    """Return the results for each lag and dwell time; see `tuning.figures`."""
    rows: list[Cost] = []
    for lag, dwell in dict.fromkeys((trial.lag, trial.setting.dwell_time) for trial in trials):
        tried = [t for t in trials if t.lag == lag and t.setting.dwell_time == dwell]
        rotation = min(trial.worst_rotation for trial in tried)
        rows.append((lag, dwell, rotation, distance_at(tried, half)))
    return rows


def _cost_table(costs: Sequence[Cost]) -> dict[str, list[float]]:
    return {
        "dead time [s]": [lag.dead_time for lag, *_ in costs],
        "time constant [s]": [lag.time_constant for lag, *_ in costs],
        "dwell time [s]": [dwell for _, dwell, _, _ in costs],
        "smallest orientation change [deg]": [rotation for _, _, rotation, _ in costs],
        "distance at half of the unassisted [m]": [distance for *_, distance in costs],
    }


def _settings_table(trials: Sequence[Trial], best: Sequence[Trial]) -> dict[str, list[Any]]:
    chosen = {id(trial) for trial in best}
    return {
        "dead time [s]": [trial.lag.dead_time for trial in trials],
        "time constant [s]": [trial.lag.time_constant for trial in trials],
        "weighting": [trial.setting.label for trial in trials],
        "dwell time [s]": [trial.setting.dwell_time for trial in trials],
        "orientation change, worst [deg]": [trial.worst_rotation for trial in trials],
        "stopping distance, worst [m]": [trial.worst_distance for trial in trials],
        "orientation change, undisturbed [deg]": [float(t.rotation[0]) for t in trials],
        "stopping distance, undisturbed [m]": [float(t.distance[0]) for t in trials],
        "brake switchings, mean": [float(np.mean(trial.switchings)) for trial in trials],
        "best of the vehicle's brakes": [int(id(trial) in chosen) for trial in trials],
    }


def _lag(text: str) -> BrakeLag:
    try:
        dead_time, time_constant = map(float, text.split(":"))
    except ValueError:
        problem = f"{text!r} must have the form DEAD:LAG, such as 0.02:0.05"
        raise configuration.ConfigurationError("--brakes", problem) from None
    return BrakeLag(dead_time, time_constant)
