"""Integrity of the line cameras: undetected errors on difficult textures and with camera faults.

An undetected error is a batch of one camera that is reported as measured although its velocity
along its axis is off by more than 4 of its stated standard deviations and by more than 0.05 m/s.
`availability` is the share of batches that are measured at all, and `normalized_error` the mean of
error squared over stated variance. Every drive begins with a new odometry without estimates of its
cameras.

A run of the campaign is one drive: it is rendered once, and every fault is applied to its lines.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from linescan_odometry.configuration import METHODS, OdometryConfiguration
from omni_figures import style
from omni_loop.metrics import Metric
from omni_platform.configuration import ConfigurationError, parameter
from omni_studies.claims import limited
from omni_studies.line_trials import integrity_trials as trials
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions, digest
from omni_tools.line_trials.errors import within_95

_WOOD_ANGLES = (15, 30, 45, 60, 75)
GROUNDS = {
    "asphalt": trials.Ground("asphalt"),
    "worn_asphalt": trials.Ground("worn_asphalt"),
    "concrete": trials.Ground("concrete"),
    "wet_concrete": trials.Ground("wet_concrete"),
    "gravel": trials.Ground("gravel"),
    "grass": trials.Ground("grass"),
    "sand": trials.Ground("sand"),
    "bark": trials.Ground("bark"),
    "brick": trials.Ground("brick"),
    "cobble": trials.Ground("cobble"),
    "planks": trials.Ground("planks"),
    **{f"wood_{angle}": trials.Ground("wood", math.radians(angle)) for angle in _WOOD_ANGLES},
}
_ORIENTED = tuple(name for name in GROUNDS if name.startswith("wood_"))
_OF_TIME_OVER = ("asphalt", "concrete", "gravel", "grass", "brick")


class Options(CampaignOptions):
    """Grounds, faults and extent of the drives."""

    grounds: str = parameter("", description=f"some of {', '.join(GROUNDS)}; empty for all")
    faults: str = parameter(
        "",
        description=f"some of {', '.join(trials.FAULTS)}; empty for all, over wood only none, and "
        "those of time, which no ground changes, over a few grounds",
    )
    batches: int = parameter(
        16,
        description=f"of each of {len(trials.SENSORS)} cameras in each of {len(trials.MOTIONS)} "
        "motions",
        minimum=2,
        maximum=10_000,
    )
    method: str = parameter(OdometryConfiguration.method, choices=METHODS)
    """value of the parameter odometry.method"""
    seed: int = parameter(1, minimum=0)
    """seed of grounds, positions and noise"""


class Drive(NamedTuple):
    """One drive over one ground.

    Attributes:
        seed: number of the drive in the campaign.
        ground: name of the ground.
        counts: for each fault, its name and the fields of `Counts` as text, such as ``mud 144 2
            ...``.
    """

    seed: int
    ground: str
    counts: str


class Counts(NamedTuple):
    """Statistics over batches.

    Attributes:
        batches: number of batches of all cameras.
        undetected: number of batches with an undetected error.
        measured: number of measured batches.
        squares: sum of errors squared over variances of measured batches [1].
        covered: number of errors within 1.96 standard deviations.
        energy: sum of errors squared [m^2/s^2].
    """

    batches: int = 0
    undetected: int = 0
    measured: int = 0
    squares: float = 0.0
    covered: int = 0
    energy: float = 0.0

    @classmethod
    def of(cls, tally: trials.Tally) -> Counts:
        """Count the batches of a drive."""
        measured = np.isfinite(tally.ratio)
        ratio, error = tally.ratio[measured], tally.error[measured]
        return cls(
            len(tally.ratio),
            int(np.count_nonzero(tally.undetected)),
            len(ratio),
            float(ratio @ ratio),
            int(np.count_nonzero(within_95(ratio))),
            float(error @ error),
        )

    def __str__(self) -> str:
        """Return the numbers as a text in a table."""
        return " ".join(str(value) for value in self)

    @classmethod
    def read(cls, words: Sequence[str]) -> Counts:
        """Read the text of `__str__`."""
        kinds = (type(value) for value in cls())
        return cls._make(kind(word) for kind, word in zip(kinds, words, strict=True))

    def plus(self, other: Counts) -> Counts:
        """Return the sum of both counts."""
        return Counts._make(map(operator.add, self, other))


@dataclasses.dataclass(frozen=True)
class _Drives:
    """Runs the drives of a campaign by their numbers; consecutive numbers share a ground."""

    grounds: tuple[str, ...]
    faults: tuple[str, ...]
    chosen: bool
    batches: int
    seed: int
    method: str

    def __call__(self, number: int) -> Drive:
        """Run one drive."""
        index, motion = divmod(number, len(trials.MOTIONS))
        name = self.grounds[index]
        chosen = {fault: trials.FAULTS[fault] for fault in self.faults_over(name)}
        drives = range(motion, motion + 1)
        tallies = trials.drive_over(
            GROUNDS[name], chosen, drives, self.batches, self.seed, method=self.method
        )
        counts = ";".join(f"{fault} {Counts.of(tally)!s}" for fault, tally in tallies.items())
        return Drive(number, name, counts)

    def faults_over(self, ground: str) -> tuple[str, ...]:
        """Return the faults to inject on a ground: the chosen ones, or else its default faults."""
        if self.chosen:
            return self.faults
        if ground in _ORIENTED:
            return ("none",)
        return tuple(f for f in self.faults if f not in trials.OF_TIME or ground in _OF_TIME_OVER)

    @property
    def fingerprint(self) -> str:
        """Digest of everything on which the drives depend."""
        return digest(repr(self), inspect.getsource(trials), repr(GROUNDS))


def run(options: Options, study: StudyRun) -> StudyResult:
    """Drive over every ground with every fault; write figure, data and metrics."""
    grounds = _chosen("--grounds", options.grounds, tuple(GROUNDS))
    faults = _chosen("--faults", options.faults, tuple(trials.FAULTS))
    work = _Drives(
        grounds, faults, bool(options.faults), options.batches, options.seed, options.method
    )
    numbers = range(len(grounds) * len(trials.MOTIONS))
    drives = study.campaign(work, numbers, Drive, options, work.fingerprint, "drives.csv")
    tallies = _added_up(drives)
    cells = [(name, fault) for name in grounds for fault in faults if (name, fault) in tallies]
    study.figure("integrity.png", _draw(grounds, faults, tallies))
    header = (
        "ground", "fault", "batches", "undetected_per_mille", "available_percent",
        "normalized_error", "coverage_percent", "rmse_mm_per_s",
    )  # fmt: skip
    study.table("integrity.csv", header, ((*cell, *_numbers(tallies[cell])) for cell in cells))
    metrics = limited("integrity", _metrics(cells, tallies))
    return study.result(metrics, *_findings(cells, metrics))


def _added_up(drives: Iterable[Drive]) -> dict[tuple[str, str], Counts]:
    """Return the counts of every ground and fault."""
    tallies: dict[tuple[str, str], Counts] = {}
    for drive in drives:
        for entry in drive.counts.split(";"):
            fault, *words = entry.split()
            cell = drive.ground, fault
            tallies[cell] = tallies.get(cell, Counts()).plus(Counts.read(words))
    return tallies


def _chosen(option: str, words: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names in an option, all names if it is empty."""
    chosen = tuple(word.strip() for word in words.split(",") if word.strip()) or names
    for word in chosen:
        if word not in names:
            raise ConfigurationError(option, f"{word!r} is none of {', '.join(names)}")
    return chosen


def _numbers(counts: Counts) -> tuple[float, ...]:
    """Return the values of a row of integrity.csv, without ground and fault."""
    measured = counts.measured or math.nan
    return (
        counts.batches,
        1e3 * counts.undetected / counts.batches,
        100.0 * counts.measured / counts.batches,
        counts.squares / measured,
        100.0 * counts.covered / measured,
        1e3 * math.sqrt(counts.energy / measured),
    )


def _metrics(
    cells: list[tuple[str, str]], tallies: Mapping[tuple[str, str], Counts]
) -> dict[str, Metric]:
    metrics = {}
    for name, fault in cells:
        _, undetected, available, squared, coverage, rmse = _numbers(tallies[name, fault])
        key = f"{name}_{fault}"
        metrics[f"undetected_error_rate.{key}"] = Metric(undetected, "per mille")
        metrics[f"availability.{key}"] = Metric(available, "%")
        metrics[f"rmse.{key}"] = Metric(
            rmse, "mm/s", note="" if math.isfinite(rmse) else "nothing was measured"
        )
        if fault == "none" and math.isfinite(squared):
            metrics[f"normalized_error.{name}"] = Metric(squared, "1", reference=1.0)
            metrics[f"coverage.{name}"] = Metric(coverage, "%", reference=95.0)
    return metrics


def _findings(cells: list[tuple[str, str]], metrics: Mapping[str, Metric]) -> tuple[str, ...]:
    findings = []
    for words, faulty in (("Without a fault", False), ("With a fault", True)):
        rates = {
            cell: metrics[f"undetected_error_rate.{'_'.join(cell)}"]
            for cell in cells
            if (cell[1] != "none") == faulty
        }
        if rates:
            worst = max(rates, key=lambda cell: rates[cell].value)
            findings.append(
                f"{words}, {sum(rate.status == 'met' for rate in rates.values())} of {len(rates)} "
                f"cases have at most {rates[worst].at_most:g} undetected errors in 1000 batches; "
                f"the worst is {' with '.join(worst)}, {rates[worst].value:.3g}."
            )
    return tuple(findings)


def _draw(
    grounds: tuple[str, ...], faults: tuple[str, ...], tallies: Mapping[tuple[str, str], Counts]
) -> Figure:
    title = "Undetected errors in 1000 batches (left); measured batches in % (right)"
    size = (13.0, 0.36 * len(grounds) + 2.6)
    figure, (panels,) = style.panels(title, 1, 2, size=size, sharey=True)
    for axes, number, highest, colors in zip(
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
        axes.grid(False)
        axes.imshow(values, cmap=colors, vmin=0.0, vmax=highest, aspect="auto")
        axes.set_xticks(
            range(len(faults)), [f.replace("_", " ") for f in faults], rotation=60, ha="right",
        )  # fmt: skip
        axes.set_yticks(range(len(grounds)), [g.replace("_", " ") for g in grounds])
        axes.tick_params(length=0.0)
        for spine in axes.spines.values():
            spine.set_visible(False)
    return figure
