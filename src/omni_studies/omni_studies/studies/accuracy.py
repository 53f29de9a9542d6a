"""Accuracy of refined displacements, and consistency of the errors with the stated variances.

In ``accuracy``, line pairs are rendered at random displacements along the axis and matched. Their
errors are compared with the Cramer-Rao bound of each pair, the smallest variance of an unbiased
estimator. The bias toward integer shifts ("pixel locking") is fitted as a function of the
fractional part of the displacement.

In ``covariance``, three line cameras are mounted tangentially on a circle. If the covariance of the
twist is correct, the squared error of the twist, divided by its expectation, has the mean 1. Speeds
are given as shares of the sideways speed at 60 % overlap (Table 4), so that different cameras can
be compared. In a cross-validation over grounds, a factor on the variances is fitted on all grounds
except one, and evaluated on the remaining ground. The odometry itself has no such factor.
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from linescan_odometry.configuration import METRIC_NAMES, OdometryConfiguration
from omni_core.configuration import Configuration, parameter
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials import trials as line_trials
from omni_tools.line_trials.rig import Rig, View, camera, ground
from omni_tools.placement.mounting_area import tangential

CASES = {
    "accuracy": "Accuracy of refined displacements compared with its bound, for noises, "
    "resolutions, grounds",
    "covariance": "Consistency of the twist's error with its stated covariance, on several grounds "
    "and motions",
}

# Cameras of section 4.4 and Table 3: files of config/sensors/ by the names in the metrics.
_CAMERAS = {"generic": "generic", "lis770i": "lis_770i", "s3901": "s3901"}
_NOISES = (1, 2, 5)  # gray levels
_DRAWN_NOISE = 2  # gray levels, in the panels that show the mean error
_GROUNDS = ("cork", "asphalt", "stone")
_FRACTIONS = 16
_FARTHEST = 0.25  # limit on the displacement, as a share of the line
_LARGEST_LOCKING = 0.02  # px, as in limits.yaml
_RADIUS = 0.6  # radius of the circle on which the cameras are mounted [m]
_BATCHES = 8  # number of batches from each start


@dataclasses.dataclass(frozen=True)
class AccuracyCase:
    """Errors of line pairs with one number of pixels, one noise level and one ground.

    As in the odometry, pairs are excluded if the refined displacement is outside the correlation
    peak; only `wrong` includes them.

    Attributes:
        pixels: number of pixels per line.
        noise: standard deviation of the noise [gray levels].
        ground: kind of the ground.
        fraction: fractional part of the true displacements [px], shape (m,).
        error: unrounded error [px], shape (m,).
        wrong: share of pairs whose error is a pixel or more, Eq. (84), 0 to 1.
        bound: smallest possible variance [px^2], shape (m,).
        variance: variance computed by the refinement [px^2], shape (m,).
    """

    pixels: int
    noise: int
    ground: str
    fraction: FloatArray
    error: FloatArray
    wrong: float
    bound: FloatArray
    variance: FloatArray

    @property
    def over_bound(self) -> float:
        """RMS of the errors, each divided by the smallest possible standard deviation [1]."""
        return math.sqrt(float(np.mean(self.error**2 / self.bound)))

    @property
    def rmse(self) -> float:
        """Root mean square error of the displacements [px]."""
        return math.sqrt(float(np.mean(self.error**2)))

    @property
    def consistency(self) -> float:
        """Mean ratio of squared error to stated variance [1]."""
        return float(np.mean(self.error**2 / self.variance))


class Options(Configuration):
    """Options of the study ``accuracy``: similarity metric, number of line pairs, and seed."""

    metric: str = parameter("pearson", choices=METRIC_NAMES)
    """similarity metric of the search for displacements"""
    pairs: int = parameter(480, minimum=2 * _FRACTIONS, maximum=100_000)
    """number of pairs of lines for each resolution, noise and ground"""
    seed: int = parameter(1, minimum=0)
    """seed of positions and noise"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Measure the displacements of line pairs in every case; write figure and metrics."""
    views = [View.of(camera) for camera in _cameras(study).values()]
    cases = [
        trial(view, noise, kind, options)
        for kind in _GROUNDS
        for view in views
        for noise in _NOISES
    ]
    study.plot("accuracy", _draw(cases, views))
    return study.result(_metrics(cases))


def _cameras(study: StudyRun) -> dict[str, LineSensor]:
    return {name: study.experiments.camera(file) for name, file in _CAMERAS.items()}


def trial(view: View, noise: int, kind: str, options: Options) -> AccuracyCase:
    """Return the result of rendering and matching line pairs at random displacements.

    Args:
        view: field of view of the camera.
        noise: standard deviation [gray levels].
        kind: kind of ground.
        options: similarity metric, number of pairs, and seed of positions, displacements and noise.
    """
    pixels, pairs, seed = view.pixels, options.pairs, options.seed
    generator = np.random.default_rng([seed, pixels, noise])
    eye = camera(view, ground(kind), noise, seed)
    fraction = np.arange(pairs) % _FRACTIONS / _FRACTIONS
    most = int(_FARTHEST * pixels)
    displacement = generator.integers(-most, most, pairs) + fraction
    poses = np.zeros((2 * pairs, 3))
    poses[::2, :2] = generator.uniform(0.0, 0.2, (pairs, 2))
    poses[1::2] = poses[::2]
    poses[1::2, 0] += displacement * view.pitch
    lines = eye.lines(poses, 0)
    matches = line_trials.every_second(line_trials.match(view, poses, lines, options.metric))
    refined = np.isfinite(matches.variance)
    bound = line_trials.cramer_rao_bound(view, eye, poses[::2], matches.truth, noise)
    wrong = float(np.mean(matches.pixel_error != 0.0))
    found = fraction[refined], matches.error[refined]
    return AccuracyCase(
        pixels, noise, kind, *found, wrong, bound[refined], matches.variance[refined]
    )


def locking(fraction: FloatArray, error: FloatArray) -> float:
    """Return the largest bias of measured displacements toward integer shifts [px].

    Args:
        fraction: fractional part of the true displacements [px], evenly distributed, shape (m,).
        error: error of the measured displacements [px], shape (m,).

    Returns:
        The largest magnitude of ``a sin 2 pi f + b sin 4 pi f``, fitted to the errors.
    """
    return float(np.max(np.abs(_pull(fraction, error)[1])))


def _pull(fraction: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return fractional displacements from 0 to 1 px, and the fitted bias at each of them [px].

    Args:
        fraction: fractional part of the true displacements [px], evenly distributed, shape (m,).
        error: error of the measured displacements [px], shape (m,).
    """
    # By symmetry, the bias is an odd function of the fraction and vanishes at 0 and 1/2 px.
    place = np.linspace(0.0, 1.0, 201)
    curve = np.zeros_like(place)
    for harmonic in (1, 2):
        wave = np.sin(2.0 * np.pi * harmonic * fraction)
        curve += 2.0 * np.mean(error * wave) * np.sin(2.0 * np.pi * harmonic * place)
    return place, curve


def _metrics(cases: list[AccuracyCase]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for pixels in dict.fromkeys(case.pixels for case in cases):
        for noise in _NOISES:
            pool = [case for case in cases if (case.pixels, case.noise) == (pixels, noise)]
            ratio = math.sqrt(float(np.mean([case.over_bound**2 for case in pool])))
            fraction = np.concatenate([case.fraction for case in pool])
            error = np.concatenate([case.error for case in pool])
            key = f"{pixels}_{noise}"
            metrics |= {
                f"rmse_over_bound.{key}": Metric(ratio, "1"),
                f"locking.{key}": Metric(locking(fraction, error), "1", note="pixels"),
                f"rmse_px.{key}": Metric(math.sqrt(float(np.mean(error**2))), "1", note="pixels"),
                f"off_by_a_pixel.{key}": Metric(float(np.mean([c.wrong for c in pool])), "1"),
                f"error2_over_variance.{key}": Metric(
                    float(np.mean([case.consistency for case in pool])), "1"
                ),
            }
    metrics |= {
        f"rmse_over_bound.{case.pixels}_{case.noise}_{case.ground}": Metric(case.over_bound, "1")
        for case in cases
    }
    return metrics


def _draw(cases: list[AccuracyCase], views: list[View]) -> Figure:
    title = (
        "RMS error of refined displacements, and Cramer-Rao bound (dashed); below: mean error at "
        "2 gray levels, fitted bias, and its limit (dotted)"
    )
    x, y = "fraction of the displacement [px]", ("RMS error [px]", "mean error [px]")
    figure, panels = style.panels(title, 2, len(views), size=(13.0, 7.2), x=x, y=y, sharey="row")
    for column, view in enumerate(views):
        over_noise, over_fraction = panels[:, column]
        for kind, color in zip(_GROUNDS, style.WHEEL_COLORS, strict=False):
            own = [case for case in cases if (case.pixels, case.ground) == (view.pixels, kind)]
            bound = [math.sqrt(float(np.mean(case.bound))) for case in own]
            over_noise.plot(_NOISES, [c.rmse for c in own], "o-", color=color, label=kind)
            over_noise.plot(_NOISES, bound, "--", color=color)
            drawn = next(case for case in own if case.noise == _DRAWN_NOISE)
            places = np.unique(drawn.fraction)
            means = [float(np.mean(drawn.error[drawn.fraction == f])) for f in places]
            over_fraction.plot(places, means, "o", color=color, markersize=4, alpha=0.5)
            over_fraction.plot(*_pull(drawn.fraction, drawn.error), color=color, linewidth=1.8)
        over_noise.plot(_NOISES, [math.sqrt(1.0 / 12.0)] * len(_NOISES), color=style.GRAY)
        place = _NOISES[0], math.sqrt(1.0 / 12.0)
        style.note(over_noise, "whole pixels", place, (0, -3), va="top", color=style.GRAY)
        over_noise.set_title(_size(view))
        over_noise.set_yscale("log")
        over_noise.set_xlabel("noise [gray levels]")
        over_noise.set_xticks(_NOISES)
        for side in (-_LARGEST_LOCKING, _LARGEST_LOCKING):
            over_fraction.axhline(side, color=style.BLACK, linewidth=1.0, linestyle=":")
        over_fraction.set_ylim(-2.0 * _LARGEST_LOCKING, 2.0 * _LARGEST_LOCKING)
    panels[0, -1].legend(loc="lower right")
    return figure


# Grounds with two texels per pixel.
_HARDER = dict.fromkeys((
    "worn_asphalt", "concrete", "wet_concrete", "gravel", "grass", "sand", "bark", "brick",
    "cobble",
), 8192)  # fmt: skip
_COLORS = (style.BLUE, style.ORANGE, style.GREEN)
# v_x, v_y, and the speed that the yaw rate causes at the cameras, as shares of the sideways speed
# at 60 % overlap.
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
class DriveCase:
    """Trials of one camera type, ground and motion, from several random starts.

    Attributes:
        camera: name of the camera.
        ground: kind of the ground.
        motion: name of the motion.
        trials: one trial for each start (position and direction).
    """

    camera: str
    ground: str
    motion: str
    trials: tuple[line_trials.TwistTrial, ...]

    @property
    def squares(self) -> FloatArray:
        """Squared error of the twist, divided by its expectation [1], shape (batches,)."""
        return np.concatenate([trial.normalized_error_squared for trial in self.trials])

    @property
    def squares_of_cameras(self) -> FloatArray:
        """Squared error, divided by its stated variance [1], of all cameras in all batches."""
        return np.concatenate([trial.ratio**2 for trial in self.trials])

    @property
    def mean(self) -> float:
        """Mean of `squares` [1]."""
        return _mean(self.squares)

    @property
    def standard_error(self) -> float:
        """Standard error of `mean` [1], computed from the mean of each start.

        The means are used because batches from one start are not independent of each other.
        """
        squares = [trial.normalized_error_squared for trial in self.trials]
        means = [s.mean() for s in squares if len(s)]
        return float(np.std(means, ddof=1)) / math.sqrt(len(means)) if len(means) > 1 else math.nan

    @property
    def measured(self) -> float:
        """Share of the batches that have a valid measurement, 0 to 1."""
        return float(np.mean([trial.measured for trial in self.trials]))


class _Drives(Configuration):
    """Options of the study ``covariance``: number of trials, noise and seed."""

    starts: int = parameter(12, minimum=2, maximum=10_000)
    """number of random positions and directions for each camera, ground and motion; from each, 8
    batches of 10 ms are measured"""
    noise: float = parameter(1.0, minimum=0.0, maximum=50.0)
    """standard deviation of the noise in gray levels"""
    seed: int = parameter(1, minimum=0)
    """seed of positions and noise"""


def _covariance(options: _Drives, study: StudyRun) -> StudyResult:
    """Simulate every case; write figure, data and metrics."""
    cameras = _cameras(study)
    driven = [(name, kind) for kind in _GROUNDS for name in cameras]
    driven += [(_EVALUATED, kind) for kind in _HARDER]
    cases = [case for name, kind in driven for case in _drive(name, cameras[name], kind, options)]
    study.plot("covariance", _draw_drives(cases, cameras))
    return study.result(_drive_metrics(cases))


def _drive(name: str, sensor: LineSensor, kind: str, options: _Drives) -> list[DriveCase]:
    """Simulate all motions of three equal cameras over one ground.

    Args:
        name: name of the camera type.
        sensor: camera of this type.
        kind: kind of the ground.
        options: number of starts, noise and seed.
    """
    sensors = tangential(_RADIUS, sensor)
    configuration = OdometryConfiguration(sensors=sensors)
    rig = Rig(sensors, ground(kind, _HARDER.get(kind, 4096)), options.noise, options.seed)
    generator = np.random.default_rng(options.seed)
    largest = sensor.sideways_speed
    cases = []
    for motion, shares in _MOTIONS.items():
        twist = largest * np.array(shares) / np.array([1.0, 1.0, _RADIUS])
        trials = tuple(
            line_trials.drive(configuration, rig, twist, _BATCHES, generator)
            for _ in range(options.starts)
        )
        cases.append(DriveCase(name, kind, motion, trials))
    return cases


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else math.nan


def _drive_metrics(cases: list[DriveCase]) -> dict[str, Metric]:
    metrics = {}
    for name, kind in dict.fromkeys((case.camera, case.ground) for case in cases):
        own = [case for case in cases if (case.camera, case.ground) == (name, kind)]
        pooled = np.concatenate([case.squares for case in own])
        measured = float(np.mean([case.measured for case in own]))
        squared = Metric(_mean(pooled), "1", reference=1.0)
        metrics[f"normalized_error_squared.{name}_{kind}"] = squared
        metrics[f"measured_share.{name}_{kind}"] = Metric(measured, "1")
    for kind, (_, squared_left, coverage) in _leave_one_out(cases).items():
        metrics[f"left_out.{kind}"] = Metric(squared_left, "1", reference=1.0)
        metrics[f"coverage_left_out.{kind}"] = Metric(coverage, "%")
    every = np.concatenate([case.squares for case in cases])
    metrics["normalized_error_squared.all"] = Metric(_mean(every), "1", reference=1.0)
    right = [_BAND[0] <= case.mean <= _BAND[1] for case in cases if len(case.squares)]
    metrics["right_share.all"] = Metric(_mean(np.array(right, dtype=np.float64)), "1")
    return metrics


def _leave_one_out(cases: list[DriveCase]) -> dict[str, tuple[float, float, float]]:
    """Return the results of a cross-validation over the grounds.

    Returns:
        Three values, keyed by the ground that is left out: the factor on the variances, fitted on
            all other grounds [1]; the mean of the squared errors of single cameras, each divided
            by its scaled variance [1]; the share of errors within 1.96 standard deviations [%].
    """
    trials: dict[str, list[FloatArray]] = {}
    for case in cases:
        if case.camera == _EVALUATED and len(case.squares_of_cameras):
            trials.setdefault(case.ground, []).append(case.squares_of_cameras)
    squares = {kind: np.concatenate(own) for kind, own in trials.items()}
    left_out = {}
    for kind, own in squares.items():
        means = [float(own.mean()) for other, own in squares.items() if other != kind]
        factor = float(np.mean(means)) if means else 1.0
        left = own / factor
        covered = 100.0 * float(np.mean(line_trials.within_95(np.sqrt(left))))
        left_out[kind] = factor, float(left.mean()), covered
    return left_out


def _draw_drives(cases: list[DriveCase], cameras: Mapping[str, LineSensor]) -> Figure:
    title = "Squared error of the twist divided by its expectation; bars: standard error"
    y = "squared error / its expectation [1]"
    figure, (panels,) = style.panels(title, 1, len(cameras), size=(13.0, 4.8), y=y, sharey=True)
    places = np.arange(len(_MOTIONS))
    for axes, (name, sensor) in zip(panels, cameras.items(), strict=True):
        axes.axhspan(*_BAND, color=style.PALE, alpha=0.6, linewidth=0.0)
        axes.axhline(1.0, color=style.GRAY, linewidth=1.0)
        for i, (kind, color) in enumerate(zip(_GROUNDS, _COLORS, strict=False)):
            own = [case for case in cases if (case.camera, case.ground) == (name, kind)]
            mean, spread = zip(*((case.mean, case.standard_error) for case in own), strict=True)
            axes.plot(places + 0.2 * (i - 1), mean, "o", color=color, label=kind)
            look = {"fmt": "none", "color": color, "capsize": 2}
            axes.errorbar(places + 0.2 * (i - 1), mean, spread, **look)
        axes.set_title(f"{name}: {_size(View.of(sensor))}")
        axes.set_xticks(places, list(_MOTIONS), rotation=35, ha="right")
        axes.set_yscale("log")
        axes.set_yticks([0.5, 0.8, 1.0, 1.25, 2.0], ["0.5", "0.8", "1", "1.25", "2"])
        axes.minorticks_off()
    panels[0].legend(loc="upper left")
    return figure


def _size(view: View) -> str:
    return f"{view.pixels} px, {1e3 * view.length:g} x {1e3 * view.width:g} mm"


OPTIONS = {"covariance": _Drives}
RUNS = {"covariance": _covariance}
