"""Figure of the largest sideways speed of line cameras."""

from collections.abc import Mapping

from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from omni_figures.style import BLACK, note, panels, wheel_color
from omni_platform.quantities import FloatArray


def draw_speed_limits(
    computed: Mapping[str, float],
    speeds: Mapping[str, FloatArray],
    right: Mapping[str, Mapping[str, FloatArray]],
    needed: float,
) -> Figure:
    """Draw the share of right measurements over sideways speed, a panel for each sensor.

    Args:
        computed: speed at 60 % overlap by sensor [m/s].
        speeds: tried, by sensor [m/s].
        right: share at each of them, by sensor and ground.
        needed: required share.
    """
    figure, grid = panels(
        "Medians of 10 within 1.5 px while moving sideways at 89 deg (Table 4)",
        columns=len(speeds),
        size=(5.2 * len(speeds), 4.2),
        x="speed [m/s]",
        y="right medians",
        sharey=True,
    )
    for axes, (sensor, tried) in zip(grid[0], speeds.items(), strict=True):
        for i, (ground, share) in enumerate(right[sensor].items()):
            axes.plot(tried, share, color=wheel_color(i), label=ground, linewidth=1.6)
        axes.axvline(computed[sensor], color=BLACK, linewidth=1.0, linestyle="--")
        axes.axhline(needed, color=BLACK, linewidth=0.8, linestyle=":")
        words = f"60 % overlap:\n{computed[sensor]:.3g} m/s"
        note(axes, words, (computed[sensor], 0.06), (5, 0))
        axes.set_title(sensor)
        axes.set_ylim(0.0, 1.03)
        axes.set_xlim(left=0.0)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    grid[0, 0].legend(loc="center left")
    return figure
