"""Figures that compare wheel models: contact, forces over the wheel angle, motions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omni_figures import style
from omni_platform.quantities import FloatArray
from omni_sim.wheel.roller_geometry import RollerGeometry
from omni_studies.wheels.trials import ForceTrace, Outcome

# The first wheel of a figure is the reference, dashed over the others that may cover it.
_STYLES: tuple[dict[str, Any], ...] = (
    {"color": style.BLACK, "linestyle": "--", "zorder": 3.0},
    {"color": style.SKY},
    {"color": style.VERMILLION},
    {"color": style.BLUE},
)


def draw_contact(geometries: Sequence[RollerGeometry]) -> Figure:
    """Draw contact point and active direction over the wheel angle, Eqs. (9), (10).

    Args:
        geometries: wheels that differ in their number of rollers.
    """
    figure, ((place,), (direction,)) = style.panels(
        "The contact runs along a roller and jumps to the next (45 deg rollers)",
        2,
        size=(9.0, 6.0),
        x="wheel angle [deg]",
        y=(
            "contact point along\nthe wheel axis [mm]",
            "active direction from\nthe rolling direction [deg]",
        ),
        sharex=True,
    )
    angle = np.linspace(-np.pi / 3.0, np.pi / 3.0, 4001)
    for geometry, color in zip(geometries, (style.BLUE, style.VERMILLION), strict=False):
        gamma = geometry.roller_angle(angle)
        changes = np.flatnonzero(np.diff(gamma) < 0.0)
        along = (geometry.contact_point(gamma) - geometry.center) @ geometry.wheel_axis[:2]
        axis = geometry.active_direction(gamma)
        rolling = np.array([np.sin(geometry.alpha), -np.cos(geometry.alpha)])
        across = geometry.wheel_axis[:2]
        tilt = np.degrees(np.arctan2(np.abs(axis @ across), np.abs(axis @ rolling)))
        along[changes] = np.nan  # no line over a jump
        label = f"{geometry.rollers} rollers, jump {1000.0 * geometry.jump:.0f} mm"
        place.plot(np.degrees(angle), 1000.0 * along, color=color, label=label)
        direction.plot(np.degrees(angle), tilt, color=color)
    direction.axhline(45.0, color=style.GRAY, linewidth=1.0, linestyle="--")
    style.note(direction, "ideal wheel", (-59.0, 45.0), (0, -4), va="top", color=style.GRAY)
    direction.set_ylim(44.0, None)
    place.legend(loc="upper right", ncols=2, bbox_to_anchor=(1.0, 1.02))
    low, high = place.get_ylim()
    place.set_ylim(low, high + 0.2 * (high - low))
    return figure


def draw_forces(traces: Mapping[str, Mapping[str, ForceTrace]]) -> Figure:
    """Draw the forces of one wheel over its angle.

    Args:
        traces: traces by title of the vehicle, then by wheel; the first wheel is the reference.
    """
    figure, panels = style.panels(
        "Force of one wheel while the vehicle drives at 1 m/s against a fifth of its weight",
        2,
        len(traces),
        size=(12.0, 7.0),
        x="turned by [deg]",
        y=("along the nominal\nactive direction [N]", "across it [N]"),
        sharex=True,
    )
    for column, (title, wheels) in enumerate(traces.items()):
        reference = next(iter(wheels.values())).force.mean(axis=0)
        active = reference / np.linalg.norm(reference)
        passive = np.array([-active[1], active[0]])
        for (name, trace), look in zip(wheels.items(), _STYLES, strict=False):
            angle = np.degrees(np.abs(trace.angle - trace.angle[0]))
            for row, direction in enumerate((active, passive)):
                panels[row, column].plot(angle, trace.force @ direction, label=name, **look)
        panels[0, column].set_title(title)
    for axes in panels[0]:
        axes.set_ylim(0.0, None)
    style.legend_below(figure, panels[0, 0], 4)
    return figure


def draw_motions(motions: Mapping[str, Mapping[str, Mapping[str, Outcome]]]) -> Figure:
    """Draw braking and a sideways push on all wheels.

    Args:
        motions: motions by title of the vehicle, then ``brake`` and ``push``, then by wheel.
    """
    figure, panels = style.panels(
        "Motion on both wheels; bands span the start angles of the wheels",
        len(motions),
        3,
        size=(13.0, 7.0),
        x="time [s]",
        sharex="col",
    )
    for row, (title, trials) in enumerate(motions.items()):
        for trial, column, entry, scale in (
            ("brake", 0, 3, 1.0),
            ("brake", 1, 2, 180.0 / np.pi),
            ("push", 2, 1, 1.0),
        ):
            for (name, result), look in zip(trials[trial].items(), _STYLES, strict=False):
                values = result.motion[:, :, entry] * scale
                _band(panels[row, column], result.time, values, name, look)
        panels[row, 0].set_ylabel(f"{title}\n\nspeed forward, full braking [m/s]")
        panels[row, 1].set_ylabel("heading, full braking [deg]")
        panels[row, 2].set_ylabel("pushed sideways by [m]")
    style.legend_below(figure, panels[0, 0], 4)
    return figure


def _band(
    axes: Axes, time: FloatArray, values: FloatArray, name: str, look: dict[str, Any]
) -> None:
    if len(values) > 1:
        low, high = values.min(axis=0), values.max(axis=0)
        axes.fill_between(time, low, high, color=look["color"], alpha=0.2, linewidth=0.0)
    axes.plot(time, values.mean(axis=0), label=name, **look)


def draw_differences(
    counts: Sequence[int],
    differences: Mapping[str, Mapping[str, Mapping[str, Sequence[float]]]],
    limit: float,
) -> Figure:
    """Draw the differences of the wheel models over the number of rollers.

    Args:
        counts: numbers of rollers.
        differences: differences by title of the vehicle, then ``motion`` and ``force``, then by
            trial; one share for each count [1].
        limit: upper limit from 12 rollers on [1].
    """
    figure, panels = style.panels(
        "Individual rollers against the single roller, in the mean over the wheel angles",
        2,
        len(differences),
        size=(12.0, 7.0),
        x="rollers of a wheel",
        y=("difference of the motion [%]", "difference of the mean force [%]"),
        sharex=True,
        sharey=True,
    )
    for column, (title, kinds) in enumerate(differences.items()):
        for row, kind in enumerate(("motion", "force")):
            axes = panels[row, column]
            for index, (name, values) in enumerate(kinds[kind].items()):
                percent = 100.0 * np.asarray(values)
                axes.plot(counts, percent, "o-", color=style.wheel_color(index), label=name)
            axes.plot([12, max(counts)], [100.0 * limit] * 2, color=style.GRAY, linestyle="--")
        panels[0, column].set_title(title)
    panels[0, 0].set_xticks(list(counts))
    panels[0, 0].set_ylim(0.0, None)
    style.legend_below(figure, panels[0, 0], 3)
    return figure
