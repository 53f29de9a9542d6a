"""Contrast and correlation over the width of the field of view (Figure 69).

The camera moves at 20 m/s and 45 deg to its axis, with 2500 lines/s of 50 mm length. A wider field
of view averages the texture and has a larger overlap from line to line.
"""

import dataclasses
import math

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_loop.metrics import Metric
from omni_platform.quantities import FloatArray
from omni_platform.sensors import OVERLAP
from omni_studies.line_trials.options import LineOptions, kinds_option, pairs_option
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.errors import ERROR_COLUMNS
from omni_tools.line_trials.rig import View, camera, cameras, ground
from omni_tools.line_trials.trials import Motion, every_second, match, path

_LENGTH = 0.05  # m
# The widest view is half of the ground's period; a view of the whole period would repeat itself.
_SHAPES = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.5, 2.0)
_NARROW, _WIDE = 0.2, 1.0  # shapes of the two drawn pairs of lines
_SPEED, _ANGLE = 20.0, math.radians(45.0)


@dataclasses.dataclass(frozen=True)
class Trial:
    """Results of one width.

    Attributes:
        shape: width over length of the field of view.
        overlap: overlap of two lines, 0..1.
        contrast: standard deviation along the line without noise [gray levels].
        correlation: correlation at the true displacement, rounded, without noise.
        right_share: share of pairs with an error of at most a pixel.
        rmse: root mean square error of the refined displacements of these right pairs [px].
        errors: errors of all pairs, under `ERROR_COLUMNS`.
    """

    shape: float
    overlap: float
    contrast: float
    correlation: float
    right_share: float
    rmse: float
    errors: tuple[float, ...]


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
        metrics |= {
            f"contrast.{kind}_{100 * trial.shape:.0f}": Metric(
                trial.contrast, "1", note="gray levels"
            )
            for trial in trials
        }
        metrics |= {
            f"correlation.{kind}_{100 * trial.shape:.0f}": Metric(trial.correlation, "1")
            for trial in trials
        }
        metrics[f"right_share_from_60.{kind}"] = Metric(
            float(np.mean([trial.right_share for trial in enough])), "1"
        )
        metrics[f"rmse_px_growth.{kind}"] = Metric(
            enough[-1].rmse / enough[0].rmse,
            "1",
            note="widest over narrowest view with 60 % overlap",
        )
    study.figure("figure_69.png", _draw(found, options))
    header = (
        "ground", "width_mm", "width_over_length", "overlap", "contrast_gray_levels",
        "correlation", "right_share", "right_rmse_px", *ERROR_COLUMNS,
    )  # fmt: skip
    rows = (
        (
            kind, 1e3 * t.shape * _LENGTH, t.shape, t.overlap, t.contrast, t.correlation,
            t.right_share, t.rmse, *t.errors,
        )
        for kind, trials in found.items()
        for t in trials
    )  # fmt: skip
    study.table("contrast.csv", header, rows)
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
        right = matches.right
        trials.append(
            Trial(
                shape,
                Motion(view, _SPEED, _ANGLE).overlap,
                float(grays.std(axis=1).mean()),
                float(np.mean([_correlation(old, new, shift) for old, new in _pairs(grays)])),
                float(right.mean()),
                float(np.sqrt(np.mean(matches.error[right] ** 2))) if right.any() else math.nan,
                matches.error_values(view, _SPEED),
            )
        )
    return trials


def _pairs(grays: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    return list(zip(grays[::2], grays[1::2], strict=True))


def _correlation(old: FloatArray, new: FloatArray, shift: int) -> float:
    """Return Pearson's correlation, Eq. (81), of two lines at a positive shift."""
    return float(np.corrcoef(new[: len(new) - shift], old[shift:])[0, 1])


def _draw(found: dict[str, list[Trial]], options: Options) -> Figure:
    kind = next(iter(found))
    figure, grid = style.panels(
        f"Wider views see less contrast and share more of it (Figure 69; lines of {kind} without "
        "noise)",
        2,
        2,
        size=(13.0, 7.5),
        x=("place on the ground [mm]", "width over length [%]"),
        y="gray level less mean",
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
