"""Figures of a tire's steady characteristic, after Figures 4, 5 and 6 of the dissertation."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_figures import style
from omni_platform.quantities import FloatArray
from omni_sim.tire.combined_slip import combined_forces
from omni_sim.tire.models.tmeasy import TMeasyConfiguration, curve_of, direction_coefficients
from omni_sim.tire.tire import Tire, TireConfiguration


def slip_figure(tire: TMeasyConfiguration, load: float) -> Figure:
    """Draw force over slip with the five numbers that define it (Figure 4).

    Args:
        tire: TMeasy; its longitudinal direction is drawn.
        load: wheel load [N].
    """
    figure, axes = _axes("Slip s [1]", "Longitudinal force F [kN]")
    model = Tire(TireConfiguration(tmeasy=tire))
    point = curve_of(tire, load)
    right = 1.35 * point.slide_slip
    slip = np.linspace(0.0, right, 800)
    sections = (
        ("adhesion", slip <= point.peak_slip, style.BLUE),
        ("transition", (slip >= point.peak_slip) & (slip <= point.slide_slip), style.ORANGE),
        ("full sliding", slip >= point.slide_slip, style.VERMILLION),
    )
    for label, where, color in sections:
        carried = 1e-3 * model.force(slip[where], load)
        axes.plot(slip[where], carried, color=color, linewidth=2.4, label=label)
    top = 1e-3 * point.peak_force
    tangent = np.array([0.0, 1.12 * point.peak_force / point.slope])
    axes.plot(tangent, 1e-3 * point.slope * tangent, "--", color=style.BLACK, linewidth=1.0)
    words = f"slope $dF_0$ = {1e-3 * point.slope:.0f} kN"
    style.note(axes, words, (float(tangent[1]), 1.12 * top), (6, -2))
    guide: dict[str, Any] = {"color": style.GRAY, "linewidth": 0.9, "linestyle": ":"}
    for place, force, names in (
        (point.peak_slip, point.peak_force, ("$s_{max}$", "$F_{max}$")),
        (point.slide_slip, point.slide_force, ("$s_{slide}$", "$F_{slide}$")),
    ):
        height = 1e-3 * force
        axes.plot([place, place, 0.0], [0.0, height, height], **guide)
        axes.plot(place, height, "o", color=style.BLACK, markersize=5)
        words = f"{names[0]} = {place:g}\n{names[1]} = {height:g} kN"
        style.note(axes, words, (place, height), (8, -34))
    axes.set_xlim(0.0, right)
    axes.set_ylim(0.0, 1.2 * top)
    axes.set_title(f"Force over slip at {1e-3 * load:g} kN (Figure 4)")
    axes.legend(loc="lower right")
    return figure


def load_figure(tire: Tire, loads: FloatArray, title: str) -> Figure:
    """Draw force over slip at several loads (Figure 5).

    Args:
        tire: tire of any model.
        loads: wheel loads [N] up to the largest of the model, shape (n,).
        title: title of the figure.
    """
    figure, axes = _axes("Slip s [1]", "Longitudinal force F [kN]")
    slip = np.linspace(0.0, 0.6, 700)
    colors = _shades(len(loads))
    for load, color in zip(loads, colors, strict=True):
        force = 1e-3 * tire.force(slip, load)
        axes.plot(slip, force, color=color, linewidth=2.0)
        end = float(slip[-1]), float(force[-1])
        style.note(axes, f"$F_z$ = {1e-3 * load:g} kN", end, (5, 0), va="center")
    axes.set_xlim(0.0, float(slip[-1]))
    axes.set_ylim(bottom=0.0)
    axes.set_title(title)
    return figure


def interpolation_curve(tire: TMeasyConfiguration, load: FloatArray) -> FloatArray:
    """Return the parabola (3) of the longitudinal slope [N] at loads [N], beyond the model too."""
    c = direction_coefficients(tire)
    return np.asarray((c[0] + c[1] * load) * load, dtype=np.float64)


def interpolation_figure(tire: TMeasyConfiguration) -> Figure:
    """Draw the parabola (3) of the slope over the load (Figure 6).

    Args:
        tire: TMeasy; its longitudinal direction is drawn.
    """
    figure, axes = _axes("Wheel load $F_z$ [kN]", "Slope $dF_0$ at zero slip [kN]")
    load_1, load_2 = tire.nominal_load_1, tire.nominal_load_2
    c = direction_coefficients(tire)
    end = -c[0] / c[1] if c[1] < 0.0 else 2.0 * load_2
    inside, outside = np.linspace(0.0, load_2, 300), np.linspace(load_2, end, 300)
    clamped = np.full(300, tire.x.slope_2)
    beyond = interpolation_curve(tire, outside)
    for load, slope, color, dashes, label in (
        (inside, interpolation_curve(tire, inside), style.BLUE, "-", "model"),
        (outside, beyond, style.GRAY, "--", "parabola beyond the model, no physical meaning"),
        (outside, clamped, style.VERMILLION, "-", "used there: clamped, and reported"),
    ):
        axes.plot(1e-3 * load, 1e-3 * slope, dashes, color=color, label=label)
    for name, x, y in (("1", load_1, tire.x.slope_1), ("2", load_2, tire.x.slope_2)):
        place = 1e-3 * x, 1e-3 * y
        axes.plot(*place, "o", color=style.BLACK)
        style.note(axes, f"$Load_{name}$", place, (-8, 4), ha="right")
    axes.axvspan(1e-3 * load_2, 1e-3 * end, color=style.PALE, alpha=0.35, linewidth=0.0)
    axes.set_xlim(0.0, 1e-3 * end)
    axes.set_ylim(0.0, 1.4e-3 * float(np.max(beyond)))
    axes.set_title("Quadratic interpolation of the slope (Figure 6)")
    axes.legend(loc="upper center")
    return figure


def model_figure(tires: Mapping[str, Tire], loads: tuple[float, ...]) -> Figure:
    """Draw force over slip of several tires at the same loads, one panel per load.

    Args:
        tires: tires by name.
        loads: wheel loads [N].
    """
    figure, (panels,) = style.panels(
        "", 1, len(loads), size=(11.0, 4.6), x="Slip s [1]", y="Force F [kN]", sharey=True
    )
    slip = np.linspace(0.0, 0.6, 700)
    for axes, load in zip(panels, loads, strict=True):
        for index, (name, tire) in enumerate(tires.items()):
            label = f"{name} ({tire.configuration.model})"
            force = 1e-3 * tire.force(slip, load)
            axes.plot(slip, force, color=style.wheel_color(index), label=label)
        axes.set_xlim(0.0, 0.6)
        axes.set_title(f"$F_z$ = {1e-3 * load:g} kN")
    panels[0].set_ylim(bottom=0.0)
    panels[-1].legend(loc="lower right")
    return figure


def combined_figure(tire: TMeasyConfiguration, load: float) -> Figure:
    """Draw lateral over longitudinal force under combined slip (section 2.3.1).

    Args:
        tire: TMeasy with both directions.
        load: wheel load [N].
    """
    figure, axes = _axes("Longitudinal force $F_x$ [kN]", "Lateral force $F_y$ [kN]")
    figure.set_size_inches(7.6, 6.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    for slip, color in zip((0.02, 0.05, 0.1, 0.18, 0.8), _shades(5), strict=True):
        force = 1e-3 * combined_forces(tire, slip * np.cos(angle), slip * np.sin(angle), load)
        axes.plot(force[:, 0], force[:, 1], color=color, linewidth=2.0, label=f"|s| = {slip:g}")
    reach = 1.08e-3 * curve_of(tire, load).peak_force
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), box_aspect=1.0)
    axes.set_title(f"Combined slip at {1e-3 * load:g} kN")
    figure.legend(loc="outside right center")
    return figure


def _axes(x: str, y: str) -> tuple[Figure, Axes]:
    figure, grid = style.panels("", size=(8.0, 5.0), x=x, y=y)
    return figure, grid[0, 0]


def _shades(count: int) -> list[tuple[float, float, float]]:
    """Return blues from light to dark."""
    light, dark = np.array([0.55, 0.76, 0.92]), np.array([0.0, 0.22, 0.42])
    return [
        (float(c[0]), float(c[1]), float(c[2]))
        for c in (light + (dark - light) * k / max(count - 1, 1) for k in range(count))
    ]
