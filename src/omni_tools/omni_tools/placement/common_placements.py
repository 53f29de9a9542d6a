"""Common placements of line cameras on a circle: tangential, radial and parallel."""

import dataclasses
import itertools
import math

import numpy as np

from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor
from omni_tools.line_trials.rig import View
from omni_tools.placement.mounting_area import MountingArea


def ring(count: int, radius: float, turn: float, start: float = 0.0) -> FloatArray:
    """Return x, y [m], heading [rad] of cameras at equal angles on a circle, shape (count, 3).

    Args:
        count: number of cameras.
        radius: radius of the circle about base_link [m].
        turn: angle from the radial direction to each camera's axis [rad]; a right angle makes the
            axes tangential.
        start: direction of the first camera [rad].
    """
    angle = start + math.tau * np.arange(count) / count
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), angle + turn))


def tangential(radius: float, prototype: LineSensor, count: int = 3) -> dict[str, LineSensor]:
    """Return line cameras at equal angles on a circle about base_link, with tangential axes.

    Args:
        radius: radius of the circle [m].
        prototype: camera whose field of view and line rate all cameras have.
        count: number of cameras.
    """
    sensors = {}
    for i, (x, y, radial) in enumerate(ring(count, radius, 0.0).tolist()):
        heading = math.degrees(radial) + 90.0 - 360.0 * (radial > math.pi)
        sensors[f"camera_{i}"] = dataclasses.replace(prototype, x=x, y=y, heading_deg=heading)
    return sensors


def common_placements(area: MountingArea, count: int, step: float = 0.005) -> dict[str, FloatArray]:
    """Return camera poses at equal angles on the largest circle on which tangential ones fit.

    Args:
        area: mounting area of the chassis.
        count: number of cameras.
        step: difference between two radii that are tried [m].

    Returns:
        ``tangential``, and at the same positions the singular ``radial`` and ``parallel``.
    """
    radii = np.arange(max(area.reach), step, -step).tolist()
    tried = itertools.product(radii, (0.0, 0.5 * math.pi, math.pi))
    fitting = (t for t in tried if np.all(area.fits(ring(count, t[0], 0.5 * math.pi, t[1]))))
    radius, start = next(fitting, (min(area.reach), 0.0))
    radial = ring(count, radius, 0.0, start)
    return {
        "tangential": ring(count, radius, 0.5 * math.pi, start),
        "radial": radial,
        "parallel": radial * (1.0, 1.0, 0.0),
    }


_SECTORS = (
    "front", "front_left", "left", "rear_left", "rear", "rear_right", "right", "front_right",
)  # fmt: skip


def named(poses: FloatArray, view: View, *, rounded: bool = True) -> dict[str, LineSensor]:
    """Return cameras named by their positions.

    Headings are within -90 and 90 deg, reversed if necessary, so that a camera along x measures
    forward motion as positive.

    Args:
        poses: x, y [m] and heading [rad], shape (N, 3).
        view: field of view of each camera.
        rounded: whether positions are rounded to 1 mm and headings to 1 deg.
    """
    half = np.max(np.abs(poses[:, :2]), axis=0) + 1e-9
    angle = np.arctan2(poses[:, 1] / half[1], poses[:, 0] / half[0])
    sector = np.round(angle / (math.pi / 4.0)).astype(int) % len(_SECTORS)
    sensors: dict[str, LineSensor] = {}
    for index in np.lexsort((angle, sector)):
        name = _SECTORS[sector[index]]
        number = 2
        while name in sensors:
            name = f"{_SECTORS[sector[index]]}_{number}"
            number += 1
        x, y, heading = (float(value) for value in poses[index])
        heading = 90.0 - (90.0 - math.degrees(heading)) % 180.0
        if rounded:
            x, y, heading = round(x, 3), round(y, 3), float(round(heading))
        sensors[name] = view.mounted(x + 0.0, y + 0.0, heading + 0.0)
    return sensors
