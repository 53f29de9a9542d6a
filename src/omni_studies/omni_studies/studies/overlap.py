"""Overlap and error of a camera that moves straight along its axis (Figures 54 and 62).

5 to 200 m/s over fields of view of 10 to 100 mm, 2500 lines/s, width 40 % of the length; and how
far a vehicle at 70 m/s, or slower, comes from one line to the next at any line rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from omni_figures.style import (
    GRAY,
    WHEEL_COLORS,
    panels,
    save_figure,
)
from omni_loop.metrics import Metric
from omni_studies.line_trials.figures import Scale, draw_error_maps, view_lengths
from omni_studies.line_trials.options import LineOptions, kinds_option, measure_on, pairs_option
from omni_studies.line_trials.tables import write_matches
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import View
from omni_tools.line_trials.trials import Matches, Motion

_SPEEDS = (5.0, *(float(speed) for speed in range(10, 201, 10)))  # m/s
_LENGTHS = tuple(0.01 * i for i in range(1, 11))  # m
_SHAPE = 0.4
_LIMIT = 0.5  # overlap at the shift limit n / k, k = 2
_RATES = np.geomspace(100.0, 1e5, 61)  # lines per second of Figure 54
_FAST = (1.0, 3.0, 10.0, 30.0, 70.0)  # m/s, of Figure 54
_FEW = 0.001  # wrong pairs with which the claim still holds


@dataclass(frozen=True, kw_only=True)
class Options(LineOptions):
    """Grounds, distance, pairs, noise and seed."""

    ground: tuple[str, ...] = kinds_option("stone", "cork")
    pairs: int = pairs_option(20)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Move over the grounds; write figure, data and metrics."""
    motions = [
        Motion(View(length=length, width=_SHAPE * length), speed, 0.0)
        for speed in _SPEEDS
        for length in _LENGTHS
    ]
    found = measure_on(options.kinds, motions, options)
    metrics: dict[str, Metric] = {}
    for kind, matches in found.items():
        # At the limit itself the rounding decides whether a shift can be found.
        within = [m for motion, m in zip(motions, matches, strict=True) if motion.overlap > _LIMIT]
        beyond = [m for motion, m in zip(motions, matches, strict=True) if motion.overlap < _LIMIT]
        metrics |= {
            f"wrong_share_within_limit.{kind}": Metric(_wrong(within), "1", at_most=_FEW),
            f"wrong_share_beyond_limit.{kind}": Metric(_wrong(beyond), "1"),
            f"off_by_one_share_within_limit.{kind}": Metric(
                _inexact(within) - _wrong(within), "1", note="before refinement, Eq. (84)"
            ),
            f"off_by_half_share_within_limit.{kind}": Metric(_off_by_half(within), "1"),
            f"rmse_px_within_limit.{kind}": Metric(_rmse(within), "1", note="refined, in pixels"),
        }
    # From line to line, of which the view must hold twice as much (k = 2).
    fastest = _FAST[-1]
    metrics |= {
        f"displacement_mm.{fastest:g}_{rate}": Metric(1e3 * fastest / rate, "mm")
        for rate in (100, 2500, 15600)
    }
    files = (
        save_figure(_draw(motions, found), study.folder / "figure_62.png"),
        save_figure(_draw_displacements(), study.folder / "figure_54.png"),
        write_matches(
            study.folder / "overlap.csv",
            ("ground",),
            motions,
            {(kind,): matches for kind, matches in found.items()},
        ),
    )
    misses = [k for k in found if metrics[f"wrong_share_within_limit.{k}"].value > _FEW]
    claim = "The dissertation's claim, correct up to the shift limit of 50 % and not beyond, "
    claim += f"does not hold on {', '.join(misses)}" if misses else "holds to within a pixel"
    neighbors = [
        f"{100.0 * metrics[f'off_by_one_share_within_limit.{k}'].value:.2g} % on {k}" for k in found
    ]
    return StudyResult(
        metrics,
        files,
        (
            f"{claim}: noise puts whole-pixel shifts on the neighboring pixel in "
            f"{', '.join(neighbors)}; refined displacements are within half a pixel in all but "
            + ", ".join(
                f"{100.0 * metrics[f'off_by_half_share_within_limit.{k}'].value:.2g} % on {k}"
                for k in found
            )
            + ".",
        ),
    )


def _wrong(matches: list[Matches]) -> float:
    """Return the share of pairs that are off by more than a pixel."""
    return 1.0 - float(np.mean(np.concatenate([m.right for m in matches])))


def _inexact(matches: list[Matches]) -> float:
    """Return the share of pairs with an error in whole pixels, Eq. (84)."""
    return float(np.mean(np.concatenate([m.pixel_error for m in matches]) != 0.0))


def _off_by_half(matches: list[Matches]) -> float:
    """Return the share of pairs whose refined displacement is off by more than half a pixel."""
    return float(np.mean(np.abs(np.concatenate([m.error for m in matches])) > 0.5))


def _rmse(matches: list[Matches]) -> float:
    return float(np.sqrt(np.mean(np.concatenate([m.error for m in matches]) ** 2)))


def _draw_displacements() -> Figure:
    figure, grid = panels(
        "From one line to the next, over the line rate (Figure 54)",
        size=(7.5, 5.0),
        x="lines per second",
        y="displacement [mm]",
    )
    axes = grid[0, 0]
    for speed, color in zip(_FAST, WHEEL_COLORS, strict=False):
        axes.loglog(_RATES, 1e3 * speed / _RATES, color=color, label=f"{speed:g} m/s")
    for length in (_LENGTHS[0], 0.05, _LENGTHS[-1]):
        limit = 1e3 * _LIMIT * length
        axes.axhline(limit, color=GRAY, linestyle="--", linewidth=0.9)
        axes.annotate(
            f"shift limit of {1e3 * length:g} mm", (_RATES[-1], limit), (-2, 3),
            textcoords="offset points", ha="right", color=GRAY,
        )  # fmt: skip
    axes.legend(loc="lower left")
    return figure


def _draw(motions: list[Motion], found: dict[str, list[Matches]]) -> Figure:
    shape = (len(_SPEEDS), len(_LENGTHS))
    return draw_error_maps(
        "Moving straight: mean error, and lines of equal overlap; shifts end at 50 % (Figure 62)",
        [
            {
                kind.replace("_", " "): np.array([m.mean_error for m in matches]).reshape(shape)
                for kind, matches in found.items()
            }
        ],
        np.array([motion.overlap for motion in motions]).reshape(shape),
        (view_lengths(_LENGTHS), Scale("speed [m/s]", _SPEEDS)),
        levels=(0.5, 0.8),
    )
