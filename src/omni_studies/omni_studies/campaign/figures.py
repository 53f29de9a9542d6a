"""Figures of the robustness campaign: every run, and distributions of the quantities."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_studies.campaign.robustness import ALLOWED, Outcome

_TITLES = {
    "mecanum_forklift": "Mecanum, four wheels",
    "three_wheel_robot": "Kiwi, three wheels",
    "six_wheel_mecanum": "Mecanum, six wheels",
}
_QUANTITIES = {"orientation": "orientation change [deg]", "distance": "stopping distance [m]"}


def draw_runs(results: Sequence[Outcome]) -> Figure:
    """Draw every run, assisted over unassisted, with the limits.

    Args:
        results: results of the campaign.
    """
    title, size = "Every run: above the line, a limit is violated", (12.0, 8.0)
    figure, panels = style.panels(
        title, 2, len(_TITLES), size=size, y=[f"assisted {name}" for name in _QUANTITIES.values()]
    )
    limits: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "orientation": lambda x: x + ALLOWED.orientation,
        "distance": lambda x: ALLOWED.distance * x,
    }
    for row, (quantity, label) in zip(panels, _QUANTITIES.items(), strict=True):
        for axes, (vehicle, title) in zip(row, _TITLES.items(), strict=True):
            chosen = [result for result in results if result.vehicle == vehicle]
            kept = [result for result in chosen if not getattr(result, quantity)]
            broken = [result for result in chosen if getattr(result, quantity)]
            dots = min(max(3000.0 / max(len(chosen), 1), 3.0), 14.0)
            for part, look in (
                (kept, {"s": dots, "color": style.BLUE, "alpha": 0.5}),
                # Whole, on the axis too.
                (broken, {"s": 24.0, "color": style.VERMILLION, "clip_on": False, "zorder": 5}),
            ):
                axes.scatter(*_pairs(part, quantity), linewidths=0, **look)
            largest = max([1.0, *_pairs(chosen, quantity)[0], *_pairs(chosen, quantity)[1]])
            line = np.array([0.0, largest])
            axes.plot(line, line, color=style.GRAY, linewidth=0.8)
            axes.plot(line, limits[quantity](line), color=style.VERMILLION, linewidth=1.0)
            axes.set(xlim=(0.0, 1.03 * largest), ylim=(0.0, 1.03 * largest))
            axes.set(title=f"{title}: {len(broken)} of {len(chosen)}", xlabel=f"unassisted {label}")
    return figure


def draw_distributions(results: Sequence[Outcome]) -> Figure:
    """Draw cumulative distributions of the runs.

    Args:
        results: results of the campaign.
    """
    title, size = "Cumulative share of runs", (12.0, 7.0)
    words = "share of runs [1]"
    figure, panels = style.panels(title, 2, len(_TITLES), size=size, y=words, sharey=True)
    for row, (quantity, label) in zip(panels, _QUANTITIES.items(), strict=True):
        for axes, (vehicle, title) in zip(row, _TITLES.items(), strict=True):
            chosen = [result for result in results if result.vehicle == vehicle]
            pairs = _pairs(chosen, quantity)
            for values, name, color in zip(
                pairs, ("unassisted", "assisted"), (style.ORANGE, style.BLUE), strict=True
            ):
                share = (np.arange(len(values)) + 1.0) / max(len(values), 1)
                axes.step(np.sort(values), share, where="post", color=color, label=name)
            axes.set_xlim(left=0.0)
            axes.set_ylim(0.0, 1.0)
            axes.set(title=title, xlabel=label)
    panels[0, 0].legend(loc="lower right")
    return figure


def _pairs(results: Sequence[Outcome], quantity: str) -> tuple[np.ndarray, np.ndarray]:
    unassisted = np.array([getattr(result, f"{quantity}_unassisted") for result in results])
    assisted = np.array([getattr(result, f"{quantity}_assisted") for result in results])
    return unassisted, assisted
