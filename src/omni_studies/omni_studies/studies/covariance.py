"""Consistency of the twist's error with its covariance, over grounds, line cameras and motions.

Three line cameras look along the tangents of a circle. For a correct covariance, the squared error
of the twist, divided by its expectation from the covariance, has the mean 1. Speeds are shares of
the largest sideways speed at 60 % overlap (Table 4), so that all kinds of camera are comparable.

In a cross-validation over grounds, a factor on the variances is fitted on all grounds but one and
evaluated on the remaining one. The odometry itself has no such factor.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from linescan_odometry.odometry import OdometryConfiguration
from omni_figures import style
from omni_loop.metrics import Metric
from omni_platform.configuration import Configuration, parameter
from omni_platform.sensors import LineSensor
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.errors import within_95
from omni_tools.line_trials.rig import Rig, ground
from omni_tools.line_trials.twist_trials import TwistTrial, drive
from omni_tools.placement.common_placements import tangential

_GROUNDS = ("cork", "asphalt", "stone")
# Grounds with two texels per pixel.
_HARDER = dict.fromkeys((
    "worn_asphalt", "concrete", "wet_concrete", "gravel", "grass", "sand", "bark", "brick",
    "cobble",
), 8192)  # fmt: skip
_COLORS = (style.BLUE, style.ORANGE, style.GREEN)
_CAMERAS = {
    "generic": LineSensor(x=0.0, y=0.0, heading_deg=0.0),
    "lis770i": LineSensor(
        x=0.0, y=0.0, heading_deg=0.0, pixels=335, width=0.0025, line_rate=2985.0
    ),
    "s3901": LineSensor(x=0.0, y=0.0, heading_deg=0.0, pixels=128, width=0.0195, line_rate=15600.0),
}
# v_x, v_y and the speed of a point on the cameras' circle by turning, as shares of the largest
# sideways speed.
_MOTIONS = {
    "at rest": (0.0, 0.0, 0.0),
    "creeping": (0.001, 0.0, 0.0005),
    "slow": (0.05, 0.0, 0.0),
    "ahead": (0.5, 0.0, 0.0),
    "sideways": (0.0, 0.5, 0.0),
    "diagonal": (0.25, 0.25, 0.0),
    "in a curve": (0.25, 0.0, 0.05),
    "spinning": (0.0, 0.0, 0.1),
}
_BAND = (0.8, 1.25)  # limits of the mean for a correct covariance
_JUDGED = "generic"  # camera that is tried over all grounds


@dataclasses.dataclass(frozen=True)
class Case:
    """Trials of one camera, ground and motion from several starts.

    Attributes:
        camera: name of the camera.
        ground: kind of the ground.
        motion: name of the motion.
        trials: one trial for each start (position and direction).
    """

    camera: str
    ground: str
    motion: str
    trials: tuple[TwistTrial, ...]

    @property
    def squares(self) -> NDArray[np.float64]:
        """Squared errors of the twist over their expectation [1], of all batches."""
        return np.concatenate([trial.normalized_error_squared for trial in self.trials])

    @property
    def squares_of_cameras(self) -> NDArray[np.float64]:
        """Squared errors of single cameras over their variances [1]."""
        return np.concatenate([trial.ratio**2 for trial in self.trials])

    @property
    def mean(self) -> float:
        """Mean of `squares`."""
        return _mean(self.squares)

    @property
    def standard_error(self) -> float:
        """Standard error of the mean over starts, as batches from one start are not independent."""
        squares = [trial.normalized_error_squared for trial in self.trials]
        means = [s.mean() for s in squares if len(s)]
        return float(np.std(means, ddof=1)) / math.sqrt(len(means)) if len(means) > 1 else math.nan

    @property
    def measured(self) -> float:
        """Share of the batches that were measured, 0..1."""
        return float(np.mean([trial.measured for trial in self.trials]))


class Options(Configuration):
    """Extent of the drives, and noise."""

    starts: int = parameter(12, minimum=2, maximum=10_000)
    """number of random positions and directions, each with 8 batches of 10 ms, for each camera,
    ground and motion"""
    noise: float = parameter(1.0, minimum=0.0, maximum=50.0)
    """standard deviation of the noise in gray levels"""
    seed: int = parameter(1, minimum=0)
    """seed of positions and noise"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Drive every case; write figure, data and metrics."""
    cases = [case for kind in _GROUNDS for name in _CAMERAS for case in _drive(name, kind, options)]
    cases += [
        case
        for kind in (_HARDER if _JUDGED in _CAMERAS else ())
        for case in _drive(_JUDGED, kind, options)
    ]
    left_out = _leave_one_out(cases)
    study.figure("covariance.png", _draw(cases))
    header: tuple[str, ...] = (
        "ground", "factor", "normalized_error_squared", "coverage",
    )  # fmt: skip
    study.table("left_out.csv", header, ((kind, *values) for kind, values in left_out.items()))
    header = (
        "camera", "ground", "motion", "v_x", "v_y", "yaw_rate", "measured_share",
        "normalized_error_squared", "standard_error", "rmse_v_x", "rmse_v_y",
        "rmse_yaw_rate", "stated_v_x", "stated_v_y", "stated_yaw_rate",
    )  # fmt: skip
    study.table("covariance.csv", header, map(_row, cases))
    return study.result(_metrics(cases, left_out))


class LeftOut(NamedTuple):
    """Evaluation of the variance factor of all other grounds on one ground.

    Attributes:
        factor: factor on the variances, fitted on the other grounds [1].
        squared: mean squared error of single cameras over the scaled variances on this ground [1].
        coverage: share of errors within 1.96 standard deviations [%].
    """

    factor: float
    squared: float
    coverage: float


def _leave_one_out(cases: list[Case]) -> dict[str, LeftOut]:
    """Return for each ground the evaluation of the variance factor of all other grounds."""
    found: dict[str, NDArray[np.float64]] = {}
    for kind in dict.fromkeys(case.ground for case in cases):
        own = [case for case in cases if (case.camera, case.ground) == (_JUDGED, kind)]
        if own:
            found[kind] = np.concatenate([case.squares_of_cameras for case in own])
    left_out = {}
    for kind, own_squares in found.items():
        factor = _fitted([squares for other, squares in found.items() if other != kind])
        left = own_squares / factor
        if len(left):
            covered = 100.0 * float(np.mean(within_95(np.sqrt(left))))
            left_out[kind] = LeftOut(factor, float(left.mean()), covered)
    return left_out


def _fitted(squares: list[NDArray[np.float64]]) -> float:
    """Return the variance factor for which the mean over the grounds is 1."""
    means = [float(own.mean()) for own in squares if len(own)]
    return float(np.mean(means)) if means else 1.0


def _drive(
    name: str, kind: str, options: Options, radius: float = 0.6, batches: int = 8
) -> list[Case]:
    """Drive all motions over one ground with three equal cameras on a circle of `radius` [m]."""
    camera = _CAMERAS[name]
    sensors = tangential(radius, camera)
    configuration = OdometryConfiguration(sensors=sensors)
    rig = Rig(sensors, ground(kind, _HARDER.get(kind, 4096)), options.noise, options.seed)
    generator = np.random.default_rng(options.seed)
    largest = camera.sideways_speed
    cases = []
    for motion, shares in _MOTIONS.items():
        twist = largest * np.array(shares) / np.array([1.0, 1.0, radius])
        trials = tuple(
            drive(configuration, rig, twist, batches, generator) for _ in range(options.starts)
        )
        cases.append(Case(name, kind, motion, trials))
    return cases


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else math.nan


def _metrics(cases: list[Case], left_out: Mapping[str, LeftOut]) -> dict[str, Metric]:
    metrics = {}
    for name, kind in dict.fromkeys((case.camera, case.ground) for case in cases):
        own = [case for case in cases if (case.camera, case.ground) == (name, kind)]
        pooled = np.concatenate([case.squares for case in own])
        measured = float(np.mean([case.measured for case in own]))
        metrics[f"normalized_error_squared.{name}_{kind}"] = Metric(
            _mean(pooled), "1", reference=1.0
        )
        metrics[f"measured_share.{name}_{kind}"] = Metric(measured, "1")
    for kind, left in left_out.items():
        metrics[f"left_out.{kind}"] = Metric(left.squared, "1", reference=1.0)
        metrics[f"coverage_left_out.{kind}"] = Metric(left.coverage, "%")
    every = np.concatenate([case.squares for case in cases])
    metrics["normalized_error_squared.all"] = Metric(_mean(every), "1", reference=1.0)
    right = [_BAND[0] <= case.mean <= _BAND[1] for case in cases if len(case.squares)]
    metrics["right_share.all"] = Metric(_mean(np.array(right, dtype=np.float64)), "1")
    return metrics


def _row(case: Case) -> tuple[str | float, ...]:
    error = np.concatenate([trial.error for trial in case.trials])
    covariance = np.concatenate([trial.covariance for trial in case.trials])
    rmse = [math.sqrt(_mean(column**2)) for column in error.T]
    stated = [math.sqrt(_mean(covariance[:, i, i])) for i in range(3)]
    return (
        case.camera, case.ground, case.motion, *case.trials[0].twist, case.measured,
        case.mean, case.standard_error, *rmse, *stated,
    )  # fmt: skip


def _draw(cases: list[Case]) -> Figure:
    figure, (panels,) = style.panels(
        "Error squared of the twist over its expectation; bars: standard error",
        1,
        len(_CAMERAS),
        size=(13.0, 4.8),
        y="error squared over its expectation [1]",
        sharey=True,
    )
    places = np.arange(len(_MOTIONS))
    for axes, name in zip(panels, _CAMERAS, strict=True):
        axes.axhspan(*_BAND, color=style.PALE, alpha=0.6, linewidth=0.0)
        axes.axhline(1.0, color=style.GRAY, linewidth=1.0)
        for i, (kind, color) in enumerate(zip(_GROUNDS, _COLORS, strict=False)):
            own = [case for case in cases if (case.camera, case.ground) == (name, kind)]
            mean = [case.mean for case in own]
            spread = [case.standard_error for case in own]
            axes.errorbar(
                places + 0.2 * (i - 1), mean, spread, fmt="o", color=color, label=kind, capsize=2
            )
        view = _CAMERAS[name]
        size = f"{1e3 * view.length:g} x {1e3 * view.width:g} mm"
        axes.set_title(f"{name}: {view.pixels} px, {size}")
        axes.set_xticks(places, list(_MOTIONS), rotation=35, ha="right")
        axes.set_yscale("log")
        axes.set_yticks([0.5, 0.8, 1.0, 1.25, 2.0], ["0.5", "0.8", "1", "1.25", "2"])
        axes.minorticks_off()
    panels[0].legend(loc="upper left")
    return figure
