"""Assisted stops on the velocity sensor and on the line-scan odometry, side by side."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from omni_figures import style
from omni_studies.braking.feedback_comparison import Comparison, turned

_SENSOR, _OPTICAL = style.BLUE, style.VERMILLION
_LABELS = ("velocity sensor", "line-scan odometry")
_COLUMNS = 4


def stops(comparisons: Sequence[Comparison]) -> Figure:
    """Draw the stop of every case with either feedback, and the difference."""
    figure = Figure(
        figsize=(10.0, 1.6 + 0.45 * len(comparisons)),
        dpi=style.DOTS_PER_INCH,
        layout="constrained",
    )
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, quantity, words in (
        (left, "orientation_change", "orientation change [deg]"),
        (right, "stopping_distance", "stopping distance [m]"),
    ):
        for row, comparison in enumerate(comparisons):
            sensor = comparison.sensor_metrics[quantity].value
            optical = comparison.optical_metrics[quantity].value
            axes.plot([sensor, optical], [row, row], color=style.GRAY, linewidth=1.5, zorder=2)
            axes.plot([sensor], [row], "o", color=_SENSOR, ms=9, zorder=3, clip_on=False)
            axes.plot([optical], [row], "D", color=_OPTICAL, ms=5, zorder=4, clip_on=False)
            axes.annotate(
                f"{optical - sensor:+.2f}",
                (max(sensor, optical), row),
                xytext=(9, 0),
                textcoords="offset points",
                va="center",
            )
        axes.margins(x=0.14)
        axes.set_xlim(left=0.0)
        axes.set_xlabel(words)
    left.set_yticks(range(len(comparisons)), [_words(comparison) for comparison in comparisons])
    left.invert_yaxis()
    figure.suptitle("Assisted braking on either feedback")
    handles = [
        Line2D([], [], color=_SENSOR, marker="o", ms=9, linestyle="", label=_LABELS[0]),
        Line2D([], [], color=_OPTICAL, marker="D", ms=5, linestyle="", label=_LABELS[1]),
    ]
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=2,
    )
    return figure


def orientations(comparisons: Sequence[Comparison]) -> Figure:
    """Draw the orientation of every case over time with either feedback."""
    columns = min(_COLUMNS, len(comparisons))
    rows = -(-len(comparisons) // columns)
    figure = Figure(
        figsize=(3.3 * columns + 0.6, 2.7 * rows + 0.7),
        dpi=style.DOTS_PER_INCH,
        layout="constrained",
    )
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(comparisons) :]:
        axes.set_visible(False)
    for axes, comparison in zip(panels, comparisons, strict=False):
        _orientation(axes, comparison)
    figure.supxlabel("time since braking [s]")
    figure.supylabel("orientation [deg]")
    handles = [
        Line2D([], [], color=_SENSOR, linewidth=2.4, label=_LABELS[0]),
        Line2D([], [], color=_OPTICAL, linewidth=1.2, label=_LABELS[1]),
    ]
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=2,
    )
    return figure


def _orientation(axes: Axes, comparison: Comparison) -> None:
    for history, color, width in (
        (comparison.sensor, _SENSOR, 2.4),
        (comparison.optical, _OPTICAL, 1.2),
    ):
        start = history.brake_start or 0
        axes.plot(
            history.braking_time[start:], turned(history)[start:], color=color, linewidth=width
        )
    axes.set_title(_words(comparison))


def _words(comparison: Comparison) -> str:
    return f"{comparison.experiment.replace('_', ' ')}: {comparison.variant}"
