"""Forces of the wheels on the vehicle, from the recorded markers."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omni_platform.quantities import FloatArray
from omni_platform.topics import MARKERS
from omni_recording import decode, folder
from omni_recording.error import BagError

_NAMESPACE = "wheel_forces"
_METERS_PER_NEWTON = 1e-4  # of the simulator's arrows


@dataclasses.dataclass(frozen=True)
class WheelForces:
    """Forces of the wheels on the vehicle at M stamps of a run.

    Attributes:
        stamp_ns: [ns], increasing, shape (M,).
        force: force in `odom` [N], in the order of the recorded wheels, shape (M, N, 2).
    """

    stamp_ns: NDArray[np.int64]
    force: FloatArray


def read_wheel_forces(bag_folder: Path | str, wheels: int) -> WheelForces | None:
    """Read the wheel forces from the markers of a recording.

    Args:
        bag_folder: rosbag2 folder, or a single ``.mcap`` file.
        wheels: how many there must be.

    Returns:
        The forces, None if no marker shows the forces of that many wheels.

    Raises:
        BagError: the recording or a marker in it cannot be read.
    """
    decoder = decode.MessageDecoder()
    found: dict[int, list[tuple[float, float]]] = {}
    for recorded in folder.bag_messages(folder.open_vehicle(bag_folder)):
        if (recorded.channel.topic, recorded.channel.type_name) != (MARKERS.path, MARKERS.type):
            continue
        try:
            message = decoder.decode(recorded)
        except decode.DecodeError as error:
            raise BagError(Path(bag_folder), f"{MARKERS.path}: {error}") from None
        arrows = [marker for marker in message.markers if marker.ns == _NAMESPACE]
        arrows = [marker for marker in arrows if len(marker.points) == 2]
        if [marker.id for marker in arrows] == list(range(wheels)):
            stamp_ns = decode.header_stamp_ns(arrows[0])
            if stamp_ns is not None:
                found[stamp_ns] = [_force(marker.points) for marker in arrows]
    if not found:
        return None
    stamps = sorted(found)
    force = np.array([found[stamp] for stamp in stamps], dtype=np.float64)
    return WheelForces(np.array(stamps, dtype=np.int64), force)


def _force(points: Sequence[Any]) -> tuple[float, float]:
    """Return the force [N] of an arrow from its tail to its head [m]."""
    tail, head = points
    return (head.x - tail.x) / _METERS_PER_NEWTON, (head.y - tail.y) / _METERS_PER_NEWTON
