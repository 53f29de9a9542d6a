"""Brake thousands of random vehicles in random conditions, unassisted and assisted.

Writes a table of all runs, one of those that break a limit with the cause, and an experiment file
for each of the worst, which ``./omni run`` replays over the graph.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from omni_analysis.campaign.distribute import (
    ResultTable,
    connected,
    interruptible,
    run_campaign,
    run_chunk,
)
from omni_analysis.campaign.figures import draw_distributions, draw_runs
from omni_analysis.campaign.random_braking import VEHICLES, RandomBraking, experiment_file
from omni_analysis.campaign.robustness import (
    CAUSES,
    DISTANCE_FACTOR,
    ENERGY_LIMIT,
    LIMITS,
    ORIENTATION_LIMIT,
    SHORTEST_DISTANCE,
    Outcome,
)
from omni_analysis.figures.data_table import write_table
from omni_analysis.figures.style import save_figure
from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.metrics import Metric
from omni_analysis.options.studies import check_seed
from omni_analysis.studies import StudyResult
from omni_platform.configuration import ConfigurationError

_MOST_RUNS = 10_000_000
_WORST = 3  # cases to replay, of orientation and of distance each
_PERCENTILES = (50, 95, 100)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what is run, and where."""
    parser.add_argument(
        "--runs", type=int, default=1000, metavar="N", help="number of runs (default: %(default)s)"
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="seed of the first run; the others follow (default: %(default)s)",
    )
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="processes on this machine (default: one on every core)",
    )
    parser.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="run on this dask.distributed cluster, whose workers have this workspace",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="keep the finished runs of an interrupted or shorter campaign and run what is missing",
    )


def run(options: argparse.Namespace, library: ExperimentLibrary, folder: Path) -> StudyResult:
    """Run the campaign and write tables, figures and cases to replay."""
    if not 1 <= options.runs <= _MOST_RUNS:
        raise ConfigurationError("--runs", f"{options.runs} must be in 1 to {_MOST_RUNS}")
    check_seed(options)
    if options.workers is not None and not 1 <= options.workers <= 1024:
        raise ConfigurationError("--workers", f"{options.workers} must be in 1 to 1024")
    if options.workers is not None and options.scheduler is not None:
        raise ConfigurationError("--workers", "does not go with --scheduler, which has its own")
    braking = RandomBraking(library)
    seeds = range(options.seed, options.seed + options.runs)
    table = ResultTable(folder / "runs.csv", braking.fingerprint, resume=options.resume)
    missing = [seed for seed in seeds if seed not in table.results]
    if missing:
        try:
            with interruptible(), table:
                # Compiles what is not compiled yet, before all workers would at once.
                table.add(run_chunk(missing[:1], braking))
                with connected(options.scheduler, options.workers) as client:

                    def on_results(results: list[Outcome]) -> None:
                        table.add(results)
                        done = sum(seed in table.results for seed in seeds)
                        options.report(done / len(seeds), f"{done} of {len(seeds)} runs")

                    run_campaign(client, braking, missing[1:], on_results)
        except KeyboardInterrupt:
            finished = len(table.results)
            raise KeyboardInterrupt(f"{finished} runs are kept, --resume goes on") from None
    results = [table.results[seed] for seed in seeds]
    files = [
        folder / "runs.csv",
        _write_violations(results, folder / "violations.csv"),
        save_figure(draw_runs(results), folder / "runs.png"),
        save_figure(draw_distributions(results), folder / "distributions.png"),
        *_write_worst(results, folder),
    ]
    return StudyResult(_metrics(results), tuple(files), _findings(results))


def _metrics(results: Sequence[Outcome]) -> dict[str, Metric]:
    metrics = {"runs.all": Metric(len(results), "1")}
    for limit in LIMITS:
        causes = Counter(getattr(result, limit) for result in results)
        metrics[f"violations.{limit}"] = Metric(len(results) - causes[""], "1")
        metrics |= {
            f"violations.{limit}_{cause}": Metric(causes[cause], "1")
            for cause in CAUSES
            if causes[cause]
        }
    for vehicle in VEHICLES:
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
    metrics["energy_rise.largest"] = Metric(max(rises), "1", limit=ENERGY_LIMIT)
    tipping = sum(result.tipping for result in results)
    metrics["tipping_share.all"] = Metric(tipping / len(results), "1")
    return metrics


def _findings(results: Sequence[Outcome]) -> tuple[str, ...]:
    better = sum(r.orientation_assisted < r.orientation_unassisted for r in results)
    sentences = [
        f"The assistant keeps the orientation better in {better / len(results):.1%} of "
        f"{len(results)} runs"
    ]
    words = {
        "energy": f"more than {ENERGY_LIMIT:g} of the energy came back",
        "orientation": f"turned by more than {ORIENTATION_LIMIT:g} deg more than unassisted",
        "distance": f"took more than {DISTANCE_FACTOR:g} times the distance",
        "rest": "did not come to rest though it does unassisted",
    }
    for limit, sentence in words.items():
        causes = Counter(getattr(result, limit) for result in results if getattr(result, limit))
        listed = ", ".join(f"{cause} {causes[cause]}" for cause in CAUSES if causes[cause])
        sentences.append(
            f"{causes.total()} runs {sentence}" + (f" (causes: {listed})" if listed else "")
        )
    return tuple(sentences)


def _write_violations(results: Sequence[Outcome], path: Path) -> Path:
    rows = [(result, limit) for result in results for limit in LIMITS if getattr(result, limit)]
    columns = {
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
    return write_table(columns, path)


def _write_worst(results: Sequence[Outcome], folder: Path) -> list[Path]:
    """Write an experiment file for each of the worst cases, and remove those of another time."""
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
            path = folder / f"worst_{limit}_{rank}.yaml"
            path.write_text(
                experiment_file(result.seed, words + (f"; cause: {cause}" if cause else "")),
                encoding="utf-8",
            )
            files.append(path)
    return files


def _turned_more(result: Outcome) -> float:
    return result.orientation_assisted - result.orientation_unassisted


def _went_farther(result: Outcome) -> float:
    return result.distance_assisted / max(result.distance_unassisted, SHORTEST_DISTANCE)
