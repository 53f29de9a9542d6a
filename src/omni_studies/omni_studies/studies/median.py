"""Raw and median-filtered errors of sideways motion (Figure 71).

The motion of `field_of_view`; the filter is the median of n = 10 consecutive displacements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from omni_figures.style import save_figure
from omni_loop.metrics import Metric
from omni_platform.configuration import ConfigurationError
from omni_studies.line_trials.figures import draw_error_maps
from omni_studies.line_trials.options import LineOptions, kinds_option, measure_on, pairs_option
from omni_studies.line_trials.tables import write_matches
from omni_studies.line_trials.view_grid import GROUP, as_map, sideways_motions
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.trials import Matches, Motion


@dataclass(frozen=True, kw_only=True)
class Options(LineOptions):
    """Grounds, distance, pairs, noise and seed."""

    ground: tuple[str, ...] = kinds_option("walking_tile", "stone")
    pairs: int = pairs_option(60, fewest=GROUP)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Move over the grounds, filter; write figure, data and metrics."""
    kinds = options.kinds
    if options.pairs < GROUP:
        raise ConfigurationError("--pairs", f"{options.pairs} are less than a group of {GROUP}")
    motions = sideways_motions()
    found = measure_on(kinds, motions, options)
    metrics: dict[str, Metric] = {}
    findings = []
    for kind, matches in found.items():
        raw = np.array([np.mean(m.right) for m in matches])
        filtered = np.array([m.right_medians(GROUP) for m in matches])
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
        write_matches(
            study.folder / "median.csv",
            ("ground",),
            motions,
            {(kind,): matches for kind, matches in found.items()},
        ),
    )
    return StudyResult(metrics, files, tuple(findings))


def _draw(motions: list[Motion], found: dict[str, list[Matches]]) -> Figure:
    rows = []
    for kind, matches in found.items():
        name, single = kind.replace("_", " "), [m.mean_error for m in matches]
        medians = [float(np.mean(np.abs(m.median_error(GROUP)))) for m in matches]
        rows.append({f"{name}, raw": as_map(single), f"{name}, median of 10": as_map(medians)})
    return draw_error_maps(
        "Mean error of single pairs (left) and of medians of 10 (right), moving sideways "
        "(Figure 71)",
        rows,
        as_map([motion.overlap for motion in motions]),
    )
