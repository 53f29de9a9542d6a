"""Brake thousands of random vehicles in random conditions, unassisted and assisted.

Write a table of all runs, a table of violations with their causes, and an experiment file for each
of the worst runs, which ``./omni run`` replays over the graph.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from omni_loop.metrics import Metric
from omni_loop.options import LoopOptions
from omni_platform.configuration import parameter
from omni_studies.campaign import figures, random_braking, robustness
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions

_WORST = 3  # cases to replay, of orientation and of distance each
_PERCENTILES = (50, 95, 100)


@dataclass(frozen=True, kw_only=True)
class Options(CampaignOptions, LoopOptions):
    """Runs, and workers."""

    runs: int = parameter(1000, minimum=1, maximum=10_000_000)
    """number of runs"""
    seed: int = parameter(0, minimum=0)
    """seed of the first run; the others follow"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run the campaign and write tables, figures and cases to replay."""
    braking = random_braking.RandomBraking(study.experiments, options.changes)
    work = partial(robustness.outcome, braking)
    seeds = range(options.seed, options.seed + options.runs)
    results = study.campaign(
        work, seeds, robustness.Outcome, options, braking.fingerprint, "runs.csv"
    )
    study.columns("violations.csv", _violations(results))
    study.figure("runs.png", figures.draw_runs(results))
    study.figure("distributions.png", figures.draw_distributions(results))
    study.written.extend(_write_worst(results, braking, study.folder))
    return study.result(_metrics(results))


def _metrics(results: Sequence[robustness.Outcome]) -> dict[str, Metric]:
    metrics = {"runs.all": Metric(len(results), "1")}
    for limit in robustness.LIMITS:
        causes = Counter(getattr(result, limit) for result in results)
        metrics[f"violations.{limit}"] = Metric(len(results) - causes[""], "1")
        metrics |= {
            f"violations.{limit}_{cause}": Metric(causes[cause], "1")
            for cause in robustness.CAUSES
            if causes[cause]
        }
    for vehicle in random_braking.VEHICLES:
        chosen = [result for result in results if result.vehicle == vehicle]
        if not chosen:
            continue
        for name in ("orientation", "distance"):
            unit = {"orientation": "deg", "distance": "m"}[name]
            for variant in ("unassisted", "assisted"):
                values = np.array([getattr(result, f"{name}_{variant}") for result in chosen])
                metrics |= {
                    f"{name}_p{share}.{vehicle}_{variant}": Metric(
                        float(np.percentile(values, share)), unit
                    )
                    for share in _PERCENTILES
                }
    rises = [max(result.energy_rise_unassisted, result.energy_rise_assisted) for result in results]
    metrics["energy_rise.largest"] = Metric(max(rises), "1", at_most=robustness.ENERGY_LIMIT)
    better = sum(r.orientation_assisted < r.orientation_unassisted for r in results)
    metrics["better_share.all"] = Metric(better / len(results), "1")
    tipping = sum(result.tipping for result in results)
    metrics["tipping_share.all"] = Metric(tipping / len(results), "1")
    return metrics


def _violations(results: Sequence[robustness.Outcome]) -> dict[str, list[Any]]:
    rows = [
        (result, limit)
        for result in results
        for limit in robustness.LIMITS
        if getattr(result, limit)
    ]
    return {
        "seed": [result.seed for result, _ in rows],
        "vehicle": [result.vehicle for result, _ in rows],
        "limit": [limit for _, limit in rows],
        "cause": [getattr(result, limit) for result, limit in rows],
        "orientation unassisted [deg]": [result.orientation_unassisted for result, _ in rows],
        "orientation assisted [deg]": [result.orientation_assisted for result, _ in rows],
        "distance unassisted [m]": [result.distance_unassisted for result, _ in rows],
        "distance assisted [m]": [result.distance_assisted for result, _ in rows],
        "distrusted [1]": [result.distrusted for result, _ in rows],
        "tipping [1]": [result.tipping for result, _ in rows],
    }


def _write_worst(
    results: Sequence[robustness.Outcome], braking: random_braking.RandomBraking, folder: Path
) -> list[Path]:
    """Write an experiment file for each of the worst cases, and remove older ones."""
    for old in folder.glob("worst_*.yaml"):
        old.unlink()
    files = []
    for limit, badness in (("orientation", _turned_more), ("distance", _went_farther)):
        for rank, result in enumerate(sorted(results, key=badness, reverse=True)[:_WORST], 1):
            words = (
                f"{result.orientation_unassisted:.1f} deg and {result.distance_unassisted:.2f} m "
                f"unassisted, {result.orientation_assisted:.1f} deg and "
                f"{result.distance_assisted:.2f} m assisted"
            )
            cause = getattr(result, limit)
            words += f"; cause: {cause}" if cause else ""
            path = folder / f"worst_{limit}_{rank}.yaml"
            path.write_text(braking.experiment_file(result.seed, words), encoding="utf-8")
            files.append(path)
    return files


def _turned_more(result: robustness.Outcome) -> float:
    return result.orientation_assisted - result.orientation_unassisted


def _went_farther(result: robustness.Outcome) -> float:
    return result.distance_assisted / max(result.distance_unassisted, robustness.SHORTEST_DISTANCE)
