"""Raw and median-filtered errors of sideways motion (Figure 71).

The motion of `field_of_view`; the filter is the median of n = 10 consecutive displacements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from omni_analysis.figures.data_table import write_table
from omni_analysis.figures.style import LABEL_SIZE, draw_title, save_figure
from omni_analysis.line_trials.errors import ERROR_COLUMNS
from omni_analysis.line_trials.figures import add_error_scale, draw_error_map
from omni_analysis.line_trials.options import LineOptions, grounds_option, measure_on, pairs_option
from omni_analysis.line_trials.trials import Matches, Motion
from omni_analysis.line_trials.view_grid import (
    LENGTHS,
    SHAPES,
    as_map,
    filtered_error,
    filtered_right,
    mean_error,
    sideways_motions,
)
from omni_analysis.loop.metrics import Metric
from omni_analysis.studies import StudyResult, StudyRun
from omni_platform.configuration import ConfigurationError

_GROUP = 10


@dataclass(frozen=True, kw_only=True)
class Options(LineOptions):
    """Grounds, distance, pairs, noise and seed."""

    ground: tuple[str, ...] = grounds_option("walking_tile", "stone")
    pairs: int = pairs_option(60, fewest=_GROUP)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Move over the grounds, filter; write figure, data and metrics."""
    kinds = options.kinds
    if options.pairs < _GROUP:
        raise ConfigurationError("--pairs", f"{options.pairs} are less than a group of {_GROUP}")
    motions = sideways_motions()
    found = measure_on(kinds, motions, options)
    metrics: dict[str, Metric] = {}
    findings = []
    for kind, matches in found.items():
        raw = np.array([np.mean(m.right) for m in matches])
        filtered = np.array([filtered_right(m, _GROUP) for m in matches])
        points = (raw >= 0.6) & (raw < 1.0)  # where single pairs fail
        mended = float(np.mean(filtered[points] == 1.0)) if points.any() else 1.0
        metrics |= {
            f"right_share_raw.{kind}": Metric(float(raw.mean()), "1"),
            f"right_share_median.{kind}": Metric(float(filtered.mean()), "1"),
            f"views_with_point_errors.{kind}": Metric(float(points.sum()), "1"),
            f"mended_share.{kind}": Metric(mended, "1"),
        }
        findings.append(
            f"{kind}: the median makes {100.0 * mended:.0f} % of the {int(points.sum())} views "
            "entirely right in which up to 40 % of the pairs are off by more than a pixel, and "
            f"lifts the share of right ones over all views from {100.0 * raw.mean():.0f} to "
            f"{100.0 * filtered.mean():.0f} %."
        )
    holds = all(metrics[f"mended_share.{kind}"].value >= 0.9 for kind in kinds)
    findings.append(
        "The dissertation's claim that the median removes point errors, unless there are too many, "
        + ("holds." if holds else "holds on some of these grounds only.")
    )
    files = (
        save_figure(_draw(motions, found), study.folder / "figure_71.png"),
        write_table(
            study.folder / "median.csv",
            (
                "ground", "length_mm", "width_over_length", "overlap",
                "median_error_px", "right_share", "median_right_share", *ERROR_COLUMNS,
            ),
            (
                (
                    kind, 1e3 * motion.view.length, motion.view.width / motion.view.length,
                    motion.overlap, _filtered_mean(m), float(np.mean(m.right)),
                    filtered_right(m, _GROUP), *m.error_values(motion.view, motion.speed),
                )
                for kind, matches in found.items()
                for motion, m in zip(motions, matches, strict=True)
            ),
        ),
    )  # fmt: skip
    return StudyResult(metrics, files, tuple(findings))


def _filtered_mean(matches: Matches) -> float:
    return float(np.mean(np.abs(filtered_error(matches, _GROUP))))


def _draw(motions: list[Motion], found: dict[str, list[Matches]]) -> Figure:
    figure = Figure(figsize=(10.0, 4.2 * len(found) + 0.6), layout="constrained")
    panels = figure.subplots(len(found), 2, sharex=True, sharey=True, squeeze=False)
    draw_title(
        figure,
        "Mean error of single pairs (left) and of medians of 10 (right), moving sideways "
        "(Figure 71)",
    )
    overlap = as_map([motion.overlap for motion in motions])
    lengths, shapes = [1e3 * x for x in LENGTHS], [100.0 * y for y in SHAPES]
    for row, (kind, matches) in zip(panels, found.items(), strict=True):
        for axes, measured in zip(row, (mean_error, _filtered_mean), strict=True):
            draw_error_map(axes, lengths, shapes, as_map([measured(m) for m in matches]), overlap)
        name = kind.replace("_", " ")
        row[0].set_title(f"{name}, raw", fontsize=LABEL_SIZE, loc="left")
        row[1].set_title(f"{name}, median of {_GROUP}", fontsize=LABEL_SIZE, loc="left")
        row[0].set_ylabel("width over length [%]", fontsize=LABEL_SIZE)
    for axes in panels[-1]:
        axes.set_xlabel("length of the field of view [mm]", fontsize=LABEL_SIZE)
    add_error_scale(figure, list(panels.flat))
    return figure
