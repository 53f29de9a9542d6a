"""Recorded values with their own stamps: wheel forces and test ratios of the sources."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from omni_loop.history import RunHistory
from omni_loop.recorded_run import read_streams
from omni_platform.quantities import FloatArray, IntArray
from omni_platform.topics import MARKERS, TEST_RATIOS
from omni_recording import decode, folder
from omni_recording.error import BagError

_NAMESPACE = "wheel_forces"
_METERS_PER_NEWTON = 1e-4  # scale of the simulator's arrows [m/N]


class Series(NamedTuple):
    """Time series of K values at M stamps.

    Attributes:
        stamp_ns: stamps [ns], increasing, shape (M,).
        values: values in the unit of their source, shape (M, K).
        names: names of the columns; empty if they are those of the run's wheels.
    """

    stamp_ns: IntArray
    values: FloatArray
    names: tuple[str, ...] = ()

    def during(self, history: RunHistory) -> Series | None:
        """Return the part within the time of a history; None if there is none."""
        first, last = history.stamp_ns[[0, -1]]
        part = (self.stamp_ns >= first) & (self.stamp_ns <= last)
        return Series(self.stamp_ns[part], self.values[part], self.names) if any(part) else None


def read_wheel_forces(bag_folder: Path | str, wheels: int) -> Series | None:
    """Read the forces of the wheels on the vehicle from the markers of a recording.

    Args:
        bag_folder: rosbag2 folder, or a single ``.mcap`` file.
        wheels: number of wheels in the markers.

    Returns:
        Components x and y of each wheel's force in `odom` [N], wheel by wheel in the order of the
        recording; None if no marker shows the forces of this number of wheels.

    Raises:
        BagError: the recording or a marker in it cannot be read.
    """
    found: dict[int, list[float]] = {}
    bag = folder.open_vehicle(bag_folder)
    for recorded, message in decode.decoded_messages(bag, (MARKERS.path,)):
        if recorded.channel.type_name != MARKERS.type:
            continue
        markers = (marker for marker in message.markers if marker.ns == _NAMESPACE)
        arrows = [marker for marker in markers if len(marker.points) == 2]
        if [marker.id for marker in arrows] == list(range(wheels)):
            stamp_ns = decode.header_stamp_ns(arrows[0])
            if stamp_ns is not None:
                ends = [arrow.points for arrow in arrows]
                lengths = [d for a, b in ends for d in (b.x - a.x, b.y - a.y)]
                found[stamp_ns] = [length / _METERS_PER_NEWTON for length in lengths]
    if not found:
        return None
    stamps, values = zip(*sorted(found.items()), strict=True)
    return Series(np.array(stamps, dtype=np.int64), np.array(values, dtype=np.float64))


def read_test_ratios(bag_folder: Path | str) -> Series | None:
    """Return the test ratios that the assistant's fault detection published, None without any.

    A ratio is the normalized innovation squared divided by its gate [1], NaN without an innovation.

    Raises:
        BagError: the recording cannot be read, or its messages name different sources.
    """
    bag = folder.open_vehicle(bag_folder)
    stream = read_streams(bag, (TEST_RATIOS,)).get(TEST_RATIOS.name)
    if stream is None:
        return None
    names = tuple(stream.messages[0].name)
    for message in stream.messages:
        if tuple(message.name) != names or len(message.position) != len(names):
            raise BagError(bag.path, f"{TEST_RATIOS.path} names different sources")
    rows = np.array([message.position for message in stream.messages], dtype=np.float64)
    return Series(stream.stamp_ns, rows, names)
