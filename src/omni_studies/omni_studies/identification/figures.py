"""Figures on Table 2: trade-off between rotation and distance, and sensitivities."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from omni_brake_assist.weighting import weighting_function
from omni_runs.figures import style
from omni_studies.identification import table_2
from omni_studies.identification.identification import QUANTITIES
from omni_studies.identification.sensitivity import Sensitivity

_LABELS = {
    "unassisted": "unassisted",
    "zero": r"$\psi = 0$",
    "cosine": r"$\psi = \cos\delta$",
    "k1": "enhanced, k = 1",
    "k7": "enhanced, k = 7",
}


def weighting_functions() -> Figure:
    """Draw the weight of the parallel component as a function of the wheel's angle, Figure 28."""
    x = r"angle $\delta$ between active direction and velocity [deg]"
    figure, ((axes,),) = style.panels("", size=(8.0, 4.6), x=x, y=r"weight $\psi$ [1]")
    angle = np.linspace(0.0, 90.0, 181)
    for row, case in enumerate(("zero", "cosine", "k1", "k3", "k7")):
        kind = "enhanced" if case[0] == "k" else case
        k = int(case[1:]) if kind == "enhanced" else 1
        weights = weighting_function(kind, k)(np.radians(angle))
        label = f"enhanced, k = {k}" if kind == "enhanced" else _LABELS[case]
        axes.plot(angle, weights, color=style.wheel_color(row), label=label)
    axes.set_title("Weight of a wheel versus its angle")
    axes.set_xticks(range(0, 91, 15))
    axes.legend()
    return figure


def trade_off(measured: Mapping[str, float]) -> Figure:
    """Draw simulated orientation change versus stopping distance, with the dissertation's values.

    Args:
        measured: simulated values of all metrics in `table_2.REFERENCES`, in their units.
    """
    figure, ((axes,),) = style.panels(
        "", size=(8.0, 5.2), x="stopping distance [m]", y="orientation change [deg]"
    )
    for row, case in enumerate(table_2.CASES):
        color = style.wheel_color(row)
        names = f"stopping_distance.{case}", f"orientation_change.{case}"
        x0, y0 = (table_2.REFERENCES[name] for name in names)
        dx, dy = (table_2.tolerance(name) for name in names)
        x, y = (measured[name] for name in names)
        axes.add_patch(
            Rectangle((x0 - dx, y0 - dy), 2 * dx, 2 * dy, facecolor=color, alpha=0.18, zorder=1)
        )
        axes.plot([x0], [y0], "o", markerfacecolor="white", color=color, markersize=9, zorder=3)
        axes.plot([x], [y], "o", color=color, markersize=6, zorder=4)
        style.note(axes, _LABELS[case], (x0 + dx, y0), (6, 0), va="center")
    axes.set_xlim(8.5, 13.7)
    axes.set_ylim(0.0, 95.0)
    axes.set_title("Table 2: orientation against distance")
    gray: dict[str, Any] = {"color": style.GRAY, "linestyle": "", "marker": "o"}
    axes.legend(
        handles=[
            Line2D([], [], markerfacecolor="white", markersize=9, label="dissertation", **gray),
            Patch(facecolor=style.GRAY, alpha=0.3, label="5 % or 2 deg, 3 %"),
            Line2D([], [], markersize=6, label="identified vehicle", **gray),
        ],
        loc="upper right",
    )
    return figure


def sensitivity_map(sensitivity: Sensitivity) -> Figure:
    """Draw how much a step of each parameter changes each number of Table 2, in tolerances."""
    values = sensitivity.in_tolerances.T
    figure, ((axes,),) = style.panels("", size=(10.0, 7.6))
    axes.grid(False)
    image = axes.imshow(values, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        color = "white" if abs(value) > 0.7 else style.BLACK
        axes.text(column, row, f"{value:+.2f}", ha="center", va="center", color=color)
    axes.set_xticks(
        range(len(sensitivity.numbers)),
        [_LABELS[name.partition(".")[2]] for name in sensitivity.numbers],
        rotation=30,
        ha="right",
    )
    steps = [f"{q.name.replace('_', ' ')} +{q.step:g} {q.unit}" for q in QUANTITIES]
    axes.set_yticks(range(len(steps)), [words.removesuffix(" 1") for words in steps])
    axes.axvline(4.5, color=style.BLACK)
    for x, words in ((2.0, "orientation change"), (7.0, "stopping distance")):
        style.note(axes, words, (x, -0.5), (0, 6), ha="center")
    axes.tick_params(length=0)
    figure.colorbar(image, ax=axes, shrink=0.7, label="change in tolerances of Table 2")
    return figure
