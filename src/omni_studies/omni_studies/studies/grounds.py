"""Pictures and spectra of the grounds; similarity and contrast of single line pairs.

``grounds`` shows 100 x 100 mm of each ground. For the generic camera (50 x 20 mm, 1024 px), it
computes the contrast of the lines, which average 20 mm across the axis, and the frequency below
which half of the power is found.

In the other studies, the camera moves with 20 m/s at 45 deg to its axis. The lines are 50 mm long
and are read with 2500 lines/s. In ``correlation_functions``, the camera has a field of view of 50 x
20 mm, 1024 px and noise of 5 gray levels. This study evaluates the distance measures with
`scipy.spatial.distance` at every shift, independently of the search in the odometry. ``contrast``
varies the width of the field of view. A wider field of view averages more of the texture, and
consecutive lines have a larger overlap.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy
from matplotlib.figure import Figure
from scipy.spatial import distance

from omni_core.quantities import FloatArray
from omni_core.sensors import OVERLAP, LineSensor
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_sim.camera.camera import LineCameraArray
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.texture.texture import GroundTexture
from omni_studies import line_options
from omni_studies.line_options import LineOptions, TextureOptions
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import View, camera, cameras, ground
from omni_tools.line_trials.trials import ViewMotion, every_second, match, path

CASES = {
    "grounds": "Pictures and spectra of all grounds, and the contrast in a wide view (Figures 59, "
    "67)",
    "correlation_functions": "Distance measures as functions of the shift, on three grounds "
    "(Figure 68)",
    "contrast": "Contrast and correlation as functions of the width of the field of view "
    "(Figure 69)",
}

_SPEED, _ANGLE = 20.0, math.radians(45.0)
_VIEW = View()
_RESOLUTIONS = (1024, 512, 256, 128)  # px, of section 4.5.1
_PAIRS_PER_RESOLUTION = 200
_PROMINENCE = 0.1  # lower limit on the depth of a minimum, as a share of the curve's range

_DISTANCES: Mapping[str, Callable[[FloatArray, FloatArray], float]] = {
    "pearson": distance.correlation,  # Eq. (81)
    "spearman": lambda x, y: float(distance.correlation(*map(scipy.stats.rankdata, (x, y)))),
    "cosine": distance.cosine,  # Eq. (83)
    "euclidean": lambda x, y: float(distance.euclidean(x, y)) / len(x),  # Eq. (79)
    "squared_euclidean": lambda x, y: float(distance.sqeuclidean(x, y)) / len(x),
    "manhattan": lambda x, y: float(distance.cityblock(x, y)) / len(x),  # Eq. (80)
}


_LENGTH = 0.05  # m
# The widest view is half of the ground's period; a view of the whole period would repeat itself.
_SHAPES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.5, 2.0)
_NARROW, _WIDE = 0.2, 1.0  # shapes of the views of the two drawn line pairs


@dataclasses.dataclass(frozen=True)
class Curve:
    """Distance measure of two camera lines as a function of the shift between them.

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
        """Number of minima whose depth is at least a tenth of the range of the curve's values."""
        prominence = _PROMINENCE * float(np.ptp(self.distance))
        padded = np.pad(-self.distance, 1, mode="minimum")  # the ends can be minima too
        return len(scipy.signal.find_peaks(padded, prominence=prominence)[0])

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


class GroundTrial(NamedTuple):
    """Results for one width of the field of view.

    Attributes:
        shape: ratio of width to length of the field of view [1].
        overlap: overlap of two lines, 0 to 1.
        contrast: standard deviation along the line without noise [gray levels].
        correlation: correlation at the true displacement, rounded to pixels, without noise [1].
        right_share: share of pairs whose error is at most one pixel, 0 to 1.
        rmse: root mean square error of the refined displacements of the pairs in `right_share`
            [px].
    """

    shape: float
    overlap: float
    contrast: float
    correlation: float
    right_share: float
    rmse: float


class Options(LineOptions):
    """Options of the studies: grounds, similarity metric, number of line pairs, noise and seed."""

    ground: tuple[str, ...] = line_options.kinds_option("stone", "cork", "asphalt")
    pairs: int = line_options.pairs_option(100)


class _CorrelationOptions(LineOptions):
    """Options of ``correlation_functions``: grounds, metric, line pairs, noise and seed."""

    ground: tuple[str, ...] = line_options.kinds_option("stone", "asphalt", "cork")
    pairs: int = line_options.pairs_option(20)
    noise: float = line_options.noise_option(5.0)


def resolution_metrics(kind: str, options: LineOptions) -> dict[str, Metric]:
    """Return the errors in the same motions of views that differ only in the number of pixels.

    Args:
        kind: kind of the ground.
        options: metric, line pairs, noise and seed.
    """
    metrics: dict[str, Metric] = {}
    for pixels in _RESOLUTIONS:
        view, generator = View(pixels=pixels), np.random.default_rng(options.seed)
        pairs = range(_PAIRS_PER_RESOLUTION)
        poses = np.concatenate([path(view, _SPEED, _ANGLE, 2, generator) for _ in pairs])
        lines = camera(view, ground(kind, options.texels), options.noise, options.seed)
        found = every_second(match(view, poses, lines.lines(poses, 0), options.metric))
        error = 1e3 * view.pitch * float(np.median(np.abs(found.error)))
        metrics[f"resolution_error.{kind}_{pixels}"] = Metric(error, "mm", note="median")
    return metrics


def _correlation_functions(options: LineOptions, study: StudyRun) -> StudyResult:
    """Evaluate the distance measures; write figure, data and metrics."""
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
        metrics |= resolution_metrics(kind, options)
    study.plot("figure_68", _draw_distances(curves, options.metric))
    return study.result(metrics)


def distances(old: FloatArray, new: FloatArray, truth: float, metric: str, limit: int) -> Curve:
    """Return a distance measure of two lines as a function of the shift.

    The measure is evaluated at all integer shifts up to `limit`. A measure that is a sum over
    pixels is divided by the number of overlapping pixels.

    Args:
        old: first line [gray levels], shape (n,).
        new: next line [gray levels], shape (n,).
        truth: true displacement between the lines, which is only stored in the result [px].
        metric: name of the distance measure.
        limit: limit on the magnitude of the shift [px].
    """
    n = len(new)
    shifts = np.arange(-limit, limit + 1)
    values = [
        float(_DISTANCES[metric](new[max(0, -s) : n - max(0, s)], old[max(0, s) : n + min(0, s)]))
        for s in shifts.tolist()
    ]
    return Curve(shifts.astype(np.float64), np.array(values, dtype=np.float64), truth)


def _draw_distances(curves: Mapping[str, list[Curve]], metric: str) -> Figure:
    title = (
        f"Distance ({metric.replace('_', ' ')}) versus shift, 20 m/s at 45 deg (Figure 68); "
        "true displacement dashed, other positions in gray"
    )
    size, x = (11.0, 2.5 * len(curves) + 0.8), "shift [px]"
    figure, grid = style.panels(title, len(curves), size=size, x=x, y="distance", sharex=True)
    for axes, (kind, every) in zip(grid[:, 0], curves.items(), strict=True):
        for curve in every[1:4]:
            axes.plot(curve.shift, curve.distance, color=style.GRAY, linewidth=0.7, alpha=0.6)
        axes.plot(every[0].shift, every[0].distance, color=style.BLUE, linewidth=1.2)
        axes.axvline(every[0].truth, color=style.VERMILLION, linewidth=1.0, linestyle="--")
        axes.set_title(kind.replace("_", " "))
    return figure


def run(options: LineOptions, study: StudyRun) -> StudyResult:
    """Measure contrast and displacement for all widths; write figure, data and metrics."""
    found = {kind: _trials(kind, options) for kind in options.kinds}
    metrics: dict[str, Metric] = {}
    for kind, trials in found.items():
        enough = [trial for trial in trials if trial.overlap >= OVERLAP]
        for trial in trials:
            case = f"{kind}_{100 * trial.shape:.0f}"
            metrics[f"contrast.{case}"] = Metric(trial.contrast, "1", note="gray levels")
            metrics[f"correlation.{case}"] = Metric(trial.correlation, "1")
        share, growth = np.mean([t.right_share for t in enough]), enough[-1].rmse / enough[0].rmse
        note = "ratio of the widest to the narrowest view with 60 % overlap"
        metrics[f"right_share_from_60.{kind}"] = Metric(float(share), "1")
        metrics[f"rmse_px_growth.{kind}"] = Metric(growth, "1", note=note)
    study.plot("figure_69", _draw_contrast(found, options))
    return study.result(metrics)


def _trials(kind: str, options: LineOptions) -> list[GroundTrial]:
    views = [_view(shape) for shape in _SHAPES]
    texture = ground(kind, options.texels)
    eyes = cameras(views, texture, options.noise, options.seed)
    trials = []
    for shape, view, eye in zip(_SHAPES, views, eyes, strict=True):
        generator = np.random.default_rng(options.seed)
        poses = np.concatenate(
            [path(view, _SPEED, _ANGLE, 2, generator) for _ in range(options.pairs)]
        )
        grays = eye.grays(poses).astype(np.float64)
        matches = every_second(match(view, poses, eye.lines(poses, 0), options.metric))
        shift = round(float(matches.truth[0]))
        right, pairs = matches.right, zip(grays[::2], grays[1::2], strict=True)
        overlap = ViewMotion(view, _SPEED, _ANGLE).overlap
        contrast = float(grays.std(axis=1).mean())
        correlation = float(np.mean([_correlation(*pair, shift) for pair in pairs]))
        error = float(np.sqrt(np.mean(matches.error[right] ** 2))) if right.any() else math.nan
        trials.append(
            GroundTrial(shape, overlap, contrast, correlation, float(right.mean()), error)
        )
    return trials


def _view(shape: float) -> View:
    return View(length=_LENGTH, width=shape * _LENGTH)


def _correlation(old: FloatArray, new: FloatArray, shift: int) -> float:
    """Return Pearson's correlation, Eq. (81), of two lines at a positive shift."""
    return float(np.corrcoef(new[: len(new) - shift], old[shift:])[0, 1])


def _draw_contrast(found: dict[str, list[GroundTrial]], options: LineOptions) -> Figure:
    kind = next(iter(found))
    title = (
        f"Wider views have less contrast and more overlap (Figure 69; lines of {kind} without "
        "noise)"
    )
    x = ("position on the ground [mm]", "width over length [%]")
    y = "gray level minus mean"
    figure, grid = style.panels(title, 2, 2, size=(13.0, 7.5), x=x, y=y)
    for row, (shape, name) in enumerate(((_WIDE, "a"), (_NARROW, "b"))):
        view = _view(shape)
        eye = camera(view, ground(kind, options.texels), 0.0, options.seed)
        poses = path(view, _SPEED, _ANGLE, 2, np.random.default_rng(options.seed))
        old, new = eye.grays(poses).astype(np.float64)
        place = 1e3 * view.pitch * np.arange(view.pixels)
        step = 1e3 * float(poses[1, 0] - poses[0, 0])
        axes = grid[row, 0]
        axes.plot(place, old - old.mean(), color=style.GRAY, linewidth=1.2, label="older")
        moved = place + step
        axes.plot(moved, new - old.mean(), color=style.BLUE, linewidth=1.2, label="newer, moved")
        axes.set_title(f"{name}) {1e3 * view.length:g} x {1e3 * view.width:g} mm")
        axes.set_ylim(-45.0, 45.0)
        if row == 0:
            axes.legend(loc="upper right", ncols=2)
    contrast, correlation = grid[:, 1]
    for (name, trials), color in zip(found.items(), style.WHEEL_COLORS, strict=False):
        shapes = [100.0 * trial.shape for trial in trials]
        contrast.loglog(shapes, [t.contrast for t in trials], "o-", color=color, label=name)
        correlation.semilogx(shapes, [t.correlation for t in trials], "o-", color=color)
        correlation.semilogx(shapes, [t.right_share for t in trials], "s:", color=color, mfc="w")
    contrast.axhline(options.noise, color=style.GRAY, linestyle="--", linewidth=1.0)
    style.note(contrast, "noise", (100.0 * _SHAPES[0], options.noise), (0, 3), color=style.GRAY)
    contrast.set_ylabel("contrast [gray levels]")
    correlation.set_ylabel("correlation (full),\nshare of correct pairs (dotted)")
    contrast.legend(loc="upper right")
    return figure


_DECADES = (0.02, 10.0)  # range of frequencies in the figure [cycles per mm]
_PHOTOGRAPHED = {"asphalt": (1.9, 3.1), "worn_asphalt": (1.9, 3.1)}
"""Lowest and highest contrast of photographs of asphalt, averaged over 20 mm [gray levels]."""

_GROUNDS = (
    "cork", "asphalt", "stone", "wood", "plastic", "metal", "walking_tile", "dry_earth",
    "worn_asphalt", "concrete", "wet_concrete", "gravel", "sand", "grass", "bark", "brick",
    "cobble", "planks", "carpet", "terrazzo", "slabs", "tile", "wet_asphalt", "sealed_concrete",
    "epoxy", "flake_epoxy",
)  # fmt: skip


class _Pictures(TextureOptions):
    """Options of the study ``grounds``: grounds, their resolution and the seed of the positions."""

    ground: tuple[str, ...] = line_options.grounds_option(*_GROUNDS)


@dataclasses.dataclass(frozen=True)
class Appearance:
    """Appearance of a ground: picture, contrast and spectrum.

    Attributes:
        patch: gray levels of the section that is shown, shape (k, k).
        contrast: mean standard deviation along the lines of the camera [gray levels].
        frequency: frequencies of the spectrum [cycles per mm], shape (f,).
        spectrum: mean power density of the lines [gray levels^2 mm], shape (f,).
        median_frequency: frequency below which half of the power is found [cycles per mm].
        texels_per_pixel: number of texels of the ground per pixel of the camera.
    """

    patch: FloatArray
    contrast: float
    frequency: FloatArray
    spectrum: FloatArray
    median_frequency: float
    texels_per_pixel: float


def _grounds(options: _Pictures, study: StudyRun) -> StudyResult:
    """Render the grounds; write a figure with a picture of each, and a figure of the spectra."""
    appearances = {
        name: _appearance(ground, options.seed)
        for name, ground in line_options.grounds_of(options, study.experiments).items()
    }
    metrics: dict[str, Metric] = {}
    for name, appearance in appearances.items():
        note = "gray levels, after a box of 20 mm"
        if name in _PHOTOGRAPHED:
            note += "; photographed {:g} to {:g}".format(*_PHOTOGRAPHED[name])
        metrics |= {
            f"contrast.{name}": Metric(appearance.contrast, "1", note=note),
            f"median_frequency.{name}": Metric(appearance.median_frequency, "1/mm"),
            f"texels_per_pixel.{name}": Metric(appearance.texels_per_pixel, "1"),
        }
    study.figure("grounds.png", _plate(appearances))
    study.plot("spectra", _spectra(appearances))
    return study.result(metrics)


def _appearance(
    texture: GroundTexture, seed: int, lines: int = 200, shown: float = 0.1, dots: int = 480
) -> Appearance:
    """Return a picture, the contrast and the spectrum of a ground.

    Args:
        texture: the ground.
        seed: seed of the positions of the lines.
        lines: number of lines.
        shown: edge length of the picture on the ground [m].
        dots: edge length of the picture in the figure [px].
    """
    sensor = LineSensor(x=0.0, y=0.0, heading_deg=0.0)
    cameras = LineCameraArray(
        {"eye": sensor}, texture, CameraConfiguration(noise=0.0), np.random.SeedSequence(seed)
    )
    generator = np.random.default_rng(seed)
    places = generator.uniform(0.0, texture.size, (lines, 2))
    poses = np.column_stack((places, generator.uniform(0.0, 2.0 * math.pi, lines)))
    gray = cameras.render({"eye": poses})["eye"].astype(np.float64)
    gray -= gray.mean(axis=1, keepdims=True)
    pitch = 1e3 * sensor.pixel_pitch
    window = np.hanning(sensor.pixels)
    power = np.abs(np.fft.rfft(gray * window, axis=1)) ** 2 * pitch / np.sum(window**2)
    spectrum = np.asarray(power.mean(axis=0)[1:], np.float64)
    frequency = np.asarray(np.fft.rfftfreq(sensor.pixels, pitch)[1:], np.float64)
    share = np.cumsum(spectrum) / np.sum(spectrum)
    block = max(1, round(shown / texture.texel / dots))
    count = block * max(1, round(shown / texture.texel / block))
    patch = np.tile(texture.gray, (1 + count // len(texture.gray),) * 2)[:count, :count]
    picture = patch.reshape(count // block, block, -1, block).mean(axis=(1, 3))
    look = np.asarray(picture, np.float64), float(gray.std(axis=1).mean())
    median = float(frequency[np.searchsorted(share, 0.5)])
    return Appearance(*look, frequency, spectrum, median, sensor.pixel_pitch / texture.texel)


def _plate(appearances: dict[str, Appearance]) -> Figure:
    title = "Grounds, 100 x 100 mm each (Figures 59, 67), and the contrast of lines 20 mm wide"
    figure, panels = style.tiles(title, len(appearances), 6, size=(2.2, 2.65))
    for axes, (name, appearance) in zip(panels, appearances.items(), strict=True):
        axes.set_axis_off()
        axes.imshow(appearance.patch, cmap="gray", vmin=0.0, vmax=255.0, origin="lower")
        axes.set_title(f"{name.replace('_', ' ')}: {appearance.contrast:.1f}", pad=3.0)
    return figure


def _spectra(appearances: dict[str, Appearance]) -> Figure:
    title = (
        "Spectra of lines 20 mm wide; dashed: noise of 1 gray level; vertical: half of the power"
    )
    look: dict[str, Any] = {"x": "cycles per mm", "y": "levels² mm", "sharex": True, "sharey": True}
    figure, panels = style.tiles(title, len(appearances), 6, size=(2.3, 2.0), **look)
    for axes, (name, appearance) in zip(panels, appearances.items(), strict=True):
        axes.loglog(appearance.frequency, appearance.spectrum, color=style.BLUE, linewidth=1.0)
        axes.axhline(
            0.5 / appearance.frequency[-1], color=style.GRAY, linestyle="--", linewidth=0.9
        )
        axes.axvline(appearance.median_frequency, color=style.VERMILLION, linewidth=0.9)
        axes.set_xlim(*_DECADES)
        axes.set_title(name.replace("_", " "), pad=3.0)
    return figure


OPTIONS = {"correlation_functions": _CorrelationOptions, "grounds": _Pictures}
RUNS = {"correlation_functions": _correlation_functions, "grounds": _grounds}
