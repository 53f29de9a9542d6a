"""Figure of the largest sideways speed of line cameras."""

from collections.abc import Mapping
from typing import NamedTuple

from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from omni_figures.style import BLACK, note, panels, wheel_color
from omni_platform.quantities import FloatArray


class Tried(NamedTuple):
    """Sideways speeds of a sensor.

    Attributes:
        computed: speed at 60 % overlap [m/s].
        speeds: speeds that were tried [m/s], shape (n,).
        right: share of right measurements at each of them, by ground.
    """

    computed: float
    speeds: FloatArray
    right: Mapping[str, FloatArray]


def draw_speed_limits(sensors: Mapping[str, Tried], needed: float) -> Figure:
    """Draw the share of right measurements over speed, a panel for each sensor.

    Args:
        sensors: by title.
        needed: required share.
    """
    figure, grid = panels(
        "Medians of 10 within 1.5 px while moving sideways at 89 deg (Table 4)",
        columns=len(sensors),
        size=(5.2 * len(sensors), 4.2),
        x="speed [m/s]",
        y="right medians",
        sharey=True,
    )
    for axes, (title, (computed, speeds, right)) in zip(grid[0], sensors.items(), strict=True):
        for i, (ground, share) in enumerate(right.items()):
            axes.plot(speeds, share, color=wheel_color(i), label=ground, linewidth=1.6)
        axes.axvline(computed, color=BLACK, linewidth=1.0, linestyle="--")
        axes.axhline(needed, color=BLACK, linewidth=0.8, linestyle=":")
        words = f"60 % overlap:\n{computed:.3g} m/s"
        note(axes, words, (computed, 0.06), (5, 0))
        axes.set_title(title)
        axes.set_ylim(0.0, 1.03)
        axes.set_xlim(left=0.0)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    grid[0, 0].legend(loc="center left")
    return figure
