"""Geometry of a vehicle and its ground for the figures."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from omni_core.geometry import PlatformGeometry, WheelMount
from omni_core.quantities import FloatArray
from omni_sim.ground.configuration import FrictionPatch

if TYPE_CHECKING:
    from omni_runs.experiment import ExperimentConfiguration
    from omni_sim.vehicle.configuration import VehicleConfiguration

# Drawn width of a wheel per diameter [1], because the configuration has no wheel width.
_WHEEL_WIDTH = 0.45


@dataclasses.dataclass(frozen=True)
class GroundPatch:
    """A patch of ground with a different friction.

    Attributes:
        outline: corners in `odom` [m].
        friction: friction of the patch, divided by the friction of the ground around it [1].
    """

    outline: tuple[tuple[float, float], ...]
    friction: float

    @classmethod
    def of(cls, patch: FrictionPatch) -> GroundPatch:
        """Return a configured patch, a rectangle or an ellipse, as an outline in `odom`."""
        corners = rectangle(patch.length, patch.width)
        if patch.shape == "ellipse":
            angle = np.linspace(0.0, math.tau, 72, endpoint=False)
            axes = 0.5 * patch.length, 0.5 * patch.width
            corners = np.column_stack((np.cos(angle), np.sin(angle))) * axes
        outline = placed(corners, (patch.x, patch.y, math.radians(patch.heading_deg)))
        return cls(tuple((x, y) for x, y in outline.tolist()), patch.friction)


@dataclasses.dataclass(frozen=True)
class Scene:
    """A vehicle and its ground as seen from above.

    Attributes:
        chassis_length: length of the chassis along x of the body frame [m].
        chassis_width: width of the chassis along y of the body frame [m].
        wheels: position and orientation of each wheel, keyed by wheel name.
        center_of_gravity: common center of gravity of vehicle and load in the body frame [m]; None
            if unknown.
        load: position of the load in the body frame [m]; None if there is no load.
        patches: patches of ground with a different friction.
        chassis_center: center of the chassis in the body frame [m].
    """

    chassis_length: float
    chassis_width: float
    wheels: Mapping[str, WheelMount]
    center_of_gravity: tuple[float, float] | None = None
    load: tuple[float, float] | None = None
    patches: tuple[GroundPatch, ...] = ()
    chassis_center: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(cls, configuration: ExperimentConfiguration) -> Scene:
        """Return the vehicle and ground of an experiment."""
        vehicle = configuration.vehicle
        center = vehicle.masses.center
        return dataclasses.replace(
            cls.of_vehicle(vehicle),
            center_of_gravity=(float(center[0]), float(center[1])),
            load=(vehicle.load.x, vehicle.load.y) if vehicle.load.mass > 0.0 else None,
            patches=tuple(map(GroundPatch.of, configuration.ground.patches.values())),
        )

    @classmethod
    def of_vehicle(cls, vehicle: VehicleConfiguration) -> Scene:
        """Return the chassis and the wheels of a vehicle."""
        return cls(
            vehicle.chassis_length,
            vehicle.chassis_width,
            vehicle.wheels,
            chassis_center=vehicle.chassis_center,
        )

    @property
    def chassis(self) -> FloatArray:
        """Corners of the chassis in the body frame [m], shape (4, 2)."""
        return rectangle(self.chassis_length, self.chassis_width) + self.chassis_center

    def on_chassis(self, *points: tuple[float, float]) -> FloatArray:
        """Return points in the body frame [m], shape (M, 2).

        Args:
            *points: positions relative to the center of the chassis, divided by its length [1].
        """
        return self.chassis_length * np.array(points) + self.chassis_center

    @property
    def wheel_outlines(self) -> tuple[FloatArray, ...]:
        """Corners of each wheel in the body frame [m], shape (4, 2) each, in wheel order."""
        geometry = PlatformGeometry.from_wheels(self.wheels)
        outlines = []
        for row in range(len(geometry.names)):
            diameter = 2.0 * float(geometry.radius[row])
            heading = np.arctan2(geometry.rolling[row, 1], geometry.rolling[row, 0])
            mount = np.append(geometry.position[row], heading)
            outlines.append(placed(rectangle(diameter, _WHEEL_WIDTH * diameter), mount))
        return tuple(outlines)

    @property
    def load_arm(self) -> FloatArray | None:
        """Ends of the line from the chassis to a load outside it [m], shape (2, 2).

        None if there is no load outside the chassis.
        """
        if self.load is None:
            return None
        load = np.array(self.load)
        edge = np.clip(load, np.min(self.chassis, axis=0), np.max(self.chassis, axis=0))
        return None if np.array_equal(edge, load) else np.array([edge, load])

    @property
    def drawn_points(self) -> FloatArray:
        """Points whose convex hull contains the vehicle, in the body frame [m], shape (M, 2)."""
        points = [self.chassis, *self.wheel_outlines]
        points += [np.array([p]) for p in (self.load, self.center_of_gravity) if p is not None]
        return np.concatenate(points)


def rectangle(length: float, width: float) -> FloatArray:
    """Return the corners of a rectangle around the origin [m], `length` along x, shape (4, 2)."""
    return np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (length / 2.0, width / 2.0)


def placed(points: FloatArray, pose: tuple[float, float, float] | FloatArray) -> FloatArray:
    """Return points of a frame in world coordinates [m], shape (M, 2).

    Args:
        points: points in the frame [m], shape (M, 2).
        pose: x, y [m] and yaw [rad] of the frame in the world.
    """
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    turned = points @ np.array([(cos, sin), (-sin, cos)])
    return np.asarray(turned + np.asarray(pose[:2]), dtype=np.float64)


def ahead_up(points: FloatArray) -> FloatArray:
    """Return points of the body frame, shape (M, 2), rotated so that forward is up in a figure."""
    return np.column_stack((-points[:, 1], points[:, 0]))


def overlap(a: FloatArray, b: FloatArray) -> bool:
    """Return whether two convex outlines, or lines between two points, have a point in common.

    Args:
        a: corners in order [m], shape (M, 2), at least two.
        b: corners in order [m], shape (K, 2), at least two.
    """
    # Separating axes: convex outlines are disjoint if their projections on the direction or normal
    # of some edge are disjoint.
    edges = np.concatenate([np.roll(a, 1, axis=0) - a, np.roll(b, 1, axis=0) - b])
    axes = np.concatenate([edges, edges[:, ::-1] * (-1.0, 1.0)])
    shadow_a, shadow_b = axes @ a.T, axes @ b.T
    apart = (shadow_a.max(axis=1) < shadow_b.min(axis=1)) | (
        shadow_b.max(axis=1) < shadow_a.min(axis=1)
    )
    return not bool(np.any(apart))
