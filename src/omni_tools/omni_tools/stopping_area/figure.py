"""Figure of stopping areas: one panel for each direction of motion, a shade for each speed."""

import re
from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from omni_core.quantities import FloatArray
from omni_runs.figures import style
from omni_runs.figures.scene import Scene
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.stopping_area.area import SECTORS, Cell, corners, footprint


def areas_figure(
    cells: Sequence[Cell], limits: FloatArray, vehicle: VehicleConfiguration, title: str
) -> Figure:
    """Draw the stopping areas of all cells that contain motions without rotation.

    Args:
        cells: cells of the motions.
        limits: support function H_k of the area of each cell [m], shape (cells, DIRECTIONS).
        vehicle: vehicle, drawn at its pose at the alarm.
        title: title of the figure.
    """
    shown = [
        (cell, corners(limit))
        for cell, limit in zip(cells, limits, strict=True)
        if cell.yaw_rate[0] <= 0.0 <= cell.yaw_rate[1]
    ]
    reach = max(float(np.max(np.abs(points))) for _, points in shown) * 1.05
    words = f"Stopping areas of {title}; x forward, y left [m]"
    figure, grid = style.panels(words, 2, 4, size=(12.0, 7.0), sharex=True, sharey=True)
    fastest = max(cell.speed[1] for cell in cells)
    for axes, sector in zip(grid.flat, SECTORS, strict=True):
        chosen = [item for item in shown if re.split(r"_\d", item[0].name)[0] == sector]
        for cell, points in sorted(chosen, key=lambda item: -item[0].speed[1]):
            paleness = 0.2 + 0.65 * cell.speed[1] / fastest
            face = np.array(to_rgb(style.BLUE)) * (1.0 - paleness) + paleness
            label = f"to {cell.speed[1]:g} m/s"
            axes.add_patch(Polygon(points, facecolor=face, edgecolor=style.BLUE, label=label))
        chassis = footprint(vehicle)[:4]
        axes.add_patch(Polygon(chassis, facecolor="white", edgecolor=style.BLACK, zorder=3))
        nose = Scene.of_vehicle(vehicle).on_chassis((0.45, 0.0), (0.3, 0.1), (0.3, -0.1))
        axes.add_patch(Polygon(nose, color=style.BLACK, zorder=4))
        axes.set_title(sector.replace("_", " "))
        axes.set_xlim(-reach, reach)
        axes.set_ylim(-reach, reach)
        axes.set_aspect("equal")
    style.legend_below(figure, 4)
    return figure
