"""Assisted stops on the velocity sensor and on the line-scan odometry, side by side."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from omni_figures import style
from omni_studies.braking.feedback_comparison import Comparison, turned

_SENSOR, _OPTICAL = style.BLUE, style.VERMILLION
_LABELS = ("velocity sensor", "line-scan odometry")
_COLUMNS = 4


def stops(comparisons: Sequence[Comparison]) -> Figure:
    """Draw the stop of every case with either feedback, and the difference."""
    figure, (panels,) = style.panels(
        "Assisted braking on either feedback",
        1,
        2,
        size=(10.0, 1.6 + 0.45 * len(comparisons)),
        x=("orientation change [deg]", "stopping distance [m]"),
        sharey=True,
    )
    for axes, quantity in zip(panels, ("orientation_change", "stopping_distance"), strict=True):
        for row, comparison in enumerate(comparisons):
            sensor = comparison.sensor_metrics[quantity].value
            optical = comparison.optical_metrics[quantity].value
            axes.plot([sensor, optical], [row, row], color=style.GRAY, linewidth=1.5, zorder=2)
            for value, label, color, marker, size in (
                (sensor, _LABELS[0], _SENSOR, "o", 9),
                (optical, _LABELS[1], _OPTICAL, "D", 5),
            ):
                look = {"color": color, "ms": size, "zorder": 3, "clip_on": False}
                axes.plot([value], [row], marker, label="" if row else label, **look)
            words = f"{optical - sensor:+.2f}"
            style.note(axes, words, (max(sensor, optical), row), (9, 0), va="center")
        axes.margins(x=0.14)
        axes.set_xlim(left=0.0)
    names = [_words(comparison) for comparison in comparisons]
    panels[0].set_yticks(range(len(comparisons)), names)
    panels[0].invert_yaxis()
    style.legend_below(figure, panels[0], 2)
    return figure


def orientations(comparisons: Sequence[Comparison]) -> Figure:
    """Draw the orientation of every case over time with either feedback."""
    columns = min(_COLUMNS, len(comparisons))
    rows = -(-len(comparisons) // columns)
    figure, grid = style.panels("", rows, columns, size=(3.3 * columns + 0.6, 2.7 * rows + 0.7))
    panels = grid.ravel()
    for axes in panels[len(comparisons) :]:
        axes.set_visible(False)
    for axes, comparison in zip(panels, comparisons, strict=False):
        for history, label, color, width in (
            (comparison.sensor, _LABELS[0], _SENSOR, 2.4),
            (comparison.optical, _LABELS[1], _OPTICAL, 1.2),
        ):
            start = history.brake_start or 0
            time, angle = history.braking_time[start:], turned(history)[start:]
            axes.plot(time, angle, color=color, linewidth=width, label=label)
        axes.set_title(_words(comparison))
    figure.supxlabel("time since braking [s]")
    figure.supylabel("orientation [deg]")
    style.legend_below(figure, panels[0], 2)
    return figure


def _words(comparison: Comparison) -> str:
    return f"{comparison.experiment.replace('_', ' ')}: {comparison.variant}"
