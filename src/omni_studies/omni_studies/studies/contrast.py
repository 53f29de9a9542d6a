"""Contrast and correlation as functions of the width of the field of view (Figure 69).

The camera moves with 20 m/s at 45 deg to its axis, with 2500 lines/s and a field of view 50 mm
long. A wider field of view averages more of the texture and has a larger overlap from line to line.
"""

import math
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_loop.metrics import Metric
from omni_platform.quantities import FloatArray
from omni_platform.sensors import OVERLAP
from omni_studies.line_trials.options import LineOptions, kinds_option, pairs_option
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import View, camera, cameras, ground
from omni_tools.line_trials.trials import Motion, every_second, match, path

_LENGTH = 0.05  # m
# The widest view is half of the ground's period; a view of the whole period would repeat itself.
_SHAPES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.5, 2.0)
_NARROW, _WIDE = 0.2, 1.0  # shapes of the views of the two drawn line pairs
_SPEED, _ANGLE = 20.0, math.radians(45.0)


class Trial(NamedTuple):
    """Results of one width.

    Attributes:
        shape: ratio of width to length of the field of view [1].
        overlap: overlap of two lines, 0 to 1.
        contrast: standard deviation along the line without noise [gray levels].
        correlation: correlation at the true displacement, rounded to pixels, without noise [1].
        right_share: share of pairs whose error is at most a pixel, 0 to 1.
        rmse: root mean square error of the refined displacements of these pairs [px].
    """

    shape: float
    overlap: float
    contrast: float
    correlation: float
    right_share: float
    rmse: float


class Options(LineOptions):
    """Grounds, similarity metric, pairs of lines, noise and seed."""

    ground: tuple[str, ...] = kinds_option("stone", "cork", "asphalt")
    pairs: int = pairs_option(100)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Render the grounds with all widths; write figure, data and metrics."""
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
    study.plot("figure_69", _draw(found, options))
    return study.result(metrics)


def _view(shape: float) -> View:
    return View(length=_LENGTH, width=shape * _LENGTH)


def _trials(kind: str, options: Options) -> list[Trial]:
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
        trials.append(
            Trial(
                shape,
                Motion(view, _SPEED, _ANGLE).overlap,
                float(grays.std(axis=1).mean()),
                float(np.mean([_correlation(*pair, shift) for pair in pairs])),
                float(right.mean()),
                float(np.sqrt(np.mean(matches.error[right] ** 2))) if right.any() else math.nan,
            )
        )
    return trials


def _correlation(old: FloatArray, new: FloatArray, shift: int) -> float:
    """Return Pearson's correlation, Eq. (81), of two lines at a positive shift."""
    return float(np.corrcoef(new[: len(new) - shift], old[shift:])[0, 1])


def _draw(found: dict[str, list[Trial]], options: Options) -> Figure:
    kind = next(iter(found))
    figure, grid = style.panels(
        f"Wider views have less contrast and more overlap (Figure 69; lines of {kind} without "
        "noise)",
        2,
        2,
        size=(13.0, 7.5),
        x=("position on the ground [mm]", "width over length [%]"),
        y="gray level minus mean",
    )
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
    correlation.set_ylabel("correlation (full),\nshare of right pairs (dotted)")
    contrast.legend(loc="upper right")
    return figure
