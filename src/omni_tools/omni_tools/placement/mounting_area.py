"""Area in which line cameras can be mounted under a chassis.

A camera occupies the rectangle of its field of view and a housing around it. Each camera keeps a
clearance from the edge of the chassis, the wheels and the other cameras. The wheel width is that of
the drawings, because the configuration does not contain one.
"""

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from omni_figures.scene import Scene, placed, rectangle
from omni_platform.geometry import PlatformGeometry
from omni_platform.quantities import BoolArray, FloatArray
from omni_tools.line_trials.rig import View


@dataclasses.dataclass(frozen=True, eq=False)
class MountingArea:
    """Area under a chassis in which cameras with rectangular housings can be mounted.

    Attributes:
        scene: chassis and wheels.
        view: field of view of every camera.
        housing: width of a camera's housing around its field of view [m].
        clearance: smallest distance to edge, wheels and other housings [m].
    """

    scene: Scene
    view: View
    housing: float
    clearance: float

    @property
    def half(self) -> tuple[float, float]:
        """Half the length and width of a housing [m]."""
        return 0.5 * self.view.length + self.housing, 0.5 * self.view.width + self.housing

    @property
    def reach(self) -> tuple[float, float]:
        """Half the length and width of the chassis minus the clearance [m]."""
        return (
            0.5 * self.scene.chassis_length - self.clearance,
            0.5 * self.scene.chassis_width - self.clearance,
        )

    def on_chassis(self, poses: FloatArray) -> BoolArray:
        """Return whether the housings are within the edge of the chassis, at each pose.

        Args:
            poses: x, y [m] and heading [rad], shape (..., 3).
        """
        cosine, sine = np.abs(np.cos(poses[..., 2])), np.abs(np.sin(poses[..., 2]))
        half_length, half_width = self.half
        limit = np.array(self.reach) + 1e-9  # tolerance for positions rounded to the edge
        extent_x = np.abs(poses[..., 0]) + cosine * half_length + sine * half_width
        extent_y = np.abs(poses[..., 1]) + sine * half_length + cosine * half_width
        return np.asarray((extent_x <= limit[0]) & (extent_y <= limit[1]))

    def wheel_in_the_way(self, poses: FloatArray) -> NDArray[np.int64]:
        """Return the index of a wheel that is too close to each housing; -1 if none is."""
        found = np.full(poses.shape[:-1], -1, np.int64)
        for index, (wheel, half) in enumerate(self._wheels):
            close = _overlap(poses, self._grown(), wheel, half)
            found = np.where(close & (found < 0), index, found)
        return found

    def fits(self, poses: FloatArray) -> BoolArray:
        """Return whether one camera can be mounted at each pose."""
        return self.on_chassis(poses) & (self.wheel_in_the_way(poses) < 0)

    def apart(self, poses: FloatArray, other: FloatArray) -> BoolArray:
        """Return whether cameras at `poses`, shape (..., 3), keep clear of a camera at `other`.

        Args:
            poses: x, y [m] and heading [rad] of the cameras, shape (..., 3).
            other: pose of one other camera, shape (3,), or of one for each of `poses`.
        """
        return ~_overlap(poses, self._grown(), other, self.half)

    def problem(self, names: tuple[str, ...], poses: FloatArray) -> str:
        """Return the reason why cameras cannot be mounted at these poses; empty if they can."""
        wheels = tuple(self.scene.wheels)
        for name, pose in zip(names, poses, strict=True):
            if not bool(self.on_chassis(pose)):
                return f"{name} extends beyond the edge"
            wheel = int(self.wheel_in_the_way(pose))
            if wheel >= 0:
                return f"{name} is too close to wheel {wheels[wheel]}"
        for i, name in enumerate(names):
            for j in range(i):
                if not bool(self.apart(poses[i], poses[j])):
                    return f"{name} and {names[j]} overlap"
        return ""

    def outline(self, pose: FloatArray, *, housing: bool) -> FloatArray:
        """Return the corners of a camera's housing or field of view [m], shape (4, 2)."""
        around = 2.0 * self.housing if housing else 0.0
        return placed(rectangle(self.view.length + around, self.view.width + around), pose)

    def _grown(self) -> tuple[float, float]:
        half_length, half_width = self.half
        return half_length + self.clearance, half_width + self.clearance

    @functools.cached_property
    def _wheels(self) -> list[tuple[FloatArray, tuple[float, float]]]:
        """Return pose (x, y [m], heading [rad]) and half sizes [m] of each wheel's rectangle."""
        geometry = PlatformGeometry.from_wheels(self.scene.wheels)
        poses = np.column_stack((geometry.position, np.arctan2(*geometry.rolling.T[::-1])))
        sides = np.diff(self.scene.wheel_outlines, axis=1)[:, :2]
        halves = 0.5 * np.linalg.norm(sides, axis=2)  # length and width, shape (N, 2)
        return list(zip(poses, map(tuple, halves), strict=True))


def _overlap(
    a: FloatArray, half_a: tuple[float, float], b: FloatArray, half_b: tuple[float, float]
) -> BoolArray:
    """Return whether rectangles at `a`, shape (..., 3), overlap with those at `b`.

    Two rectangles are separate if their projections on the direction of any side are separate.
    """
    apart_x, apart_y = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    turned = b[..., 2] - a[..., 2]
    cosine, sine = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    apart = np.zeros(a.shape[:-1], np.bool_)
    for heading, own, others in ((a[..., 2], half_a, half_b), (b[..., 2], half_b, half_a)):
        along = np.abs(np.cos(heading) * apart_x + np.sin(heading) * apart_y)
        across = np.abs(np.cos(heading) * apart_y - np.sin(heading) * apart_x)
        apart |= along >= own[0] + others[0] * cosine + others[1] * sine
        apart |= across >= own[1] + others[0] * sine + others[1] * cosine
    return ~apart
