"""Geometry of a vehicle and its ground for the figures, and the moments to show.

`choose_snapshots` selects moments during braking that the top view can show without overlap.
The first snapshot shows the start of braking, and the last snapshot shows the final position.
Between them, as many snapshots as fit are taken at round times, about equally spaced along the
longest path of all variants. All variants are shown at the same moments, so that they can be
compared. If the vehicle or its arrow would overlap an earlier snapshot, the snapshot is shifted to
a moment shortly before or after, or it is omitted.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from omni_core.geometry import PlatformGeometry, WheelMount
from omni_core.quantities import FloatArray
from omni_runs.history import RunHistory
from omni_runs.metrics import rest_stamp
from omni_sim.ground.configuration import FrictionPatch

if TYPE_CHECKING:
    from omni_runs.experiment import ExperimentConfiguration
    from omni_sim.vehicle.configuration import VehicleConfiguration

# Drawn width of a wheel per diameter [1], because the configuration has no wheel width.
_WHEEL_WIDTH = 0.45
_STEPS = (10.0, 5.0, 1.0, 0.5, 0.1, 0.05, 0.01)  # round times are multiples of one of these [s]
_SHIFTS = (0, 1, -1, 2, -2)  # steps from the common moment, in order of preference


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


@dataclasses.dataclass(frozen=True)
class Snapshots:
    """Moments to draw: indices of the time stamps in a run, and labels with the times."""

    indices: tuple[int, ...]
    labels: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class _Span:
    """Part of a run from the start of braking to rest, as indices of stamps."""

    history: RunHistory
    start: int
    stop: int

    @property
    def duration(self) -> float:
        return float(self.history.braking_time[self.stop])

    @property
    def traveled(self) -> FloatArray:
        """Distance along the path since the start of the span [m], shape (stamps of the span,)."""
        steps = np.diff(self.history.pose[self.start : self.stop + 1, :2], axis=0)
        return np.append(0.0, np.cumsum(np.hypot(steps[:, 0], steps[:, 1])))

    def stamp_at(self, instant: float) -> int:
        return int(np.searchsorted(self.history.braking_time, instant - 1e-9))


def choose_snapshots(
    scene: Scene, histories: Mapping[str, RunHistory], arrow_scale: float, most: int = 7
) -> dict[str, Snapshots]:
    """Return the snapshots to draw of every variant, keyed by variant.

    Args:
        scene: the vehicle.
        histories: time history of each variant's run, keyed by variant; at least one.
        arrow_scale: length of a velocity arrow per speed [m / (m/s)].
        most: limit on the number of snapshots.
    """
    spans = {name: _span(history) for name, history in histories.items()}
    longest = max(spans.values(), key=lambda span: float(span.traveled[-1]))
    step = next((s for s in _STEPS if 20.0 * s <= longest.duration), _STEPS[-1])
    choices = [
        _free_instants(scene, longest, _equal_distances(longest, count, step), step, arrow_scale)
        for count in range(most - 1)
    ]
    common = max(choices, key=len)
    return {
        name: _snapshots(span, _free_instants(scene, span, common, step, arrow_scale))
        for name, span in spans.items()
    }


def velocity_arrow(
    scene: Scene, history: RunHistory, index: int, arrow_scale: float, shortest: float = 0.1
) -> FloatArray | None:
    """Return tail and tip of the velocity arrow of a snapshot in `odom` [m], shape (2, 2).

    Args:
        scene: the vehicle.
        history: time history of the vehicle's run.
        index: index of the time stamp in the history.
        arrow_scale: length of a velocity arrow per speed [m / (m/s)].
        shortest: length of the shortest arrow, as a multiple of the chassis length.

    Returns:
        Tail and tip; None if the vehicle is too slow for an arrow.
    """
    tail = history.pose[index, :2]
    arrow = arrow_scale * history.velocity_world[index]
    if np.hypot(*arrow) <= shortest * scene.chassis_length:
        return None
    return np.array([tail, tail + arrow])


def snapshot_outlines(
    scene: Scene, history: RunHistory, index: int, arrow_scale: float, clearance: float = 0.1
) -> list[FloatArray]:
    """Return the outlines of a snapshot: chassis, wheels, load arm and velocity arrow.

    Args:
        scene: the vehicle.
        history: time history of the vehicle's run.
        index: index of the time stamp in the history.
        arrow_scale: length of a velocity arrow per speed [m / (m/s)].
        clearance: minimum distance between an arrow's tip or a load and other elements, as a
            multiple of the chassis length.

    Returns:
        Corners of an outline or both ends of a line, in `odom` [m], shape (4, 2) or (2, 2) each.
    """
    pose = history.pose[index]
    outlines = [placed(corners, pose) for corners in (scene.chassis, *scene.wheel_outlines)]
    arm = None if scene.load_arm is None else placed(scene.load_arm, pose)
    for line in (arm, velocity_arrow(scene, history, index, arrow_scale)):
        if line is not None:
            along = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
            tip = line[1] + clearance * scene.chassis_length * along
            outlines.append(np.array([line[0], tip]))
    return outlines


def _span(history: RunHistory) -> _Span:
    start = history.brake_start or 0
    stop = rest_stamp(history.twist, start)
    return _Span(history, start, len(history.stamp_ns) - 1 if stop is None else stop)


def _equal_distances(span: _Span, count: int, step: float) -> list[float]:
    """Return times [s] that divide the path of a run into about equal distances.

    Args:
        span: the run from the start of braking to rest.
        count: limit on the number of times.
        step: the times are rounded to multiples of this time [s].
    """
    traveled = span.traveled
    wanted = traveled[-1] * np.arange(1, count + 1) / (count + 1)
    stamps = span.start + np.searchsorted(traveled, wanted)
    return sorted({round(round(t / step) * step, 3) for t in span.history.braking_time[stamps]})


def _free_instants(
    scene: Scene, span: _Span, instants: Iterable[float], step: float, arrow_scale: float
) -> list[float]:
    """Return times [s] of snapshots that overlap neither each other nor the first and last one.

    Args:
        scene: the vehicle.
        span: the run from the start of braking to rest.
        instants: preferred times [s]; each is shifted by up to two steps or omitted.
        step: step of the shifts [s].
        arrow_scale: length of a velocity arrow per speed [m / (m/s)].
    """
    last = len(span.history.stamp_ns) - 1
    taken = [snapshot_outlines(scene, span.history, i, arrow_scale) for i in (span.start, last)]
    free = []
    for instant in instants:
        for shift in _SHIFTS:
            moved = round(instant + shift * step, 3)
            if not 0.0 < moved < span.duration:
                continue
            outlines = snapshot_outlines(scene, span.history, span.stamp_at(moved), arrow_scale)
            if not any(overlap(a, b) for a in outlines for others in taken for b in others):
                free.append(moved)
                taken.append(outlines)
                break
    return sorted(free)


def _snapshots(span: _Span, between: Sequence[float]) -> Snapshots:
    indices = [span.start, *(span.stamp_at(instant) for instant in between)]
    labels = ["0 s", *(f"{instant:g} s" for instant in between)]
    last = len(span.history.stamp_ns) - 1  # the vehicle may rock a little after it stops
    if last not in indices:
        indices.append(last)
        labels.append(f"{span.duration:.2f} s")
    return Snapshots(tuple(indices), tuple(labels))
