"""Integrity of the line cameras: undetected errors on difficult textures and with camera faults.

An undetected error is a batch of one camera that is reported as measured although the error of its
velocity exceeds both 4 of its stated standard deviations and 0.05 m/s; `beyond_4_sigma_rate` also
counts smaller errors. `availability` is the share of batches that are measured, and
`normalized_error` is the mean ratio of squared error to stated variance. `error_autocorrelation` is
the correlation of the errors of consecutive twists, normalized by their covariances. A drive is a
simulated motion of all cameras over one ground. At the start of every drive, the odometry is reset;
this includes its estimates of camera properties.

Each run of the campaign is one drive with one fault. Runs that differ only in the fault share the
rendered drive.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import operator
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from linescan_odometry.configuration import METHODS, OdometryConfiguration
from omni_core.commands.command_options import option
from omni_core.configuration import parameter
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_studies.claims import limited
from omni_studies.line_trials import integrity_cases as cases
from omni_studies.line_trials import integrity_trials as trials
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions, digest
from omni_tools.line_trials.trials import within_95

_WOOD_ANGLES = (15, 30, 45, 60, 75)
_ALL_FAULTS_OVER = (
    "asphalt", "worn_asphalt", "concrete", "wet_concrete", "gravel", "grass", "sand", "bark",
    "brick", "cobble", "planks",
)  # fmt: skip
_FLOORS = (
    "carpet", "terrazzo", "slabs", "tile", "wet_asphalt", "sealed_concrete", "epoxy", "flake_epoxy",
)  # fmt: skip
_FLOOR_NOISE = 2.0  # gray levels; the light indoors is weak
GROUNDS = {
    **{kind: trials.Ground(kind) for kind in _ALL_FAULTS_OVER},
    **{kind: trials.Ground(kind, noise=_FLOOR_NOISE) for kind in _FLOORS},
    **{f"wood_{angle}": trials.Ground("wood", math.radians(angle)) for angle in _WOOD_ANGLES},
}
_ORIENTED = tuple(name for name in GROUNDS if name.startswith("wood_"))
_OF_TIME_OVER = ("asphalt", "concrete", "gravel", "grass", "brick")
_TEXTURED = ("gravel", "flake_epoxy", "carpet", "slabs", "terrazzo")
_RICH = ("gravel", "grass", "flake_epoxy")
_SMOOTH = ("sealed_concrete", "epoxy")
_COARSE = ("brick", "carpet", "slabs", "tile", "terrazzo", "wet_asphalt")
_LIMITED_OVER = {
    **dict.fromkeys(
        ("stuck_pixel", "hot_pixels", "dark_steps", "shadow_fixed", "repeating_ground"),
        _ALL_FAULTS_OVER,
    ),
    **dict.fromkeys(cases.OF_TIME, _OF_TIME_OVER),
    **dict.fromkeys(("low_light", "heave", "late_dirt", "lost_light"), _RICH),
    **dict.fromkeys(
        ("creep", "creep_prnu", "creep_after_motion", "start", "stop", "rest", "rest_flicker",
         "rest_after_motion", "cover_left", "cover_front"),
        _TEXTURED,
    ),
    **dict.fromkeys((name for name in cases.FAULTS if name.startswith("walk")), _SMOOTH),
}  # fmt: skip
"""Grounds over which a fault is injected by default; any other fault is injected over all grounds
but wood."""
_CERTAIN_BATCHES = 3000  # batches of a cell above which the bound of its error rate is limited
_CONFIDENCE = 0.95  # of this bound


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
        choices=tuple(cases.FAULTS),
        many=True,
        description=f"faults and difficult motions, out of {', '.join(cases.FAULTS)}; default: "
        "all, but none over wood, and some of them only over a few grounds",
    )
    batches: int = parameter(
        16,
        description=f"number of batches of each of {len(cases.SENSORS)} cameras in each of "
        f"{len(cases.MOTIONS)} motions",
        minimum=2,
        maximum=10_000,
    )
    runs: int = parameter(
        1,
        description="number of seeds, counted from `seed`; with ten, every cell has at least "
        f"{_CERTAIN_BATCHES} batches, and the upper limits of its error rates are checked",
        minimum=1,
        maximum=1000,
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
        beyond: number of batches with an error beyond 4 stated standard deviations.
        products: sum of the products of the normalized errors of consecutive twists [1].
        powers: sum of the squares of these errors [1].
        hidden: number of batches of covered cameras.
        rejected: number of these batches that are unmeasured.
        alarms: number of batches that are rejected as covered, although the camera is not.
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
    beyond: int
    products: float
    powers: float
    hidden: int
    rejected: int
    alarms: int

    @classmethod
    def of(cls, seed: int, ground: str, fault: str, tally: trials.Tally) -> IntegrityDrive:
        """Return the counts of a drive, from the errors of all batches."""
        measured = np.isfinite(tally.ratio)
        ratio, error = tally.ratio[measured], tally.error[measured]
        products, powers = tally.autocovariance
        hidden = int(np.count_nonzero(tally.covered))
        return cls(
            seed=seed,
            ground=ground,
            fault=fault,
            batches=len(tally.ratio),
            undetected=int(np.count_nonzero(tally.undetected)),
            measured=len(ratio),
            squares=float(ratio @ ratio),
            covered=int(np.count_nonzero(within_95(ratio))),
            energy=float(error @ error),
            beyond=int(np.count_nonzero(tally.beyond)),
            products=products,
            powers=powers,
            hidden=hidden,
            rejected=int(np.count_nonzero(tally.covered & ~measured)),
            alarms=0 if hidden else sum(w.startswith("covered") for w in tally.reasons),
        )

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
    runs: int
    method: str

    def __call__(self, number: int) -> IntegrityDrive:
        """Simulate the drive with this number, and return its counts."""
        run, name, motion, fault = self.cells[number]
        drives = range(motion, motion + 1)
        faults = {fault: cases.FAULTS[fault]}
        tallies = trials.drive_over(
            GROUNDS[name], faults, drives, self.batches, self.seed + run, method=self.method
        )
        return IntegrityDrive.of(number, name, fault, tallies[fault])

    @functools.cached_property
    def cells(self) -> list[tuple[int, str, int, str]]:
        """Number of the seed, ground, motion and fault of each drive.

        Drives that differ only in the fault follow one another, because they share a rendered
        motion.
        """
        most = max(len(fault.motions) for fault in cases.FAULTS.values())
        return [
            (run, name, motion, fault)
            for run in range(self.runs)
            for name in self.grounds
            for motion in range(most)
            for fault in self.faults_over(name)
            if motion < len(cases.FAULTS[fault].motions)
        ]

    def faults_over(self, ground: str) -> tuple[str, ...]:
        """Return the faults to inject on a ground: those chosen, or the default for this ground."""
        if self.chosen:
            return self.faults
        if ground in _ORIENTED:
            return ("none",)
        return tuple(f for f in self.faults if ground in _LIMITED_OVER.get(f, (ground,)))

    @property
    def fingerprint(self) -> str:
        """Digest of all settings that determine the drives."""
        sources = inspect.getsource(trials), inspect.getsource(cases)
        return digest(repr(self), *sources, repr(GROUNDS))


def run(options: Options, study: StudyRun) -> StudyResult:
    """Simulate all test drives over the grounds with the faults; write figure, data and metrics."""
    grounds = options.grounds or tuple(GROUNDS)
    faults = options.faults or tuple(cases.FAULTS)
    chosen = options.batches, options.seed, options.runs, options.method
    work = _Drives(grounds, faults, bool(options.faults), *chosen)
    drives = study.campaign(
        work, range(len(work.cells)), IntegrityDrive, options, work.fingerprint, "drives.csv"
    )
    tallies = _added_up(drives)
    found = [(name, fault) for name in grounds for fault in faults if (name, fault) in tallies]
    study.figure("integrity.png", _draw(grounds, faults, tallies))
    header = (
        "ground", "fault", "batches", "undetected_per_mille", "available_percent",
        "normalized_error", "coverage_percent", "rmse_mm_per_s", "beyond_4_sigma_per_mille",
    )  # fmt: skip
    study.table("integrity.csv", header, ((*cell, *_numbers(tallies[cell])) for cell in found))
    metrics = limited("integrity", _metrics(found, tallies))
    return study.result(metrics, *_findings(found, metrics))


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
        1e3 * counts.beyond / counts.batches,
    )


def _upper_bound(events: int, batches: int) -> float:
    """Return the upper confidence bound of a rate (Clopper and Pearson) [per mille].

    The batches count as independent.
    """
    if events == batches:
        return 1000.0
    return 1e3 * float(stats.beta.ppf(_CONFIDENCE, events + 1, batches - events))


def _metrics(
    found: list[tuple[str, str]], tallies: Mapping[tuple[str, str], IntegrityDrive]
) -> dict[str, Metric]:
    metrics = {}
    for name, fault in found:
        counts = tallies[name, fault]
        _, undetected, available, squared, coverage, rmse, beyond = _numbers(counts)
        key = f"{name}_{fault}"
        metrics[f"undetected_error_rate.{key}"] = Metric(undetected, "per mille")
        metrics[f"beyond_4_sigma_rate.{key}"] = Metric(beyond, "per mille")
        metrics[f"availability.{key}"] = Metric(available, "%")
        metrics[f"rmse.{key}"] = Metric(
            rmse, "mm/s", note="" if math.isfinite(rmse) else "nothing was measured"
        )
        if counts.batches >= _CERTAIN_BATCHES:
            for quantity, events in (
                ("undetected_error_bound", counts.undetected),
                ("beyond_4_sigma_bound", counts.beyond),
            ):
                bound = _upper_bound(events, counts.batches)
                metrics[f"{quantity}.{key}"] = Metric(bound, "per mille")
        if fault == "none":
            alarms = 1e2 * counts.alarms / counts.batches
            metrics[f"false_cover_share.{name}"] = Metric(alarms, "%")
        if fault == "none" and math.isfinite(squared):
            metrics[f"normalized_error.{name}"] = Metric(squared, "1", reference=1.0)
            metrics[f"coverage.{name}"] = Metric(coverage, "%", reference=95.0)
        elif fault not in cases.EVERYWHERE and math.isfinite(squared):
            metrics[f"case_normalized_error.{key}"] = Metric(squared, "1", reference=1.0)
        if fault == "none" and counts.powers > 0.0:
            correlation = counts.products / counts.powers
            metrics[f"error_autocorrelation.{name}"] = Metric(correlation, "1", reference=0.0)
        if counts.hidden:
            rejected = 100.0 * counts.rejected / counts.hidden
            metrics[f"cover_detected.{key}"] = Metric(rejected, "%")
    coarse = [tallies[name, "none"] for name in _COARSE if (name, "none") in tallies]
    if len(coarse) == len(_COARSE):
        share = 100.0 * sum(c.measured for c in coarse) / sum(c.batches for c in coarse)
        metrics["pooled_availability.coarse_none"] = Metric(share, "%")
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
    size = (0.8 * len(faults) + 3.0, 0.36 * len(grounds) + 2.6)
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
