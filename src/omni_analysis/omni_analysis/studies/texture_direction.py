"""Sideways motion over wood, parallel to its grain and across it (Figure 65).

12 m/s at 89 deg to the axis with 2500 lines/s, over the shapes of Figure 63. Parallel to the grain
the axis crosses the fibres and sees a bar code that hardly changes. Across the grain the axis lies
along the fibres: there is next to nothing to see, and what there is changes from line to line.
What the odometry makes of it, with the camera of the standard experiment, is counted too.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from omni_analysis.figures.style import save_figure
from omni_analysis.line_trials.options import noise_option
from omni_analysis.line_trials.tables import surface_metrics, write_surfaces
from omni_analysis.line_trials.texture_figures import draw_error_surfaces
from omni_analysis.line_trials.texture_options import (
    TextureOptions,
    grounds_of,
    grounds_option,
    runs_option,
)
from omni_analysis.line_trials.texture_trials import Eyes, Shifts, Sideways, look_at_shapes
from omni_analysis.line_trials.view_grid import as_map
from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.metrics import Metric
from omni_analysis.studies import StudyResult, StudyRun
from omni_sim.texture.texture import GroundTexture

_SPEED = 12.0  # [m/s]
_EXPERIMENT = "straight_line"  # lends its odometry
_BATCHES = 40
_TOLERANCE = 0.01  # of the speed, beyond which a velocity is wrong
# Direction of the axis, for a grain along x [rad].
_AXES = {"parallel": 0.5 * math.pi, "across": 0.0}
_TITLES = {"parallel": "moving parallel to x (the grain)", "across": "moving along y, across it"}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options(TextureOptions):
    """Grounds, their resolution, random places and seed."""

    ground: tuple[str, ...] = grounds_option("wood")
    runs: int = runs_option(2)
    noise: float = noise_option()


def run(options: Options, study: StudyRun) -> StudyResult:
    """Move in both directions; write figure, data and metrics."""
    grounds = grounds_of(options, study.experiments)
    metrics: dict[str, Metric] = {}
    surfaces: dict[tuple[str, str], list[Shifts]] = {}
    overlap = np.zeros((0, 0))
    for ground, texture in grounds.items():
        for direction, axis in _AXES.items():
            trial = Sideways(
                _SPEED, axis=axis, noise=options.noise, runs=options.runs, seed=options.seed
            )
            found, overlap = look_at_shapes(texture, trial)
            surfaces[ground, direction] = found
            case = f"{ground}_{direction}"
            metrics |= _odometry(texture, trial, study.experiments, case)
            metrics |= surface_metrics(case, found, overlap)
    rows = [
        {_TITLES[d]: as_map([f.mean_error for f in surfaces[ground, d]]) for d in _AXES}
        for ground in grounds
    ]
    figure = draw_error_surfaces(
        "12 m/s at 89 deg to the axis, 2500 lines/s, over the grain (Figure 65)",
        grounds,
        rows,
        overlap,
    )
    files = (
        save_figure(figure, study.folder / "figure_65.png"),
        write_surfaces(("ground", "direction"), surfaces, overlap, study.folder / "directions.csv"),
    )
    return StudyResult(metrics, files, tuple(_finding(ground, metrics) for ground in grounds))


def _odometry(
    texture: GroundTexture, trial: Sideways, library: ExperimentLibrary, case: str
) -> dict[str, Metric]:
    """Return how often the odometry measures, and how often wrongly."""
    variant = library.variants(_EXPERIMENT)[0]
    configuration = library.load(_EXPERIMENT, variant).odometry
    mounted = next(iter(configuration.sensors.values()))
    sensor = dataclasses.replace(mounted, x=0.0, y=0.0, heading_deg=0.0)
    eyes = Eyes({"one": sensor}, texture, trial.noise, trial.seed)
    readings = eyes.read("one", trial, configuration, _BATCHES)
    velocity = trial.speed * math.cos(trial.angle)
    wrong = [
        r for r in readings if r.measured and abs(r.velocity - velocity) > _TOLERANCE * trial.speed
    ]
    measured = sum(r.measured for r in readings)
    return {
        f"odometry_measured_share.{case}": Metric(measured / len(readings), "1"),
        f"odometry_wrong_share.{case}": Metric(len(wrong) / len(readings), "1", limit=0.0),
    }


def _finding(ground: str, metrics: dict[str, Metric]) -> str:
    parallel, across = (metrics[f"mean_error.{ground}_{d}"].value for d in _AXES)
    wrong, flagged = (
        100.0 * metrics[f"{name}.{ground}_across"].value
        for name in ("wrong_share", "flagged_share")
    )
    measured, mistaken = (
        metrics[f"odometry_{name}_share.{ground}_across"].value for name in ("measured", "wrong")
    )
    holds = "holds" if parallel <= 1.0 and across > 5.0 else "does not hold"
    return (
        f"{ground}: from 60 % overlap on, the mean error is {parallel:.2g} px moving parallel to x "
        f"and {across:.3g} px across; the claim that wood can be measured sideways along its grain "
        f"and not across it {holds}. Across, {flagged:.0f} % of the pairs are too unlike to be "
        f"used and {wrong:.0f} % alike by chance; of its batches of 10 ms the odometry calls "
        f"{100.0 * measured:.0f} % measured, wrongly in {100.0 * mistaken:.0f} %."
    )
