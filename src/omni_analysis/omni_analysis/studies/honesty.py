"""How often a line camera is sure and wrong, over grounds it finds hard and with faults of cameras.

`silent_errors` counts the batches of one camera whose velocity along its axis is off by more than 4
of its standard deviations and by more than 0.05 m/s, and that call themselves measured;
`availability` those that are measured at all, so that silence is no cure. Every drive begins with
an odometry that knows nothing of its cameras.
"""

from __future__ import annotations

import dataclasses
import math
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context

import numpy as np
from matplotlib.figure import Figure

from omni_analysis.figures.data_table import write_table
from omni_analysis.figures.style import LABEL_SIZE, draw_title, save_figure
from omni_analysis.line_trials.honesty_trials import (
    FAULTS,
    MOTIONS,
    SENSORS,
    Ground,
    Tally,
    drive_over,
)
from omni_analysis.loop.metrics import Metric
from omni_analysis.studies import StudyResult, StudyRun
from omni_platform.configuration import Configuration, ConfigurationError, parameter

_WOOD_ANGLES = (15, 30, 45, 60, 75)
GROUNDS = {
    "asphalt": Ground("asphalt"),
    "worn_asphalt": Ground("worn_asphalt"),
    "concrete": Ground("concrete"),
    "wet_concrete": Ground("wet_concrete"),
    "gravel": Ground("gravel"),
    "grass": Ground("grass"),
    "sand": Ground("sand"),
    "bark": Ground("bark"),
    "brick": Ground("brick"),
    "cobble": Ground("cobble"),
    "planks": Ground("planks"),
    **{f"wood_{angle}": Ground("wood", math.radians(angle)) for angle in _WOOD_ANGLES},
}
_ORIENTED = tuple(name for name in GROUNDS if name.startswith("wood_"))
_WITHOUT, _WITH = 3.0, 10.0  # per mille that may be silent errors without and with a fault
_EASY = ("asphalt", "concrete", "gravel", "grass")
_AVAILABLE = 95.0  # % of the batches over these without a fault


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Over what and how much is driven."""

    grounds: str = parameter("", description=f"some of {', '.join(GROUNDS)}; empty for all")
    faults: str = parameter(
        "",
        description=f"some of {', '.join(FAULTS)}; empty for all, over wood only none",
    )
    batches: int = parameter(
        48,
        description=f"of each of {len(SENSORS)} cameras in each of {len(MOTIONS)} motions",
        minimum=2,
        maximum=10_000,
    )
    workers: int = parameter(
        0, description="processes; 0 for one on every core", minimum=0, maximum=1000
    )
    seed: int = parameter(1, description="of grounds, places and noise", minimum=0)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Drive over every ground with every fault; write figure, data and metrics."""
    grounds = _chosen("--grounds", options.grounds, tuple(GROUNDS))
    faults = _chosen("--faults", options.faults, tuple(FAULTS))
    tallies: dict[tuple[str, str], Tally] = {}
    workers = options.workers or len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(min(workers, len(grounds)), get_context("spawn")) as pool:
        work = {}
        for name in grounds:
            own = faults if options.faults or name not in _ORIENTED else ("none",)
            work[pool.submit(_drive, name, own, options.batches, options.seed)] = name
        for done, result in enumerate(as_completed(work)):
            name = work[result]
            tallies |= {(name, fault): tally for fault, tally in result.result().items()}
            study.report((done + 1) / len(work), name)
    cells = [(name, fault) for name in grounds for fault in faults if (name, fault) in tallies]
    files = (
        save_figure(_draw(grounds, faults, tallies), study.folder / "honesty.png"),
        write_table(
            study.folder / "honesty.csv",
            (
                "ground", "fault", "batches", "silent_per_mille", "available_percent",
                "normalised_error_squared", "coverage_percent",
            ),
            ((*cell, *_numbers(tallies[cell])) for cell in cells),
        ),
    )  # fmt: skip
    return StudyResult(_metrics(cells, tallies), files, _findings(cells, tallies))


def _chosen(option: str, words: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names that an option lists, all of them if it is empty."""
    chosen = tuple(word.strip() for word in words.split(",") if word.strip()) or names
    for word in chosen:
        if word not in names:
            raise ConfigurationError(option, f"{word!r} is none of {', '.join(names)}")
    return chosen


def _drive(name: str, faults: tuple[str, ...], batches: int, seed: int) -> dict[str, Tally]:
    """Drive over one ground, in a process of its own."""
    chosen = {fault: FAULTS[fault] for fault in faults}
    return drive_over(GROUNDS[name], chosen, len(MOTIONS), batches, seed)


def _numbers(tally: Tally) -> tuple[float, ...]:
    return (
        len(tally.ratio),
        1e3 * float(np.mean(tally.silent)),
        100.0 * tally.available,
        tally.normalised_error_squared,
        100.0 * tally.coverage,
    )


def _metrics(
    cells: list[tuple[str, str]], tallies: dict[tuple[str, str], Tally]
) -> dict[str, Metric]:
    metrics = {}
    for name, fault in cells:
        _, silent, available, squared, coverage = _numbers(tallies[name, fault])
        limit = _WITHOUT if fault == "none" else _WITH
        metrics[f"silent_errors.{name}_{fault}"] = Metric(silent, "per mille", limit=limit)
        least = _AVAILABLE if fault == "none" and name in _EASY else None
        metrics[f"availability.{name}_{fault}"] = Metric(available, "%", limit=least)
        if fault == "none" and math.isfinite(squared):
            metrics[f"normalised_error_squared.{name}"] = Metric(squared, "1", reference=1.0)
            metrics[f"coverage.{name}"] = Metric(coverage, "%", reference=95.0)
    return metrics


def _findings(
    cells: list[tuple[str, str]], tallies: dict[tuple[str, str], Tally]
) -> tuple[str, ...]:
    findings = []
    for words, limit, chosen in (
        ("without a fault", _WITHOUT, [cell for cell in cells if cell[1] == "none"]),
        ("with a fault", _WITH, [cell for cell in cells if cell[1] != "none"]),
    ):
        if not chosen:
            continue
        silent = {cell: _numbers(tallies[cell])[1] for cell in chosen}
        kept = sum(value <= limit for value in silent.values())
        worst = max(silent, key=lambda cell: silent[cell])
        findings.append(
            f"{words.capitalize()}, {kept} of {len(chosen)} cases have at most {limit:g} silent "
            f"errors in 1000 batches; the worst is {' with '.join(worst)}, {silent[worst]:.3g}."
        )
    return tuple(findings)


def _draw(
    grounds: tuple[str, ...], faults: tuple[str, ...], tallies: dict[tuple[str, str], Tally]
) -> Figure:
    figure = Figure(figsize=(13.0, 0.36 * len(grounds) + 2.6), layout="constrained")
    draw_title(
        figure, "Silent errors in 1000 batches (left); batches that are measured in % (right)"
    )
    panels = figure.subplots(1, 2, sharey=True)
    for axes, number, highest, colours in zip(
        panels, (1, 2), (30.0, 100.0), ("OrRd", "YlGn"), strict=True
    ):
        values = np.full((len(grounds), len(faults)), np.nan)
        for i, name in enumerate(grounds):
            for j, fault in enumerate(faults):
                if (name, fault) in tallies:
                    values[i, j] = _numbers(tallies[name, fault])[number]
                    words = f"{values[i, j]:.1f}" if number == 1 else f"{values[i, j]:.0f}"
                    dark = values[i, j] > 0.6 * highest
                    axes.text(
                        j, i, words, ha="center", va="center", fontsize=7,
                        color="white" if dark else "black",
                    )  # fmt: skip
        axes.imshow(values, cmap=colours, vmin=0.0, vmax=highest, aspect="auto")
        axes.set_xticks(
            range(len(faults)), [f.replace("_", " ") for f in faults], rotation=60, ha="right",
            fontsize=LABEL_SIZE,
        )  # fmt: skip
        axes.set_yticks(
            range(len(grounds)), [g.replace("_", " ") for g in grounds], fontsize=LABEL_SIZE
        )
        axes.tick_params(length=0.0)
        for spine in axes.spines.values():
            spine.set_visible(False)
    return figure
