"""Integrity of the line cameras: undetected errors on difficult textures and with camera faults.

An undetected error is a batch of one camera that is reported as measured although the error of its
velocity exceeds both 4 of its stated standard deviations and 0.05 m/s. `availability` is the share
of batches that are measured, and `normalized_error` is the mean ratio of squared error to stated
variance. A drive is a simulated motion of all cameras over one ground. At the start of every drive,
the odometry is reset; this includes its estimates of camera properties.

Each run of the campaign is one drive with one fault. Runs that differ only in the fault share the
rendered drive.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import operator
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from linescan_odometry.configuration import METHODS, OdometryConfiguration
from omni_core.commands.command_options import option
from omni_core.configuration import parameter
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_studies.claims import limited
from omni_studies.line_trials import integrity_trials as trials
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions, digest
from omni_tools.line_trials.trials import within_95

_WOOD_ANGLES = (15, 30, 45, 60, 75)
_KINDS = (
    "asphalt", "worn_asphalt", "concrete", "wet_concrete", "gravel", "grass", "sand", "bark",
    "brick", "cobble", "planks",
)  # fmt: skip
GROUNDS = {
    **{kind: trials.Ground(kind) for kind in _KINDS},
    **{f"wood_{angle}": trials.Ground("wood", math.radians(angle)) for angle in _WOOD_ANGLES},
}
_ORIENTED = tuple(name for name in GROUNDS if name.startswith("wood_"))
_OF_TIME_OVER = ("asphalt", "concrete", "gravel", "grass", "brick")


class Options(CampaignOptions):
    """Options of the study ``integrity``: grounds, faults, number of batches, method and seed."""

    grounds: tuple[str, ...] = option(
        (),
        metavar="GROUND",
        choices=tuple(GROUNDS),
        many=True,
        description=f"grounds, out of {', '.join(GROUNDS)}; default: all",
    )
    faults: tuple[str, ...] = option(
        (),
        metavar="FAULT",
        choices=tuple(trials.FAULTS),
        many=True,
        description=f"faults, out of {', '.join(trials.FAULTS)}; default: all, but none over wood, "
        "and faults of stamps and lost lines only over a few grounds",
    )
    batches: int = parameter(
        16,
        description=f"number of batches of each of {len(trials.SENSORS)} cameras in each of "
        f"{len(trials.MOTIONS)} motions",
        minimum=2,
        maximum=10_000,
    )
    method: str = parameter(OdometryConfiguration.method, choices=METHODS)
    """value of the parameter `odometry.method`"""
    seed: int = parameter(1, minimum=0)
    """seed of grounds, positions and noise"""


class IntegrityDrive(NamedTuple):
    """Counts of batches in a simulated drive over one ground with one fault, or in several drives.

    Attributes:
        seed: number of the drive in the campaign.
        ground: name of the ground.
        fault: name of the fault.
        batches: number of batches of all cameras.
        undetected: number of batches with an undetected error.
        measured: number of measured batches.
        squares: sum of the squared errors of measured batches, each divided by its stated variance
            [1].
        covered: number of measured batches with an error within 1.96 stated standard deviations.
        energy: sum of the squared errors of measured batches [m^2/s^2].
    """

    seed: int
    ground: str
    fault: str
    batches: int
    undetected: int
    measured: int
    squares: float
    covered: int
    energy: float

    @classmethod
    def of(cls, seed: int, ground: str, fault: str, tally: trials.Tally) -> IntegrityDrive:
        """Return the counts of a drive, from the errors of all batches."""
        measured = np.isfinite(tally.ratio)
        ratio, error = tally.ratio[measured], tally.error[measured]
        every = len(tally.ratio), int(np.count_nonzero(tally.undetected))
        within = int(np.count_nonzero(within_95(ratio)))
        counted = len(ratio), float(ratio @ ratio), within, float(error @ error)
        return cls(seed, ground, fault, *every, *counted)

    def plus(self, other: IntegrityDrive) -> IntegrityDrive:
        """Return the counts of this drive and another one together."""
        return IntegrityDrive(*self[:3], *map(operator.add, self[3:], other[3:]))


@dataclasses.dataclass(frozen=True)
class _Drives:
    """Callable that simulates the drive with a given number, as listed in `cells`."""

    grounds: tuple[str, ...]
    faults: tuple[str, ...]
    chosen: bool
    batches: int
    seed: int
    method: str

    def __call__(self, number: int) -> IntegrityDrive:
        """Simulate the drive with this number, and return its counts."""
        name, motion, fault = self.cells[number]
        drives = range(motion, motion + 1)
        faults = {fault: trials.FAULTS[fault]}
        tallies = trials.drive_over(
            GROUNDS[name], faults, drives, self.batches, self.seed, method=self.method
        )
        return IntegrityDrive.of(number, name, fault, tallies[fault])

    @property
    def cells(self) -> list[tuple[str, int, str]]:
        """Ground, motion and fault of each drive.

        Drives that differ only in the fault follow one another, because they share a rendered
        motion.
        """
        return [
            (name, motion, fault)
            for name in self.grounds
            for motion in range(len(trials.MOTIONS))
            for fault in self.faults_over(name)
        ]

    def faults_over(self, ground: str) -> tuple[str, ...]:
        """Return the faults to inject on a ground: those chosen, or the default for this ground."""
        if self.chosen:
            return self.faults
        if ground in _ORIENTED:
            return ("none",)
        return tuple(f for f in self.faults if f not in trials.OF_TIME or ground in _OF_TIME_OVER)

    @property
    def fingerprint(self) -> str:
        """Digest of all settings that determine the drives."""
        return digest(repr(self), inspect.getsource(trials), repr(GROUNDS))


def run(options: Options, study: StudyRun) -> StudyResult:
    """Simulate all test drives over the grounds with the faults; write figure, data and metrics."""
    grounds = options.grounds or tuple(GROUNDS)
    faults = options.faults or tuple(trials.FAULTS)
    work = _Drives(
        grounds, faults, bool(options.faults), options.batches, options.seed, options.method
    )
    drives = study.campaign(
        work, range(len(work.cells)), IntegrityDrive, options, work.fingerprint, "drives.csv"
    )
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


def _added_up(drives: Iterable[IntegrityDrive]) -> dict[tuple[str, str], IntegrityDrive]:
    """Return the summed counts of all drives, keyed by ground and fault."""
    tallies: dict[tuple[str, str], IntegrityDrive] = {}
    for drive in drives:
        cell = drive.ground, drive.fault
        tallies[cell] = tallies[cell].plus(drive) if cell in tallies else drive
    return tallies


def _numbers(counts: IntegrityDrive) -> tuple[float, ...]:
    """Return the values that follow ground and fault in a row of integrity.csv."""
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
    cells: list[tuple[str, str]], tallies: Mapping[tuple[str, str], IntegrityDrive]
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
    """Return a sentence on the cases without a fault, and one on those with a fault."""
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
    grounds: tuple[str, ...],
    faults: tuple[str, ...],
    tallies: Mapping[tuple[str, str], IntegrityDrive],
) -> Figure:
    size = (13.0, 0.36 * len(grounds) + 2.6)
    figure, (panels,) = style.panels("", 1, 2, size=size, sharey=True)
    titles = "Undetected errors in 1000 batches", "Measured batches [%]; white: not simulated"
    looks = zip(panels, titles, (1, 2), (30.0, 100.0), ("OrRd", "YlGn"), strict=True)
    for axes, title, number, highest, colors in looks:
        axes.set_title(title)
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
            range(len(faults)), [f.replace("_", " ") for f in faults],
            rotation=60, ha="right", rotation_mode="anchor",
        )  # fmt: skip
        axes.set_yticks(range(len(grounds)), [g.replace("_", " ") for g in grounds])
        axes.tick_params(length=0.0)
        for spine in axes.spines.values():
            spine.set_visible(False)
    return figure
