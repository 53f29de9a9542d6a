"""Motion of each camera across its axis in the last second."""

import bisect
from collections.abc import Iterable, Mapping

import numpy as np

from omni_core.quantities import FloatArray

GAP_NS = 50_000_000
"""Limit on the time without a twist over which the motion is extrapolated, and time for which the
view of an occluded camera must change before the camera is used again [ns]."""

HARDEST_STOP = 15.0
"""Limit on the deceleration of a vehicle [m/s^2]; a hard stop on a dry road reaches 10."""

CERTAIN = 4.0
"""Standard deviations by which two velocities of a camera must differ to contradict each other."""

_REMEMBERED_NS = 1_280_000_000  # ns; longer than the largest age of a keyframe


class PathsAcross:
    """Integrates the velocity of each camera across its axis.

    Attributes:
        stamps: stamps of the stored velocities, without a gap of `GAP_NS` [ns].
    """

    def __init__(self, names: Iterable[str]) -> None:
        """Create paths without any velocity.

        Args:
            names: names of the cameras.
        """
        self._names = tuple(names)
        self.stamps: list[int] = []
        self._paths: list[FloatArray] = []  # distance across each axis [m]

    def append(self, stamp_ns: int, across: Mapping[str, float]) -> None:
        """Store velocities, and integrate them since the stamp before.

        Args:
            stamp_ns: stamp of the velocities [ns].
            across: velocity of each camera across its axis [m/s].
        """
        if self.stamps and not 0 < stamp_ns - self.stamps[-1] < GAP_NS:
            self.stamps.clear()
            self._paths.clear()
        path = np.zeros(len(self._names))
        if self.stamps:
            elapsed = 1e-9 * (stamp_ns - self.stamps[-1])
            path = self._paths[-1] + elapsed * np.array([across[name] for name in self._names])
        self._paths.append(path)
        self.stamps.append(stamp_ns)
        while stamp_ns - self.stamps[0] >= _REMEMBERED_NS:
            del self.stamps[0], self._paths[0]

    def length(self, name: str, stamp_ns: int, age: float, across: float) -> float:
        """Return how far a camera has moved across its axis in the last `age` seconds [m].

        Before the first stored velocity, the motion is assumed to be zero.

        Args:
            name: name of the camera.
            stamp_ns: present time [ns].
            age: duration of the motion [s].
            across: present velocity across the axis [m/s].
        """
        since = stamp_ns - round(1e9 * age)
        if not self.stamps or since >= self.stamps[-1]:
            return abs(across) * age
        newest = 1e-9 * (stamp_ns - self.stamps[-1])
        after = bisect.bisect(self.stamps, since)
        number = self._names.index(name)
        path = float(self._paths[-1][number] - self._paths[after][number])
        if after > 0:
            begin, end = self.stamps[after - 1], self.stamps[after]
            step = float(self._paths[after][number] - self._paths[after - 1][number])
            path += step * (end - since) / (end - begin)
        return abs(path + across * (newest if 1e9 * newest < GAP_NS else 0.0))
