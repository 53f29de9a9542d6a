"""Area in which line cameras can be mounted under a chassis, and common placements on a circle.

A camera occupies the rectangle of its field of view and a housing around it. Each camera keeps a
clearance from the edge of the chassis, the wheels and the other cameras. The configuration does not
contain the width of the wheels; the width in the drawings is used. A steered wheel needs room at
all of its steering angles.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Mapping

import numpy as np

from omni_core.geometry import PlatformGeometry
from omni_core.quantities import BoolArray, FloatArray, IntArray
from omni_core.sensors import LineSensor
from omni_runs.figures.scene import Scene, placed, rectangle
from omni_tools.line_trials.rig import View

# Largest difference between two steering angles at which a wheel must not touch a camera [rad]. The
# corner of a wheel passes between them by less than 0.4 % of its distance from the axis.
_TURN = math.radians(10.0)


@dataclasses.dataclass(frozen=True, eq=False)
class MountingArea:
    """Area under a chassis in which cameras with rectangular housings can be mounted.

    Attributes:
        scene: chassis and wheels.
        view: field of view of every camera.
        housing: width of a camera's housing around its field of view [m].
        clearance: minimum distance to edge, wheels and other housings [m].
    """

    scene: Scene
    view: View
    housing: float
    clearance: float

    @property
    def half(self) -> tuple[float, float]:
        """Half the length and half the width of a housing [m]."""
        return 0.5 * self.view.length + self.housing, 0.5 * self.view.width + self.housing

    @property
    def reach(self) -> tuple[float, float]:
        """Half the length and half the width of the chassis, each minus the clearance [m]."""
        return (
            0.5 * self.scene.chassis_length - self.clearance,
            0.5 * self.scene.chassis_width - self.clearance,
        )

    def on_chassis(self, poses: FloatArray) -> BoolArray:
        """Return whether a camera's housing at each pose is inside the chassis, with clearance.

        Args:
            poses: x, y [m] and heading [rad], shape (..., 3).
        """
        cosine, sine = np.abs(np.cos(poses[..., 2])), np.abs(np.sin(poses[..., 2]))
        half_length, half_width = self.half
        limit = np.array(self.reach) + 1e-9  # tolerance for positions rounded to the edge
        extent_x = np.abs(poses[..., 0]) + cosine * half_length + sine * half_width
        extent_y = np.abs(poses[..., 1]) + sine * half_length + cosine * half_width
        return np.asarray((extent_x <= limit[0]) & (extent_y <= limit[1]))

    def wheel_in_the_way(self, poses: FloatArray) -> IntArray:
        """Return the index of a wheel that is too close to a camera at each pose; -1 if none.

        Args:
            poses: x, y [m] and heading [rad], shape (..., 3).

        Returns:
            Indices, shape (...).
        """
        found = np.full(poses.shape[:-1], -1, np.int64)
        for index, wheel, half in self._wheels:
            close = _overlap(poses, self._grown(), wheel, half)
            found = np.where(close & (found < 0), index, found)
        return found

    def fits(self, poses: FloatArray) -> BoolArray:
        """Return whether a camera can be mounted at each of the poses (..., 3), shape (...)."""
        return self.on_chassis(poses) & (self.wheel_in_the_way(poses) < 0)

    def apart(self, poses: FloatArray, other: FloatArray) -> BoolArray:
        """Return whether cameras at `poses` keep the clearance from a camera at `other`.

        Args:
            poses: x, y [m] and heading [rad] of the cameras, shape (..., 3).
            other: pose of another camera, shape (3,), or a pose for each of `poses`.
        """
        return ~_overlap(poses, self._grown(), other, self.half)

    def problem(self, sensors: Mapping[str, LineSensor], poses: FloatArray) -> str:
        """Return the reason why cameras cannot be mounted at the given poses; empty if they can.

        Args:
            sensors: cameras, keyed by name; a camera may be next to the wheel that is its carrier.
            poses: x, y [m] and heading [rad], shape (N, 3).
        """
        names = tuple(sensors)
        for name, pose in zip(names, poses, strict=True):
            if not bool(self.on_chassis(pose)):
                return f"{name} extends beyond the edge"
            own = sensors[name].carrier
            wheels = {key: mount for key, mount in self.scene.wheels.items() if key != own}
            others = dataclasses.replace(self, scene=dataclasses.replace(self.scene, wheels=wheels))
            wheel = int(others.wheel_in_the_way(pose))
            if wheel >= 0:
                return f"{name} is too close to wheel {tuple(wheels)[wheel]}"
        for i, name in enumerate(names):
            for j in range(i):
                if not bool(self.apart(poses[i], poses[j])):
                    return f"{name} and {names[j]} overlap"
        return ""

    def outline(self, pose: FloatArray, *, housing: bool) -> FloatArray:
        """Return the corners of a camera's housing or field of view in the body frame [m], (4, 2).

        Args:
            pose: x, y [m] and heading [rad] of the camera, shape (3,).
            housing: True for the housing, False for the field of view.
        """
        around = 2.0 * self.housing if housing else 0.0
        return placed(rectangle(self.view.length + around, self.view.width + around), pose)

    def _grown(self) -> tuple[float, float]:
        half_length, half_width = self.half
        return half_length + self.clearance, half_width + self.clearance

    @functools.cached_property
    def _wheels(self) -> list[tuple[int, FloatArray, tuple[float, float]]]:
        """Return index, pose (x, y [m], heading [rad]) and half sizes [m] of rectangles of wheels.

        A steered wheel has a rectangle for each of the steering angles that its motion covers.
        """
        mounts = self.scene.wheels.values()
        geometry = PlatformGeometry.from_wheels(self.scene.wheels)
        poses = np.column_stack((geometry.position, np.arctan2(*geometry.rolling.T[::-1])))
        sides = np.diff(self.scene.wheel_outlines, axis=1)[:, :2]
        halves = 0.5 * np.linalg.norm(sides, axis=2)  # length and width, shape (N, 2)
        found = []
        for index, (mount, pose) in enumerate(zip(mounts, poses, strict=True)):
            limit = math.radians(min(mount.steering_limit_deg, 90.0))  # a rectangle is symmetric
            for angle in np.linspace(-limit, limit, 2 * math.ceil(limit / _TURN) + 1):
                half = float(halves[index, 0]), float(halves[index, 1])
                found.append((index, pose + np.array([0.0, 0.0, angle]), half))
        return found


def _overlap(
    a: FloatArray, half_a: tuple[float, float], b: FloatArray, half_b: tuple[float, float]
) -> BoolArray:
    """Return whether rectangles overlap, shape (...).

    Two rectangles are separate if their projections on the direction of any side are separate.

    Args:
        a: pose (x, y [m], heading [rad]) of the first rectangle of each pair, shape (..., 3).
        half_a: half the length and width of the first rectangles [m].
        b: pose of the second rectangle of each pair, shape (..., 3) or (3,).
        half_b: half the length and width of the second rectangles [m].
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
    """Return line cameras with tangential axes at equal angles on a circle, keyed by name.

    Args:
        radius: radius of the circle about base_link [m].
        prototype: camera whose field of view and line rate all cameras have.
        count: number of cameras.
    """
    sensors = {}
    for i, (x, y, radial) in enumerate(ring(count, radius, 0.0).tolist()):
        heading = math.degrees(radial) + 90.0 - 360.0 * (radial > math.pi)
        sensors[f"camera_{i}"] = dataclasses.replace(prototype, x=x, y=y, heading_deg=heading)
    return sensors


def common_placements(area: MountingArea, count: int, step: float = 0.005) -> dict[str, FloatArray]:
    """Return three common placements on the largest circle on which tangential cameras fit.

    They are keyed by name.

    Args:
        area: mounting area of the chassis.
        count: number of cameras.
        step: difference between two radii that are tried [m].

    Returns:
        Poses of the placement ``tangential``, and of the singular placements ``radial`` and
        ``parallel`` with the same positions; shape (count, 3) each.
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
    """Return cameras at the given poses, keyed by names that describe their positions.

    A heading outside -90 to 90 deg is reversed, so that a camera along x measures forward motion as
    positive.

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
