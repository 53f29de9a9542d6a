"""Consistency of the twist's error with its stated covariance, on several grounds and motions.

Three line cameras are mounted tangentially on a circle. If the covariance is correct, the squared
error of the twist divided by its expectation has the mean 1. Speeds are shares of the largest
sideways speed at 60 % overlap (Table 4), so that different cameras can be compared.

In a cross-validation over grounds, a factor on the variances is fitted on all grounds except one,
and evaluated on this one. The odometry itself has no such factor.
"""

import dataclasses
import math
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
from omni_tools.line_trials.rig import Rig, ground
from omni_tools.line_trials.trials import TwistTrial, drive, within_95
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
# v_x, v_y, and the speed that the yaw rate causes at the cameras, as shares of the largest sideways
# speed.
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
_BAND = (0.8, 1.25)  # limits of the mean that count as a correct covariance
_EVALUATED = "generic"  # camera that is tested on all grounds


@dataclasses.dataclass(frozen=True)
class Case:
    """Trials of one camera, ground and motion, from several starts.

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
        """Ratios of the twist's squared error to its expectation [1], for all batches."""
        return np.concatenate([trial.normalized_error_squared for trial in self.trials])

    @property
    def squares_of_cameras(self) -> NDArray[np.float64]:
        """Ratios of single cameras' squared errors to their variances [1]."""
        return np.concatenate([trial.ratio**2 for trial in self.trials])

    @property
    def mean(self) -> float:
        """Mean of `squares` [1]."""
        return _mean(self.squares)

    @property
    def standard_error(self) -> float:
        """Standard error of `mean` [1], computed from the means of the starts.

        The batches from one start are not independent of each other.
        """
        squares = [trial.normalized_error_squared for trial in self.trials]
        means = [s.mean() for s in squares if len(s)]
        return float(np.std(means, ddof=1)) / math.sqrt(len(means)) if len(means) > 1 else math.nan

    @property
    def measured(self) -> float:
        """Share of the batches that have a valid measurement, 0 to 1."""
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
    driven = [(name, kind) for kind in _GROUNDS for name in _CAMERAS]
    driven += [(_EVALUATED, kind) for kind in _HARDER]
    cases = [case for name, kind in driven for case in _drive(name, kind, options)]
    study.plot("covariance", _draw(cases))
    return study.result(_metrics(cases))


class LeftOut(NamedTuple):
    """Evaluation on one ground of the variance factor that was fitted on all other grounds.

    Attributes:
        factor: factor on the variances, fitted on the other grounds [1].
        squared: mean ratio of single cameras' squared errors to their scaled variances [1].
        coverage: share of the errors within 1.96 standard deviations [%].
    """

    factor: float
    squared: float
    coverage: float


def _leave_one_out(cases: list[Case]) -> dict[str, LeftOut]:
    """Return the cross-validation of each ground: errors with the factor of all other grounds."""
    trials: dict[str, list[NDArray[np.float64]]] = {}
    for case in cases:
        if case.camera == _EVALUATED and len(case.squares_of_cameras):
            trials.setdefault(case.ground, []).append(case.squares_of_cameras)
    squares = {kind: np.concatenate(own) for kind, own in trials.items()}
    left_out = {}
    for kind, own in squares.items():
        means = [float(own.mean()) for other, own in squares.items() if other != kind]
        factor = float(np.mean(means)) if means else 1.0
        left = own / factor
        covered = 100.0 * float(np.mean(within_95(np.sqrt(left))))
        left_out[kind] = LeftOut(factor, float(left.mean()), covered)
    return left_out


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


def _metrics(cases: list[Case]) -> dict[str, Metric]:
    metrics = {}
    for name, kind in dict.fromkeys((case.camera, case.ground) for case in cases):
        own = [case for case in cases if (case.camera, case.ground) == (name, kind)]
        pooled = np.concatenate([case.squares for case in own])
        measured = float(np.mean([case.measured for case in own]))
        squared = Metric(_mean(pooled), "1", reference=1.0)
        metrics[f"normalized_error_squared.{name}_{kind}"] = squared
        metrics[f"measured_share.{name}_{kind}"] = Metric(measured, "1")
    for kind, left in _leave_one_out(cases).items():
        metrics[f"left_out.{kind}"] = Metric(left.squared, "1", reference=1.0)
        metrics[f"coverage_left_out.{kind}"] = Metric(left.coverage, "%")
    every = np.concatenate([case.squares for case in cases])
    metrics["normalized_error_squared.all"] = Metric(_mean(every), "1", reference=1.0)
    right = [_BAND[0] <= case.mean <= _BAND[1] for case in cases if len(case.squares)]
    metrics["right_share.all"] = Metric(_mean(np.array(right, dtype=np.float64)), "1")
    return metrics


def _draw(cases: list[Case]) -> Figure:
    figure, (panels,) = style.panels(
        "Squared error of the twist divided by its expectation; bars: standard error",
        1,
        len(_CAMERAS),
        size=(13.0, 4.8),
        y="squared error / its expectation [1]",
        sharey=True,
    )
    places = np.arange(len(_MOTIONS))
    for axes, name in zip(panels, _CAMERAS, strict=True):
        axes.axhspan(*_BAND, color=style.PALE, alpha=0.6, linewidth=0.0)
        axes.axhline(1.0, color=style.GRAY, linewidth=1.0)
        for i, (kind, color) in enumerate(zip(_GROUNDS, _COLORS, strict=False)):
            own = [case for case in cases if (case.camera, case.ground) == (name, kind)]
            mean, spread = zip(*((case.mean, case.standard_error) for case in own), strict=True)
            axes.plot(places + 0.2 * (i - 1), mean, "o", color=color, label=kind)
            look = {"fmt": "none", "color": color, "capsize": 2}
            axes.errorbar(places + 0.2 * (i - 1), mean, spread, **look)
        view = _CAMERAS[name]
        size = f"{1e3 * view.length:g} x {1e3 * view.width:g} mm"
        axes.set_title(f"{name}: {view.pixels} px, {size}")
        axes.set_xticks(places, list(_MOTIONS), rotation=35, ha="right")
        axes.set_yscale("log")
        axes.set_yticks([0.5, 0.8, 1.0, 1.25, 2.0], ["0.5", "0.8", "1", "1.25", "2"])
        axes.minorticks_off()
    panels[0].legend(loc="upper left")
    return figure
