"""Distance measures as functions of the shift, on three grounds (Figure 68).

The camera moves with 20 m/s at 45 deg to its axis: view of 50 x 20 mm, 1024 px, 2500 lines/s, noise
of 5 gray levels. The distance measures are evaluated with `scipy.spatial.distance` at every shift,
independent of the search in the odometry.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import find_peaks
from scipy.spatial import distance
from scipy.stats import rankdata

from omni_figures import style
from omni_loop.metrics import Metric
from omni_platform.quantities import FloatArray
from omni_studies.line_trials.options import LineOptions, kinds_option, noise_option, pairs_option
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import View, camera, ground
from omni_tools.line_trials.trials import path

_VIEW = View()
_SPEED, _ANGLE = 20.0, math.radians(45.0)
_PROMINENCE = 0.1  # smallest depth of a minimum, as a share of the curve's range

_DISTANCES: Mapping[str, Callable[[FloatArray, FloatArray], float]] = {
    "pearson": distance.correlation,  # Eq. (81)
    "spearman": lambda x, y: float(distance.correlation(rankdata(x), rankdata(y))),
    "cosine": distance.cosine,  # Eq. (83)
    "euclidean": lambda x, y: float(distance.euclidean(x, y)) / len(x),  # Eq. (79)
    "squared_euclidean": lambda x, y: float(distance.sqeuclidean(x, y)) / len(x),
    "manhattan": lambda x, y: float(distance.cityblock(x, y)) / len(x),  # Eq. (80)
}


@dataclasses.dataclass(frozen=True)
class Curve:
    """Distance of two lines as a function of the shift.

    Attributes:
        shift: shifts [px], shape (m,).
        distance: distance measure at each shift, in its own unit, shape (m,).
        truth: true displacement [px].
    """

    shift: FloatArray
    distance: FloatArray
    truth: float

    @property
    def minima(self) -> int:
        """Number of minima whose depth is at least a tenth of the curve's range."""
        prominence = _PROMINENCE * float(np.ptp(self.distance))
        padded = np.pad(-self.distance, 1, mode="minimum")  # the ends can be minima too
        return len(find_peaks(padded, prominence=prominence)[0])

    @property
    def width(self) -> float:
        """Width of the deepest minimum at half of its depth below the mean distance [px]."""
        lowest = int(np.argmin(self.distance))
        half = 0.5 * (float(self.distance[lowest]) + float(self.distance.mean()))
        above = np.flatnonzero(self.distance > half)
        left = above[above < lowest]
        right = above[above > lowest]
        first = left[-1] if len(left) else -1
        last = right[0] if len(right) else len(self.distance)
        return float(last - first - 1)

    @property
    def error(self) -> float:
        """Shift of the deepest minimum minus the true displacement [px]."""
        return float(self.shift[np.argmin(self.distance)]) - self.truth


class Options(LineOptions):
    """Grounds, similarity metric, pairs of lines, noise and seed."""

    ground: tuple[str, ...] = kinds_option("stone", "asphalt", "cork")
    pairs: int = pairs_option(20)
    noise: float = noise_option(5.0)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Evaluate the distances; write figure, data and metrics."""
    curves: dict[str, list[Curve]] = {}
    for kind in options.kinds:
        eye = camera(_VIEW, ground(kind, options.texels), options.noise, options.seed)
        generator = np.random.default_rng(options.seed)
        curves[kind] = []
        for pair in range(options.pairs):
            poses = path(_VIEW, _SPEED, _ANGLE, 2, generator)
            old, new = eye.lines(poses, 2 * pair).astype(np.float64)
            truth = float(poses[1, 0] - poses[0, 0]) / _VIEW.pitch
            curves[kind].append(distances(old, new, truth, options.metric, _VIEW.pixels // 2))
    metrics: dict[str, Metric] = {}
    for kind, every in curves.items():
        error = np.abs([curve.error for curve in every])
        width = 1e3 * _VIEW.pitch * float(np.median([curve.width for curve in every]))
        minima = float(np.mean([curve.minima for curve in every]))
        metrics |= {
            f"minima.{kind}": Metric(minima, "1"),
            f"minimum_width.{kind}": Metric(width, "mm"),
            f"right_share.{kind}": Metric(float(np.mean(error <= 1.5)), "1"),
            f"median_error_px.{kind}": Metric(float(np.median(error)), "1", note="pixels"),
        }
    study.plot("figure_68", _draw(curves, options.metric))
    return study.result(metrics)


def distances(old: FloatArray, new: FloatArray, truth: float, metric: str, limit: int) -> Curve:
    """Return a distance measure of two lines per overlapping pixel, at all shifts.

    Args:
        old: first line [gray levels], shape (n,).
        new: next line [gray levels], shape (n,).
        truth: displacement between them [px].
        metric: name of the distance measure.
        limit: largest shift [px].
    """
    n = len(new)
    shifts = np.arange(-limit, limit + 1)
    values = [
        float(_DISTANCES[metric](new[max(0, -s) : n - max(0, s)], old[max(0, s) : n + min(0, s)]))
        for s in shifts.tolist()
    ]
    return Curve(shifts.astype(np.float64), np.array(values, dtype=np.float64), truth)


def _draw(curves: Mapping[str, list[Curve]], metric: str) -> Figure:
    figure, grid = style.panels(
        f"Distance ({metric.replace('_', ' ')}) versus shift, 20 m/s at 45 deg (Figure 68); "
        "true displacement dashed, other positions in gray",
        len(curves),
        size=(11.0, 2.5 * len(curves) + 0.8),
        x="shift [px]",
        y="distance",
        sharex=True,
    )
    for axes, (kind, every) in zip(grid[:, 0], curves.items(), strict=True):
        for curve in every[1:4]:
            axes.plot(curve.shift, curve.distance, color=style.GRAY, linewidth=0.7, alpha=0.6)
        axes.plot(every[0].shift, every[0].distance, color=style.BLUE, linewidth=1.2)
        axes.axvline(every[0].truth, color=style.VERMILLION, linewidth=1.0, linestyle="--")
        axes.set_title(kind.replace("_", " "))
    return figure
