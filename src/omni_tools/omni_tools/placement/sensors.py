"""Line cameras of one type at given positions, with names for the positions."""

import math

import numpy as np

from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor
from omni_tools.line_trials.rig import View

_SECTORS = (
    "front", "front_left", "left", "rear_left", "rear", "rear_right", "right", "front_right",
)  # fmt: skip


def named(poses: FloatArray, view: View, *, rounded: bool = True) -> dict[str, LineSensor]:
    """Return cameras named by their positions.

    The direction of an axis may be reversed: headings are those within -90 and 90 deg, so that a
        camera
    that looks forward measures forward motion as positive.

    Args:
        poses: x, y [m] and heading [rad], shape (N, 3).
        view: field of view of each camera.
        rounded: placement rounded to 1 mm and 1 deg.
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
