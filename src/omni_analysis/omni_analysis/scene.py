"""What the figures need to know of a vehicle and its ground, apart from its motion."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from omni_platform.geometry import WheelMount

FloatArray = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class GroundPatch:
    """Ground with a friction of its own.

    Attributes:
        outline: corners in `odom` [m].
        friction: factor on the friction of the ground around it [1].
    """

    outline: tuple[tuple[float, float], ...]
    friction: float

    @classmethod
    def rectangle(
        cls, x: float, y: float, length: float, width: float, heading_deg: float, friction: float
    ) -> GroundPatch:
        """Return a patch about its centre (x, y) [m], `length` [m] along its heading [deg]."""
        corners = placed(rectangle(length, width), (x, y, math.radians(heading_deg)))
        return cls(tuple((cx, cy) for cx, cy in corners.tolist()), friction)

    @classmethod
    def disc(cls, x: float, y: float, radius: float, friction: float) -> GroundPatch:
        """Return a round patch about (x, y) [m]."""
        angles = [math.tau * index / 72 for index in range(72)]
        ring = ((x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles)
        return cls(tuple(ring), friction)


@dataclasses.dataclass(frozen=True)
class Scene:
    """A vehicle and its ground as seen from above.

    Attributes:
        chassis_length: along x of the body [m].
        chassis_width: along y of the body [m].
        wheels: mounts by wheel name.
        centre_of_gravity: of vehicle and load together, in the body frame [m], if known.
        load: position of the load in the body frame [m], if there is one.
        patches: ground with a friction of its own.
    """

    chassis_length: float
    chassis_width: float
    wheels: Mapping[str, WheelMount]
    centre_of_gravity: tuple[float, float] | None = None
    load: tuple[float, float] | None = None
    patches: tuple[GroundPatch, ...] = ()


def rectangle(length: float, width: float) -> FloatArray:
    """Return the corners of a rectangle about the origin, `length` [m] along x, shape (4, 2)."""
    return np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (length / 2.0, width / 2.0)


def placed(points: FloatArray, pose: tuple[float, float, float] | FloatArray) -> FloatArray:
    """Return points (M, 2) [m] of a frame at the pose x, y, yaw [m, m, rad] of that frame."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    turned = points @ np.array([(cos, sin), (-sin, cos)])
    return np.asarray(turned + np.asarray(pose[:2]), dtype=np.float64)
