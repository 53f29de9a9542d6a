"""Bringing together the batches of several line cameras that belong to the same time."""

from __future__ import annotations

from collections.abc import Mapping

from linescan_odometry.odometry import LineBatch
from omni_platform.sensors import LineSensor


class BatchCollector:
    """Groups batches by time until every camera has delivered, or has fallen behind.

    A group is complete when it has a batch of each camera. A camera that delivers its next batch
    before the others have delivered theirs shows that they are silent: the group is then handed
    on without them, and the odometry counts them as unmeasured.
    """

    def __init__(self, sensors: Mapping[str, LineSensor]) -> None:
        self._sensors = tuple(sensors)
        self._pending: dict[str, LineBatch] = {}

    def add(self, sensor: str, batch: LineBatch) -> list[dict[str, LineBatch]]:
        """Take a batch and return the groups that are ready, oldest first.

        Args:
            sensor: name of a camera.
            batch: its lines.

        Raises:
            KeyError: the camera is not one of those that were declared.
        """
        if sensor not in self._sensors:
            raise KeyError(sensor)
        ready = []
        if sensor in self._pending:
            ready.append(self._take())
        self._pending[sensor] = batch
        if len(self._pending) == len(self._sensors):
            ready.append(self._take())
        return ready

    def _take(self) -> dict[str, LineBatch]:
        # In the declared order, whichever camera came first.
        group = {name: self._pending[name] for name in self._sensors if name in self._pending}
        self._pending.clear()
        return group
