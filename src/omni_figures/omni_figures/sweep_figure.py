"""Figure of a parameter sweep: metrics as functions of one swept key."""

import itertools
from collections.abc import Sequence

from matplotlib.figure import Figure

from omni_figures import style
from omni_figures.tables.comparison_table import in_small_units, metric_label
from omni_loop.sweep import SHOWN, SweptRun, number


def sweep_figure(runs: Sequence[SweptRun], title: str) -> Figure:
    """Draw four quantities versus the first swept key.

    There is one line for each variant and each combination of values of the other swept keys.

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
    lines: dict[str, list[SweptRun]] = {}
    for run in runs:
        rest = "".join(f", {name.rpartition('.')[2]} {run.values[name]}" for name in others)
        lines.setdefault(run.variant + rest, []).append(run)
    figure, grid = style.panels(title, 2, 2, size=(10.0, 7.0), x=key, sharex=True)
    for axes, quantity in zip(grid.flat, SHOWN, strict=True):
        unit, _ = in_small_units([run.metrics[quantity] for run in runs])
        factor = 1.0 if unit == runs[0].metrics[quantity].unit else 1000.0
        looks = itertools.cycle(itertools.product(("o", "s", "^", "v"), style.WHEEL_COLORS))
        for (name, own), (marker, color) in zip(lines.items(), looks, strict=False):
            points = [(place[r.values[key]], factor * r.metrics[quantity].value) for r in own]
            x, y = zip(*sorted(points), strict=True)
            axes.plot(x, y, color=color, marker=marker, markersize=5, label=name)
        axes.set_ylabel(f"{metric_label(quantity)} [{unit}]")
        axes.set_ylim(bottom=0.0)
        if words:
            axes.set_xticks(range(len(texts)), texts)
    style.legend_below(figure, 3)
    return figure
