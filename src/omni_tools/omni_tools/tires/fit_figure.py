"""Figure of a fitted tire: measured forces and the curves of the model."""

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_sim.tire.tire import Tire
from omni_tools.tires.data import TireData
from omni_tools.tires.fit import TireFit

_CURVES = 4  # loads at which the model is drawn


def fit_figure(data: TireData, fit: TireFit, title: str) -> Figure:
    """Draw data and curves, and below them the residuals.

    Each point has the color of the curve at the nearest load.

    Args:
        data: measured forces.
        fit: fit of the data.
        title: title of the figure.
    """
    figure, ((upper,), (lower,)) = style.panels(
        title,
        2,
        size=(9.0, 6.6),
        x="Slip s [1]",
        y=("Force F [kN]", "Data - model [N]"),
        sharex=True,
        height_ratios=(3.0, 1.0),
    )
    tire = Tire(fit.tire)
    loads = np.unique(data.load)
    if len(loads) > _CURVES:
        loads = np.quantile(data.load, (np.arange(_CURVES) + 0.5) / _CURVES)
    nearest = np.argmin(np.abs(data.load[:, np.newaxis] - loads), axis=1)
    slip = np.linspace(min(0.0, float(np.min(data.slip))), max(0.0, float(np.max(data.slip))), 800)
    left = data.force - tire.force(data.slip, data.load)
    dot = {"marker": "o", "linestyle": "none", "markersize": 3.0, "alpha": 0.55}
    for index, load in enumerate(loads):
        color, rows = style.wheel_color(index), nearest == index
        upper.plot(data.slip[rows], 1e-3 * data.force[rows], color=color, **dot)
        lower.plot(data.slip[rows], left[rows], color=color, **dot)
        label = f"$F_z$ = {1e-3 * load:.3g} kN"
        upper.plot(slip, 1e-3 * tire.force(slip, load), color=color, label=label)
    lower.axhline(0.0, color=style.BLACK, linewidth=1.0)
    upper.legend(loc="lower right")
    return figure
