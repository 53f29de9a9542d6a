"""Figure of a parameter sweep: metrics as functions of one swept key."""

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from omni_runs.experiment import ExperimentConfiguration
from omni_runs.figures import style
from omni_runs.figures.tables.comparison_table import metric_label
from omni_runs.figures.units import readable_unit, unit_of
from omni_runs.sweep.sweep import SHOWN, SweptRun, number

_SPREAD = 0.4  # share of the distance between two words that the markers of all series take


def sweep_figure(runs: Sequence[SweptRun], title: str) -> Figure:
    """Draw four quantities versus the first swept key.

    There is one series for each variant and each combination of values of the other swept keys.
    Values that are words have no order, so no lines connect them, and their series are drawn side
    by side. Each series is thinner than the previous one, so that equal series are all visible.

    Args:
        runs: runs of the sweep, at least one.
        title: title of the figure.
    """
    key, *others = runs[0].values
    texts = list(dict.fromkeys(run.values[key] for run in runs))
    numbers = [number(text) for text in texts]
    words = any(value is None for value in numbers)
    place = {
        text: float(index) if value is None or words else value
        for index, (text, value) in enumerate(zip(texts, numbers, strict=True))
    }
    series: dict[str, list[SweptRun]] = {}
    for run in runs:
        rest = "".join(f", {name.rpartition('.')[2]} {run.values[name]}" for name in others)
        series.setdefault(run.variant + rest, []).append(run)
    unit = unit_of(ExperimentConfiguration, key)
    x_label = key if words or unit == "1" else f"{key} [{unit}]"
    figure, grid = style.panels(title, 2, 2, size=(10.0, 7.0), x=x_label, sharex=True)
    count = len(series)
    sizes = np.full(count, 0.6) if words or count == 1 else np.linspace(1.0, 0.4, count)
    shifts = _SPREAD * (np.arange(count) / count - 0.5 + 0.5 / count) if words else np.zeros(count)
    for axes, quantity in zip(grid.flat, SHOWN, strict=True):
        metrics = [run.metrics[quantity] for run in runs]
        unit, factor = readable_unit(metrics[0].unit, (metric.value for metric in metrics))
        looks = itertools.cycle(itertools.product(("o", "s", "^", "v"), style.WHEEL_COLORS))
        for (name, own), (marker, color), size, shift in zip(
            series.items(), looks, sizes, shifts, strict=False
        ):
            points = [(place[r.values[key]], factor * r.metrics[quantity].value) for r in own]
            x, y = np.array(sorted(points)).T
            axes.plot(
                x + shift,
                y,
                color=color,
                marker=marker,
                markersize=9.0 * size,
                linestyle="none" if words else "-",
                linewidth=4.0 * size,
                label=name,
            )
        axes.set_ylabel(f"{metric_label(quantity)} [{unit}]")
        axes.margins(x=0.06)
        axes.set_ylim(0.0, 1.08 * axes.dataLim.y1 or None)  # no marker is cut at the top
        if words:
            axes.set_xticks(range(len(texts)), texts)
    style.legend_below(figure, 3)
    return figure
