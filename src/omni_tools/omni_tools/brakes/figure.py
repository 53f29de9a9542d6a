"""Figure of fitted brakes: measured and fitted stops, and the response to the pedal."""

import numpy as np
from matplotlib.figure import Figure

from omni_figures import style
from omni_tools.brakes.fit import BrakeFit, mean_shares


def brake_figure(fit: BrakeFit, names: list[str], title: str) -> Figure:
    """Draw the measured and fitted change of speed, and the response of one brake.

    Args:
        fit: fit of the stops.
        names: names of the recordings, in the order of the stops.
        title: title of the figure.
    """
    figure, ((upper,), (middle,), (lower,)) = style.panels(
        title,
        3,
        size=(9.0, 7.4),
        x="Time since the valve opened [ms]",
        y=("Speed taken while\nwheels turn [m/s]", "Measured -\nfitted [mm/s]", "Torque [N m]"),
        height_ratios=(3.0, 1.2, 1.8),
    )
    torque, dead_time, time_constant = fit.values
    for index, (stop, name) in enumerate(zip(fit.stops, names, strict=True)):
        shares = mean_shares(stop, dead_time, time_constant)
        explained = np.einsum("kcn,kn->kc", stop.per_torque, shares) * torque
        time = stop.time - stop.time[0]
        taken = np.cumsum(np.stack((stop.change, explained)), axis=1)
        main = int(np.argmax(np.abs(taken[0, -1])))
        color = style.wheel_color(index)
        measured, fitted = np.abs(taken[:, :, main])
        upper.plot(time, measured, color=color, marker="o", markersize=2.5, linestyle="none")
        upper.plot(time, fitted, color=color, label=name)
        middle.plot(time, 1e3 * (measured - fitted), color=color, linewidth=1.0)
    middle.axhline(0.0, color=style.BLACK, linewidth=1.0)
    after = np.linspace(0.0, dead_time + 5.0 * time_constant + 0.02, 300)
    since = np.maximum(after - dead_time, 0.0)
    answer = torque * -np.expm1(-since / max(time_constant, 1e-6))
    lower.plot(1e3 * after, answer, color=style.BLACK)
    for axes in (upper, middle):
        axes.set_xlabel("Time since the pedal went down [s]")
    upper.legend(loc="lower right")
    return figure
