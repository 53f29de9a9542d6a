"""Errors of one line camera in straight motion, as functions of speed, field of view and ground.

Every motion is uniform, and the camera exposes 2500 lines/s. Sideways motion is a motion at 12 m/s
in a direction of 89 deg to the camera's axis. ``overlap`` also draws the displacement of a vehicle
between two lines as a function of the line rate. ``texture_direction`` also counts the batches that
the odometry measures with the camera of the standard experiment. In motion along the fibers of
wood, the lines hardly change. In motion across the fibers, the contrast along the axis is low and
the lines change quickly.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from linescan_odometry.matching.search import make_search
from linescan_odometry.sensor import SensorOdometry
from omni_core.configuration import parameter
from omni_core.quantities import FloatArray
from omni_core.sensors import OVERLAP
from omni_runs.experiment import ExperimentLibrary
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_sim.texture.texture import GroundTexture
from omni_studies import line_options
from omni_studies.error_map import Scale, draw_error_maps, view_lengths
from omni_studies.line_options import LineOptions, TextureOptions
from omni_studies.line_trials import view_grid
from omni_studies.line_trials.view_grid import GROUP, sideways_motions
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import Rig, View, ground
from omni_tools.line_trials.trials import Matches, SearchChoice, ViewMotion, measure, undetected

CASES = {
    "overlap": "Overlap and error of a camera that moves along its axis at 5 to 200 m/s, with "
    "fields of view of 10 to 100 mm (Figures 54 and 62)",
    "field_of_view": "Error of sideways motion over the two dimensions of the field of view "
    "(Figures 63 and 64)",
    "median": "Raw errors of sideways motion, and those of the median of ten consecutive "
    "displacements (Figure 71)",
    "texture_direction": "Sideways motion over wood, parallel to its grain and across it "
    "(Figure 65)",
    "difficult_textures": "Sideways motion over metal and plastic, which show too little detail, "
    "without noise and with noise of 1 and 5 gray levels (Figure 66)",
}

_SPEEDS = (5.0, *(float(speed) for speed in range(10, 201, 10)))  # m/s, of Figure 62
_LENGTHS = tuple(0.01 * i for i in range(1, 11))  # m, of Figure 62
_SHIFT_LIMIT = 0.5  # overlap at the shift limit n / k, k = 2
_NOISES = (0.0, 1.0, 5.0)  # gray levels, of Figure 66
_PRIOR_OVERLAP = 0.4  # overlap at which the prior is shown [1]
_PRIOR_WEIGHT = 1.0  # weight of the prior: twice the distance at the largest change [1]
_LOWEST_OVERLAP = 0.15  # of the medians whose errors are counted by size (section 4.6)

Found = list[tuple[ViewMotion, Matches]]


class Options(LineOptions):
    """Options of the studies: grounds, similarity metric, number of line pairs, noise and seed."""

    ground: tuple[str, ...] = line_options.kinds_option("stone", "cork")
    pairs: int = line_options.pairs_option(20)


class _Views(LineOptions):
    """Options of ``field_of_view``."""

    ground: tuple[str, ...] = line_options.kinds_option(
        "stone", "cork", "asphalt", "walking_tile", "dry_earth", "wood"
    )
    pairs: int = line_options.pairs_option(80)


class _Medians(LineOptions):
    """Options of ``median``."""

    ground: tuple[str, ...] = line_options.kinds_option("walking_tile", "stone", "cork")
    pairs: int = line_options.pairs_option(60, fewest=GROUP)


class _Directions(TextureOptions):
    """Options of ``texture_direction``."""

    ground: tuple[str, ...] = line_options.grounds_option("wood")
    noise: float = line_options.noise_option()
    drives: int = parameter(10, minimum=1, maximum=1000)
    """number of random drives of the odometry, each of 40 batches"""


class _Difficult(TextureOptions):
    """Options of ``difficult_textures``."""

    ground: tuple[str, ...] = line_options.grounds_option("metal", "plastic")


OPTIONS = {
    "field_of_view": _Views,
    "median": _Medians,
    "texture_direction": _Directions,
    "difficult_textures": _Difficult,
}


@dataclasses.dataclass(frozen=True)
class _Condition:
    """Condition under which the camera moves over every ground.

    Attributes:
        title: title of the maps.
        axis: direction of the camera's axis on the ground [rad].
        noise: standard deviation of the noise [gray levels]; None for the value in the options.
    """

    title: str = ""
    axis: float = 0.0
    noise: float | None = None


@dataclasses.dataclass(frozen=True)
class _Case:
    """Metrics and figure of a case.

    Attributes:
        figure: number of the figure in the dissertation.
        title: title of the figure.
        metrics: function that returns the metrics of a case from its name and the matches of each
            motion.
        conditions: conditions under which the camera moves over every ground, keyed by name.
        columns: number of maps per row; None for the number of grounds.
    """

    figure: int
    title: str
    metrics: Callable[[str, Found], dict[str, Metric]]
    conditions: Mapping[str, _Condition] = dataclasses.field(
        default_factory=lambda: {"": _Condition()}
    )
    columns: int | None = None


def run(options: Any, study: StudyRun) -> StudyResult:
    """Simulate the motions under every condition; write figures, data and metrics."""
    case = _STUDIES[study.case]
    textures = _textures(options, study.experiments)
    metrics: dict[str, Metric] = {}
    found: dict[tuple[str, ...], list[Matches]] = {}
    maps: list[tuple[str, FloatArray]] = []
    motions = _motions(study.case)
    shape = (-1, len(_LENGTHS if study.case == "overlap" else view_grid.LENGTHS))
    for name, texture in textures.items():
        for word, condition in case.conditions.items():
            key = (name, word) if word else (name,)
            matches = measure(
                _motions(study.case, condition.axis),
                texture,
                getattr(options, "pairs", GROUP),
                options.noise if condition.noise is None else condition.noise,
                options.seed,
                getattr(options, "metric", "pearson"),
                getattr(options, "runs", 1),
            )
            found[key] = matches
            metrics |= case.metrics("_".join(key), list(zip(motions, matches, strict=True)))
            title = condition.title or name.replace("_", " ")
            filtered = study.case == "median"
            errors = [m.mean_error for m in matches]
            maps.append((f"{title}, raw" if filtered else title, np.reshape(errors, shape)))
            if filtered:
                errors = [float(np.mean(np.abs(m.median_error(GROUP)))) for m in matches]
                maps.append((f"{title}, median of {GROUP}", np.reshape(errors, shape)))
            if study.case == "median":
                metrics |= _prior_metrics(name, texture, options)
            if study.case == "texture_direction":
                metrics |= _odometry(texture, condition.axis, options, study.experiments, key)
    columns = case.columns or len(textures)
    look: dict[str, Any] = {}
    if isinstance(options, TextureOptions):
        look["grounds"] = textures
    if study.case == "overlap":
        look["scales"] = view_lengths(_LENGTHS), Scale("speed [m/s]", _SPEEDS)
        look["levels"] = (_SHIFT_LIMIT, 0.8)
    figure = draw_error_maps(
        f"{case.title} (Figure {case.figure})",
        [dict(maps[i : i + columns]) for i in range(0, len(maps), columns)],
        np.reshape([motion.overlap for motion in motions], shape),
        **look,
    )
    headers = ("ground", "condition")[: len(next(iter(found)))]
    study.figure(f"figure_{case.figure}.png", figure)
    study.table(f"{study.case}.csv", *view_grid.matches_table(headers, motions, found), digits=6)
    if study.case == "overlap":
        figure, displacements = _line_rates()
        metrics |= displacements
        study.figure("figure_54.png", figure)
    return study.result(metrics)


def _textures(options: Any, library: ExperimentLibrary) -> Mapping[str, GroundTexture]:
    if isinstance(options, TextureOptions):
        return line_options.grounds_of(options, library)
    return {kind: ground(kind, options.texels) for kind in options.kinds}


def _motions(case: str, axis: float = 0.0) -> list[ViewMotion]:
    if case != "overlap":
        return sideways_motions(axis)
    return [
        ViewMotion(View(length=length, width=0.4 * length), speed, 0.0)
        for speed in _SPEEDS
        for length in _LENGTHS
    ]


def _straight_metrics(case: str, found: Found) -> dict[str, Metric]:
    # Motions exactly at the limit are omitted, because rounding decides whether their shift is
    # found.
    within = [matches for motion, matches in found if motion.overlap > _SHIFT_LIMIT]
    beyond = [matches for motion, matches in found if motion.overlap < _SHIFT_LIMIT]
    wrong, wrong_beyond = (
        1.0 - float(np.mean(np.concatenate([m.right for m in some]))) for some in (within, beyond)
    )
    inexact = float(np.mean(np.concatenate([m.pixel_error for m in within]) != 0.0))
    error = np.concatenate([m.error for m in within])
    values = {
        "wrong_share_within_limit": (wrong, ""),
        "wrong_share_beyond_limit": (wrong_beyond, ""),
        "off_by_one_share_within_limit": (inexact - wrong, "before refinement, Eq. (84)"),
        "off_by_half_share_within_limit": (float(np.mean(abs(error) > 0.5)), ""),
        "rmse_px_within_limit": (float(np.sqrt(np.mean(error**2))), "refined, in pixels"),
    }
    return {f"{name}.{case}": Metric(v, "1", note=note) for name, (v, note) in values.items()}


def _line_rates() -> tuple[Figure, dict[str, Metric]]:
    """Draw the displacement of a vehicle between two lines versus the line rate (Figure 54).

    Some displacements are also returned as metrics.
    """
    rates, speeds = np.geomspace(100.0, 1e5, 61), (1.0, 3.0, 10.0, 30.0, 70.0)
    title = "From one line to the next, over the line rate (Figure 54)"
    x, y = "lines per second", "displacement [mm]"
    figure, ((axes,),) = style.panels(title, size=(7.5, 5.0), x=x, y=y)
    for speed, color in zip(speeds, style.WHEEL_COLORS, strict=False):
        axes.loglog(rates, 1e3 * speed / rates, color=color, label=f"{speed:g} m/s")
    for length in (_LENGTHS[0], 0.05, _LENGTHS[-1]):
        limit = 1e3 * _SHIFT_LIMIT * length
        axes.axhline(limit, color=style.GRAY, linestyle="--", linewidth=0.9)
        words = f"shift limit of {1e3 * length:g} mm"
        style.note(axes, words, (rates[-1], limit), (-2, 3), ha="right", color=style.GRAY)
    axes.legend(loc="lower left")
    return figure, {
        f"displacement_mm.{speeds[-1]:g}_{rate}": Metric(1e3 * speeds[-1] / rate, "mm")
        for rate in (100, 2500, 15600)
    }


def _view_metrics(case: str, found: Found) -> dict[str, Metric]:
    overlap = np.array([motion.overlap for motion, _ in found])
    right = np.array([float(np.mean(m.right)) for _, m in found])
    exact = np.array([float(np.mean(m.pixel_error == 0.0)) for _, m in found])
    enough = overlap >= OVERLAP
    needed = {
        "overlap_needed": (right, "95 % of pairs right"),
        # The dissertation uses a mean over pairs where this metric uses a share of pairs.
        "overlap_needed_mean": ([m.mean_error <= 1.0 for _, m in found], "mean error of a pixel"),
    }
    if len(found[0][1].shift) >= GROUP:
        medians = [m.right_medians(GROUP) for _, m in found]
        needed["overlap_needed_median_10"] = (medians, "95 % of medians right")
    metrics = {
        f"{quantity}.{case}": Metric(
            view_grid.needed_overlap(overlap, np.array(shares)), "1", reference=OVERLAP, note=note
        )
        for quantity, (shares, note) in needed.items()
    }
    metrics |= {
        f"right_share_from_60.{case}": Metric(float(right[enough].mean()), "1"),
        f"exact_share_from_60.{case}": Metric(float(exact[enough].mean()), "1"),
        f"right_share_below_60.{case}": Metric(float(right[~enough].mean()), "1"),
    }
    for length in view_grid.LENGTHS:
        own = [(motion, m) for motion, m in found if motion.view.length == length]
        motion, matches = min(own, key=lambda each: abs(each[0].overlap - 0.8))
        if abs(motion.overlap - 0.8) < 0.05:
            error = matches.error[matches.right]
            rmse = math.sqrt(float(np.mean(error**2))) if len(error) else math.nan
            metrics[f"rmse_mm.{case}_{1e3 * length:.0f}"] = Metric(
                1e3 * motion.view.pitch * rmse,
                "mm",
                note="of correct pairs, refined, at 80 % overlap, by the length of the view",
            )
    return metrics


def _median_metrics(case: str, found: Found) -> dict[str, Metric]:
    raw = np.array([np.mean(m.right) for _, m in found])
    filtered = np.array([m.right_medians(GROUP) for _, m in found])
    points = (raw >= 0.6) & (raw < 1.0)  # views in which single pairs fail
    corrected = float(np.mean(filtered[points] == 1.0)) if points.any() else 1.0
    low = [m for motion, m in found if _LOWEST_OVERLAP <= motion.overlap < OVERLAP]
    error = np.abs(np.concatenate([m.median_error(GROUP) for m in low]))
    near, far = (float(np.mean(some)) for some in ((error > 1) & (error <= 5), error > 5))
    return {
        f"right_share_raw.{case}": Metric(float(raw.mean()), "1"),
        f"right_share_median.{case}": Metric(float(filtered.mean()), "1"),
        f"views_with_point_errors.{case}": Metric(float(points.sum()), "1"),
        f"corrected_share.{case}": Metric(corrected, "1"),
        f"median_off_2_to_5_share.{case}": Metric(near, "1", note="from 15 to 60 % overlap"),
        f"median_off_over_5_share.{case}": Metric(far, "1", note="from 15 to 60 % overlap"),
    }


def _prior_metrics(case: str, texture: GroundTexture, options: LineOptions) -> dict[str, Metric]:
    """Return the share of right pairs without and with the prior of section 4.6.

    The camera moves sideways, and consecutive lines overlap by less than the 60 % of section 4.4.
    """
    view = View()
    speed = (1.0 - _PRIOR_OVERLAP) * view.width * view.line_rate
    motion = ViewMotion(view, speed, view_grid.MOTION.angle)
    found = {}
    near = functools.partial(make_search, "pearson", prior_weight=_PRIOR_WEIGHT)
    methods: dict[str, SearchChoice] = {"without_prior": "pearson", "with_prior": near}
    for word, method in methods.items():
        (pairs,) = measure([motion], texture, 60, options.noise, options.seed, method, runs=10)
        found[f"right_share_{word}.{case}"] = Metric(float(np.mean(pairs.right)), "1")
    return found


def _texture_metrics(case: str, found: Found) -> dict[str, Metric]:
    enough = [matches for motion, matches in found if motion.overlap >= OVERLAP]
    usable = float(np.mean([m.usable for m in enough]))
    return {
        f"mean_error.{case}": Metric(float(np.mean([m.mean_error for m in enough])), "px"),
        f"wrong_share.{case}": Metric(float(np.mean([m.undetected_share for m in enough])), "1"),
        f"flagged_share.{case}": Metric(1.0 - usable, "1"),
    }


def _odometry(
    texture: GroundTexture,
    axis: float,
    options: _Directions,
    library: ExperimentLibrary,
    key: tuple[str, ...],
) -> dict[str, Metric]:
    """Return the shares of measured batches and of batches with an undetected error.

    The camera of the standard experiment moves sideways over the ground, in several drives. On some
    grounds the share of measured batches depends on the start, so its range is returned too. The
    shares are metrics, keyed by name.

    Args:
        texture: the ground.
        axis: direction of the camera's axis on the ground [rad].
        options: number of drives, noise and seed.
        library: library that contains the experiment.
        key: parts of the name of the case.
    """
    configuration = library.load("straight_line").odometry
    sensor = View.of(next(iter(configuration.sensors.values()))).mounted()
    speed, angle = view_grid.MOTION.speed, view_grid.MOTION.angle
    twist = speed * np.array([math.cos(angle), math.sin(angle), 0.0])
    shares, wrong = [], []
    for seed in range(options.seed, options.seed + options.drives):
        odometry = SensorOdometry(sensor, configuration)
        rig = Rig({"camera": sensor}, texture, options.noise, seed)
        start = np.append(np.random.default_rng(seed).uniform(0.0, texture.size, 2), axis)
        readings = [odometry.update(seen["camera"]) for seen in rig.drive(start, twist, batches=40)]
        measured = [reading for reading in readings if reading.measured]
        error = np.array([reading.velocity - twist[0] for reading in measured])
        ratio = error / np.sqrt([reading.variance for reading in measured])
        shares.append(len(measured) / len(readings))
        wrong.append(np.sum(undetected(ratio, error, least=0.01 * speed)) / len(readings))
    values = {
        "odometry_measured_share": float(np.mean(shares)),
        "odometry_measured_share_smallest": min(shares),
        "odometry_measured_share_largest": max(shares),
        "odometry_wrong_share": float(np.mean(wrong)),
    }
    case = "_".join(key)
    return {f"{name}.{case}": Metric(value, "1") for name, value in values.items()}


_STUDIES = {
    "overlap": _Case(
        62,
        "Moving along the axis: mean error, and lines of equal overlap; shift limit at 50 %",
        _straight_metrics,
    ),
    "field_of_view": _Case(
        63,
        "Moving sideways by 4.8 mm a line: mean error, and lines of equal overlap",
        _view_metrics,
        columns=3,
    ),
    "median": _Case(
        71,
        "Moving sideways: mean error of single pairs (left) and of medians of 10 (right)",
        _median_metrics,
        columns=2,
    ),
    "texture_direction": _Case(
        65,
        "12 m/s at 89 deg to the axis, 2500 lines/s, over the grain",
        _texture_metrics,
        # The grain of the wood is along x.
        {
            "parallel": _Condition("moving parallel to x (the grain)", axis=0.5 * math.pi),
            "across": _Condition("moving along y (across the grain)"),
        },
        columns=2,
    ),
    "difficult_textures": _Case(
        66,
        "12 m/s at 89 deg to the axis, 2500 lines/s, over grounds of little detail",
        _texture_metrics,
        {
            f"noise_{noise:g}": _Condition(f"noise of {noise:g} gray levels", noise=noise)
            for noise in _NOISES
        },
        columns=len(_NOISES),
    ),
}
