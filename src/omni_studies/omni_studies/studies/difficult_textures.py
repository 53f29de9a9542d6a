"""Sideways motion over metal and plastic, which show too little detail (Figure 66).

12 m/s at 89 deg to the axis with 2500 lines/s, over the shapes of Figure 63, without noise and with
noise of 1 and 5 gray levels.
"""

from __future__ import annotations

from dataclasses import dataclass

from omni_figures.style import save_figure
from omni_loop.metrics import Metric
from omni_studies.line_trials.figures import draw_error_maps
from omni_studies.line_trials.options import TextureOptions, grounds_of, grounds_option, runs_option
from omni_studies.line_trials.tables import surface_metrics, write_matches
from omni_studies.line_trials.view_grid import GROUP, as_map, sideways_motions
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.trials import Matches, measure

_NOISES = (0.0, 1.0, 5.0)  # [gray levels]


@dataclass(frozen=True, kw_only=True)
class Options(TextureOptions):
    """Grounds, their resolution, random places and seed."""

    ground: tuple[str, ...] = grounds_option("metal", "plastic")
    runs: int = runs_option(2)


def run(options: Options, study: StudyRun) -> StudyResult:
    """Move over the grounds with each noise; write figure, data and metrics."""
    grounds = grounds_of(options, study.experiments)
    motions = sideways_motions()
    metrics: dict[str, Metric] = {}
    cases: dict[tuple[str, ...], list[Matches]] = {}
    for ground, texture in grounds.items():
        for noise in _NOISES:
            found = measure(motions, texture, GROUP, noise, options.seed, runs=options.runs)
            cases[ground, f"{noise:g}"] = found
            metrics |= surface_metrics(f"{ground}_noise_{noise:g}", motions, found)
    figure = draw_error_maps(
        "12 m/s at 89 deg to the axis, 2500 lines/s, over grounds of little detail (Figure 66)",
        [
            {
                f"noise of {noise:g} gray levels": as_map(
                    [m.mean_error for m in cases[ground, f"{noise:g}"]]
                )
                for noise in _NOISES
            }
            for ground in grounds
        ],
        as_map([motion.overlap for motion in motions]),
        grounds=grounds,
    )
    files = (
        save_figure(figure, study.folder / "figure_66.png"),
        write_matches(study.folder / "difficult.csv", ("ground", "noise"), motions, cases),
    )
    return StudyResult(metrics, files, tuple(_finding(ground, metrics) for ground in grounds))


def _finding(ground: str, metrics: dict[str, Metric]) -> str:
    clean, faint, noisy = (metrics[f"mean_error.{ground}_noise_{n:g}"].value for n in _NOISES)
    wrong = 100.0 * metrics[f"wrong_share.{ground}_noise_5"].value
    holds = "holds" if clean <= 1.0 and noisy > 5.0 else "does not hold"
    return (
        f"{ground}: from 60 % overlap on, the mean error is {clean:.2g} px without noise, "
        f"{faint:.3g} px with noise of 1 and {noisy:.3g} px with noise of 5 gray levels, of which "
        f"{wrong:.0f} % of the pairs would be taken for measured; the claim that it can be "
        f"measured only without noise {holds}."
    )
