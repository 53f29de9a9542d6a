"""Accuracy of refined displacements compared with its bound, for noises, resolutions, grounds.

Line pairs are rendered at random displacements along the axis and matched. Their errors are
compared with the Cramer-Rao bound of each pair, the smallest variance of an unbiased estimator. The
bias toward integer shifts ("pixel locking") is fitted as a function of the fraction.
"""

import dataclasses
import math

import numpy as np
from matplotlib.figure import Figure

from linescan_odometry.matching.search import METRICS
from omni_figures import style
from omni_loop.metrics import Metric
from omni_platform.configuration import Configuration, parameter
from omni_platform.quantities import FloatArray
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import View, camera, ground
from omni_tools.line_trials.trials import cramer_rao_bound, every_second, match

# By pixels: the field of view of `generic`, LIS-770i and S3901 (Table 3).
_VIEWS = {
    1024: View(1024, 0.05, 0.02),
    335: View(335, 0.05, 0.0025),
    128: View(128, 0.05, 0.0195),
}
_NOISES = (1, 2, 5)  # gray levels
_DRAWN_NOISE = 2  # gray levels, in the panels that show the mean error
_GROUNDS = ("cork", "asphalt", "stone")
_FRACTIONS = 16
_FARTHEST = 0.25  # largest displacement as a share of the line
_LARGEST_LOCKING = 0.02  # px, as in limits.yaml


@dataclasses.dataclass(frozen=True)
class Case:
    """Errors of one resolution, noise and ground.

    Like the odometry, it excludes pairs whose refinement leaves the peak; `wrong` includes them.

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
        """RMS of the errors, each divided by its smallest possible standard deviation [1]."""
        return math.sqrt(float(np.mean(self.error**2 / self.bound)))

    @property
    def rmse(self) -> float:
        """Root mean square error [px]."""
        return math.sqrt(float(np.mean(self.error**2)))

    @property
    def consistency(self) -> float:
        """Mean ratio of squared error to stated variance [1]."""
        return float(np.mean(self.error**2 / self.variance))


class Options(Configuration):
    """Cases and number of pairs of lines."""

    metric: str = parameter("pearson", choices=tuple(METRICS))
    """similarity metric of the search for displacements"""
    pairs: int = parameter(480, minimum=2 * _FRACTIONS, maximum=100_000)
    """number of pairs of lines for each resolution, noise and ground"""
    seed: int = parameter(1, minimum=0)
    """seed of positions and noise"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Match pairs of lines of every case; write figure and metrics."""
    cases = [
        trial(pixels, noise, kind, options)
        for kind in _GROUNDS
        for pixels in _VIEWS
        for noise in _NOISES
    ]
    study.plot("accuracy", _draw(cases))
    return study.result(_metrics(cases))


def trial(pixels: int, noise: int, kind: str, options: Options) -> Case:
    """Return the result of rendering and matching line pairs at random displacements.

    Args:
        pixels: pixels of a line, which also determine the field of view.
        noise: standard deviation [gray levels].
        kind: kind of ground.
        options: similarity metric, number of pairs, and seed of positions, displacements and noise.
    """
    view, pairs, seed = _VIEWS[pixels], options.pairs, options.seed
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
    matches = every_second(match(view, poses, lines, options.metric))
    refined = np.isfinite(matches.variance)
    bound = cramer_rao_bound(view, eye, poses[::2], matches.truth, noise)
    return Case(
        pixels,
        noise,
        kind,
        fraction[refined],
        matches.error[refined],
        float(np.mean(matches.pixel_error != 0.0)),
        bound[refined],
        matches.variance[refined],
    )


def locking(fraction: FloatArray, error: FloatArray) -> float:
    """Return the largest bias of displacements toward integer shifts [px].

    Args:
        fraction: fractional part of the true displacements [px], evenly distributed, shape (m,).
        error: error of the measured displacements [px], shape (m,).

    Returns:
        The largest magnitude of ``a sin 2 pi f + b sin 4 pi f``, fitted to the errors.
    """
    return float(np.max(np.abs(_pull(fraction, error)[1])))


def _pull(fraction: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return fractional parts and the fitted bias at each [px]."""
    # By symmetry, the bias is an odd function of the fraction and vanishes at 0 and 1/2 px.
    place = np.linspace(0.0, 1.0, 201)
    curve = np.zeros_like(place)
    for harmonic in (1, 2):
        wave = np.sin(2.0 * np.pi * harmonic * fraction)
        curve += 2.0 * np.mean(error * wave) * np.sin(2.0 * np.pi * harmonic * place)
    return place, curve


def _metrics(cases: list[Case]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for pixels in _VIEWS:
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


def _draw(cases: list[Case]) -> Figure:
    figure, panels = style.panels(
        "Error of refined displacements / Cramer-Rao bound (dashed); below: mean error at "
        "2 gray levels, and the fitted bias",
        2,
        len(_VIEWS),
        size=(13.0, 7.2),
        x="fraction of the displacement [px]",
        y=("RMS error [px]", "mean error [px]"),
        sharey="row",
    )
    for column, (pixels, view) in enumerate(_VIEWS.items()):
        over_noise, over_fraction = panels[:, column]
        for kind, color in zip(_GROUNDS, style.WHEEL_COLORS, strict=False):
            own = [case for case in cases if (case.pixels, case.ground) == (pixels, kind)]
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
        size = f"{pixels} px, {1e3 * view.length:g} x {1e3 * view.width:g} mm"
        over_noise.set_title(size)
        over_noise.set_yscale("log")
        over_noise.set_xlabel("noise [gray levels]")
        for side in (-_LARGEST_LOCKING, _LARGEST_LOCKING):
            over_fraction.axhline(side, color=style.BLACK, linewidth=1.0, linestyle=":")
        over_fraction.set_ylim(-1.6 * _LARGEST_LOCKING, 1.6 * _LARGEST_LOCKING)
    panels[0, -1].legend(loc="lower right")
    return figure
