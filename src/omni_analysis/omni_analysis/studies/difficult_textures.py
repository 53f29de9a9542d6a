"""Sideways motion over metal and plastic, which show too little detail (Figure 66).

12 m/s at 89 deg to the axis with 2500 lines/s, over the shapes of Figure 63, without noise and with
noise of 1 and 5 grey levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omni_analysis.figures.style import save_figure
from omni_analysis.line_trials.tables import surface_metrics, write_surfaces
from omni_analysis.line_trials.texture_figures import draw_error_surfaces
from omni_analysis.line_trials.texture_options import (
    TextureOptions,
    grounds_of,
    grounds_option,
    runs_option,
)
from omni_analysis.line_trials.texture_trials import Shifts, Sideways, look_at_shapes
from omni_analysis.line_trials.view_grid import as_map
from omni_analysis.loop.metrics import Metric
from omni_analysis.studies import StudyResult, StudyRun

_SPEED = 12.0  # [m/s]
_NOISES = (0.0, 1.0, 5.0)  # [grey levels]


@dataclass(frozen=True, kw_only=True)
class Options(TextureOptions):
    """Grounds, their resolution, random places and seed."""

    ground: tuple[str, ...] = grounds_option("metal", "plastic")
    runs: int = runs_option(2)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Move over the grounds with each noise; write figure, data and metrics."""
    grounds = grounds_of(options, study.experiments)
    metrics: dict[str, Metric] = {}
    surfaces: dict[tuple[str, str], list[Shifts]] = {}
    overlap = np.zeros((0, 0))
    for ground, texture in grounds.items():
        for noise in _NOISES:
            trial = Sideways(_SPEED, noise=noise, runs=options.runs, seed=options.seed)
            found, overlap = look_at_shapes(texture, trial)
            surfaces[ground, f"{noise:g}"] = found
            metrics |= surface_metrics(f"{ground}_noise_{noise:g}", found, overlap)
    rows = [
        {
            f"noise of {noise:g} grey levels": as_map(
                [f.mean_error for f in surfaces[ground, f"{noise:g}"]]
            )
            for noise in _NOISES
        }
        for ground in grounds
    ]
    figure = draw_error_surfaces(
        "12 m/s at 89 deg to the axis, 2500 lines/s, over grounds of little detail (Figure 66)",
        grounds,
        rows,
        overlap,
    )
    files = (
        save_figure(figure, study.folder / "figure_66.png"),
        write_surfaces(("ground", "noise"), surfaces, overlap, study.folder / "difficult.csv"),
    )
    return StudyResult(metrics, files, tuple(_finding(ground, metrics) for ground in grounds))


def _finding(ground: str, metrics: dict[str, Metric]) -> str:
    clean, faint, noisy = (metrics[f"mean_error.{ground}_noise_{n:g}"].value for n in _NOISES)
    wrong = 100.0 * metrics[f"wrong_share.{ground}_noise_5"].value
    holds = "holds" if clean <= 1.0 and noisy > 5.0 else "does not hold"
    return (
        f"{ground}: from 60 % overlap on, the mean error is {clean:.2g} px without noise, "
        f"{faint:.3g} px with noise of 1 and {noisy:.3g} px with noise of 5 grey levels, of which "
        f"{wrong:.0f} % of the pairs would be taken for measured; the claim that it can be "
        f"measured only without noise {holds}."
    )
