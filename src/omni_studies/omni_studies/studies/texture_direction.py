"""Sideways motion over wood, parallel to its grain and across it (Figure 65).

12 m/s at 89 deg to the axis with 2500 lines/s, over the shapes of Figure 63. Parallel to the grain
the axis crosses the fibres and sees a bar code that hardly changes. Across the grain the axis is
along the fibres: there is next to nothing to see, and what there is changes from line to line.
What the odometry makes of it, with the camera of the standard experiment, is counted too.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from linescan_odometry.sensor import SensorOdometry
from omni_figures.style import save_figure
from omni_loop.experiment import ExperimentLibrary
from omni_loop.metrics import Metric
from omni_sim.texture.texture import GroundTexture
from omni_studies.line_trials.figures import draw_error_maps
from omni_studies.line_trials.options import (
    TextureOptions,
    grounds_of,
    grounds_option,
    noise_option,
    runs_option,
)
from omni_studies.line_trials.tables import surface_metrics, write_matches
from omni_studies.line_trials.view_grid import ANGLE, GROUP, SPEED, as_map, sideways_motions
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import Rig, View
from omni_tools.line_trials.trials import Matches, measure

_CAMERA = "camera"
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
    motions = sideways_motions()
    metrics: dict[str, Metric] = {}
    cases: dict[tuple[str, ...], list[Matches]] = {}
    for ground, texture in grounds.items():
        for direction, axis in _AXES.items():
            found = measure(
                sideways_motions(axis),
                texture,
                GROUP,
                options.noise,
                options.seed,
                runs=options.runs,
            )
            cases[ground, direction] = found
            case = f"{ground}_{direction}"
            metrics |= _odometry(texture, axis, options, study.experiments, case)
            metrics |= surface_metrics(case, motions, found)
    figure = draw_error_maps(
        "12 m/s at 89 deg to the axis, 2500 lines/s, over the grain (Figure 65)",
        [{_TITLES[d]: as_map([m.mean_error for m in cases[g, d]]) for d in _AXES} for g in grounds],
        as_map([motion.overlap for motion in motions]),
        grounds=grounds,
    )
    files = (
        save_figure(figure, study.folder / "figure_65.png"),
        write_matches(study.folder / "directions.csv", ("ground", "direction"), motions, cases),
    )
    return StudyResult(metrics, files, tuple(_finding(ground, metrics) for ground in grounds))


def _odometry(
    texture: GroundTexture, axis: float, options: Options, library: ExperimentLibrary, case: str
) -> dict[str, Metric]:
    """Return how often the odometry measures, and how often wrongly."""
    variant = library.variants(_EXPERIMENT)[0]
    configuration = library.load(_EXPERIMENT, variant).odometry
    sensor = View.of(next(iter(configuration.sensors.values()))).mounted()
    odometry = SensorOdometry(sensor, configuration)
    rig = Rig({_CAMERA: sensor}, texture, options.noise, options.seed)
    start = np.append(np.random.default_rng(options.seed).uniform(0.0, texture.size, 2), axis)
    twist = SPEED * np.array([math.cos(ANGLE), math.sin(ANGLE), 0.0])
    readings = [odometry.update(seen[_CAMERA]) for seen in rig.drive(start, twist, _BATCHES)]
    measured = [reading for reading in readings if reading.measured]
    wrong = [r for r in measured if abs(r.velocity - twist[0]) > _TOLERANCE * SPEED]
    return {
        f"odometry_measured_share.{case}": Metric(len(measured) / len(readings), "1"),
        f"odometry_wrong_share.{case}": Metric(len(wrong) / len(readings), "1", at_most=0.0),
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
