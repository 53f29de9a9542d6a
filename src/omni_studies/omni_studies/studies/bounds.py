"""Compare random stops under every law with the lower bounds.

The path of the center of gravity is compared with the bound over all headings, and the distance of
a stop that keeps heading and line within half a degree with the bound of such stops.
"""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_loop.metrics import Metric
from omni_platform.configuration import parameter
from omni_platform.quantities import FloatArray
from omni_studies.campaign.bound_trials import LAWS, BoundTrial, BoundTrials
from omni_studies.study import StudyResult, StudyRun
from omni_tools.campaign.runner import CampaignOptions

_COLORS = dict(zip(LAWS, (style.BLACK, style.BLUE, style.GREEN, style.VERMILLION), strict=True))


class Options(CampaignOptions):
    """Number of stops, and workers."""

    runs: int = parameter(10_000, minimum=4, maximum=10**7)
    """number of runs: four laws for each random stop"""
    seed: int = parameter(0, minimum=0)
    """seed of the first stop; the others follow"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Run the stops, and count those below a bound by more than its tolerance."""
    work = BoundTrials(study.experiments)
    seeds = range(options.seed, options.seed + math.ceil(options.runs / len(LAWS)))
    stops = study.campaign(work, seeds, BoundTrial, options, work.fingerprint)
    metrics = {"runs.all": Metric(len(LAWS) * len(stops), "1")}
    for bound in ("any_heading", "straight"):
        shares, lower = _over_bound(stops, bound), below(stops, bound)
        count = int(np.sum(~np.isnan(shares)))
        solved = sum(not math.isnan(getattr(one, f"{bound}_slack")) for one in stops)
        metrics |= {
            f"compared.{bound}": Metric(count, "1"),
            f"solved.{bound}": Metric(solved, "1"),
            f"below_bound.{bound}": Metric(lower, "1"),
        }
        if count:
            metrics[f"least_over_bound.{bound}"] = Metric(float(np.nanmin(shares)), "1")
    study.figure("bounds.png", _draw(stops))
    return study.result(metrics)


def _over_bound(stops: Sequence[BoundTrial], bound: str) -> FloatArray:
    """Return the ratio of the runs to a bound, NaN if it does not apply, shape (R, laws)."""
    part = "path" if bound == "any_heading" else "kept"
    taken = np.array([[getattr(one, f"{part}_{law}") for law in LAWS] for one in stops])
    shares: FloatArray = taken / np.array([[getattr(one, bound)] for one in stops])
    return shares


def below(stops: Sequence[BoundTrial], bound: str) -> int:
    """Return the number of runs below a bound by more than its tolerance.

    Args:
        stops: the runs.
        bound: ``any_heading`` or ``straight``.
    """
    slack = np.array([[getattr(one, f"{bound}_slack") / getattr(one, bound)] for one in stops])
    return int(np.sum(_over_bound(stops, bound) < 1.0 - np.nan_to_num(slack)))


def _draw(stops: Sequence[BoundTrial]) -> Figure:
    """Draw the distribution of the ratio to the bounds, by law."""
    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    style.draw_title(figure, "No stop is below its bound")
    panels = figure.subplots(1, 2, sharey=True)
    names = ("path of the center of gravity", "distance where heading and line are kept")
    for axes, bound, name in zip(panels, ("any_heading", "straight"), names, strict=True):
        shares = _over_bound(stops, bound)
        for column, (law, color) in enumerate(_COLORS.items()):
            values = np.sort(shares[~np.isnan(shares[:, column]), column])
            label = law.replace("_", " ")
            axes.step(values, np.linspace(0.0, 1.0, len(values)), color=color, label=label)
        axes.axvline(1.0, color=style.GRAY, linestyle="--")
        axes.set_xlim(0.9, 2.0)
        axes.set_xlabel(f"{name} over its bound [1]")
    panels[0].set_ylabel("share of the runs below [1]")
    panels[1].legend(fontsize=9)
    return figure
