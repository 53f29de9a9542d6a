"""Bringing together the batches of several line cameras that belong to the same time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from linescan_odometry.odometry import LineBatch

_PATIENCE = 2  # batches that the others may deliver while one camera is waited for


class BatchCollector:
    """Groups batches by their stamps, in whatever order the cameras deliver.

    Batches belong together when their stamps differ by no more than the skew. A camera is waited
    for until another one has delivered two batches more; then the group is handed on without it,
    and nobody waits for it again until it speaks. What comes too late for its group is dropped:
    the odometry sees a gap in that camera's lines and starts its chain anew.
    """

    def __init__(self, sensors: Iterable[str], maximum_skew: float) -> None:
        """Prepare for these cameras.

        Args:
            sensors: names; a group lists its batches in this order.
            maximum_skew: largest difference of stamps within a group [s].
        """
        self._skew_ns = round(1e9 * maximum_skew)
        self._pending: dict[str, deque[LineBatch]] = {name: deque() for name in sensors}
        self._last_ns: dict[str, int] = {}  # of each camera
        self._silent: set[str] = set()
        self._handed_on_ns: int | None = None  # newest stamp of the groups so far

    def add(self, sensor: str, batch: LineBatch) -> list[dict[str, LineBatch]]:
        """Take a batch and return the groups that are ready, oldest first.

        Args:
            sensor: name of a camera.
            batch: its lines.

        Raises:
            KeyError: the camera is not one of those that were declared.
        """
        queue = self._pending[sensor]
        if batch.stamp_ns <= self._last_ns.get(sensor, batch.stamp_ns - 1):
            self._start_anew()  # its time went back: a recording that is played again
        self._last_ns[sensor] = batch.stamp_ns
        self._silent.discard(sensor)
        if self._handed_on_ns is not None and batch.stamp_ns <= self._handed_on_ns:
            return []
        queue.append(batch)
        ready = []
        while group := self._take_group():
            ready.append(group)
        return ready

    def _start_anew(self) -> None:
        for queue in self._pending.values():
            queue.clear()
        self._last_ns.clear()
        self._handed_on_ns = None

    def _take_group(self) -> dict[str, LineBatch]:
        """Return the oldest group if nothing more is to be waited for, else an empty one."""
        oldest = {name: queue[0] for name, queue in self._pending.items() if queue}
        awaited = self._pending.keys() - oldest.keys() - self._silent
        backlog = max(len(queue) for queue in self._pending.values())
        if not oldest or (awaited and backlog <= _PATIENCE):
            return {}
        self._silent |= awaited
        until_ns = min(batch.stamp_ns for batch in oldest.values()) + self._skew_ns
        group = {name: batch for name, batch in oldest.items() if batch.stamp_ns <= until_ns}
        for name in group:
            self._pending[name].popleft()
        self._handed_on_ns = max(batch.stamp_ns for batch in group.values())
        return group
