"""Figure of the sideslip meter's errors over speed and over the angle."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter

from omni_figures import style
from omni_studies.line_trials.sideslip_trials import Angles

_MARKERS = ("o", "s", "^", "D")

Case = tuple[str, str]  # ground, sensor


def draw_sideslip(
    trials: Mapping[Case, Sequence[Angles]],
    fastest: Mapping[str, float],
    slipping: float,
    speed: float = 10.0,
) -> Figure:
    """Draw RMS errors over the speed and, for one speed, errors over the true angle.

    Args:
        trials: trials of ground and sensor, by increasing speed.
        fastest: speed at 60 % overlap by sensor [m/s].
        slipping: wheel speed over forward velocity of a wheel that slips, such as 0.99.
        speed: the one whose errors are drawn over the angle [m/s].
    """
    figure, ((left, right),) = style.panels(
        "Sideslip angle of a wheel from one line camera along its axis of rotation",
        1,
        2,
        size=(12.0, 5.6),
        x=("speed of the wheel [m/s]", "true sideslip angle [deg]"),
        width_ratios=(1.15, 1.0),
    )
    grounds = list(dict.fromkeys(ground for ground, _ in trials))
    sensors = list(dict.fromkeys(sensor for _, sensor in trials))
    _draw_speeds(left, trials, grounds, sensors, fastest)
    _draw_angles(right, trials, grounds, sensors, speed)
    truth = next(iter(trials.values()))[0].truth
    fine = np.linspace(truth[0], truth[-1], 201)
    slip = np.degrees(np.arctan(np.tan(fine) / slipping) - fine)
    right.plot(np.degrees(fine), slip, color=style.BLACK, linewidth=1.2, linestyle="--")
    share = f"{100.0 * (1.0 - slipping):.0f} % slip of the wheel"
    right.plot([], [], color=style.BLACK, linewidth=1.2, linestyle="--", label=f"bias by {share}")
    level = math.degrees(math.sqrt(float(np.mean(np.radians(slip) ** 2))))
    left.axhline(level, color=style.BLACK, linewidth=1.2, linestyle="--", label=f"RMS of {share}")
    for axes in (left, right):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=1)
    return figure


def _draw_speeds(
    axes: Axes,
    trials: Mapping[Case, Sequence[Angles]],
    grounds: Sequence[str],
    sensors: Sequence[str],
    fastest: Mapping[str, float],
) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    for (ground, sensor), found in trials.items():
        axes.plot(
            [angles.speed for angles in found],
            [math.degrees(angles.rms_error) for angles in found],
            color=style.wheel_color(grounds.index(ground)),
            marker=_MARKERS[sensors.index(sensor) % len(_MARKERS)],
            linestyle="-" if sensor == sensors[0] else ":",
            linewidth=1.6,
            markersize=5.0,
            label=f"{ground}, {sensor}",
        )
    for sensor, speed in fastest.items():
        axes.axvline(speed, color=style.GRAY, linewidth=1.0)
        words, units = f"{sensor}: 60 %\noverlap", ("data", "axes fraction")
        style.note(axes, words, (speed, 0.02), (-4, 0), xycoords=units, ha="right")
    speeds = [angles.speed for angles in next(iter(trials.values()))]
    axes.set_xticks(speeds, [f"{speed:g}" for speed in speeds])
    axes.minorticks_off()
    errors = [math.degrees(angles.rms_error) for found in trials.values() for angles in found]
    axes.set_ylim(0.01, max([2.0, *(1.3 * error for error in errors if math.isfinite(error))]))
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.set_title("RMS over -15 to 15 deg, batches of 10 ms; no point: not measured")
    axes.set_ylabel("RMS error [deg]")


def _draw_angles(
    axes: Axes,
    trials: Mapping[Case, Sequence[Angles]],
    grounds: Sequence[str],
    sensors: Sequence[str],
    speed: float,
) -> None:
    width = 0.9 / len(trials)
    for i, ((ground, sensor), found) in enumerate(trials.items()):
        angles = min(found, key=lambda a: abs(a.speed - speed))
        error = np.degrees(angles.error)
        spread = np.repeat(np.degrees(angles.truth)[:, None], error.shape[1], axis=1)
        axes.plot(
            (spread + width * (i - 0.5 * (len(trials) - 1))).ravel(),
            error.ravel(),
            color=style.wheel_color(grounds.index(ground)),
            marker=_MARKERS[sensors.index(sensor) % len(_MARKERS)],
            markersize=3.0,
            linestyle="",
            alpha=0.6 if sensor == sensors[0] else 0.3,
            label=f"{ground}, {sensor}",
        )
    axes.set_title(f"every batch at {speed:g} m/s")
    axes.set_ylabel("measured less true angle [deg]")
