"""Selection of moments during braking that the top view can show without overlap.

The first snapshot shows the start of braking, and the last snapshot shows the final position.
Between them, as many snapshots as fit are taken at round times, about equally spaced along the
longest path of all variants. All variants are shown at the same moments, so that they can be
compared. If the vehicle or its arrow would overlap an earlier snapshot, the snapshot is shifted to
a moment shortly before or after, or it is omitted.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from omni_core.quantities import FloatArray
from omni_runs.figures.scene import Scene, overlap, placed
from omni_runs.history import RunHistory
from omni_runs.metrics import rest_stamp

_STEPS = (10.0, 5.0, 1.0, 0.5, 0.1, 0.05, 0.01)  # round times are multiples of one of these [s]
_SHIFTS = (0, 1, -1, 2, -2)  # steps from the common moment, in order of preference


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
