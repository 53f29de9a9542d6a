"""Plausibility check of displacements by an acceleration limit (dissertation, section 4.6).

In the time ``dt`` since the last measurement, the velocity along an axis cannot have changed by
more than ``a dt``, where ``a`` is the acceleration limit. Displacements that contradict this limit
are rejected. The permitted range grows with time, so a faulty last measurement or a shock excludes
the sensor for a limited time only.
"""

import numpy as np

from linescan_odometry.matching.search import PairDisplacements
from omni_core.quantities import BoolArray, FloatArray
from omni_core.sensors import LineSensor


class Plausibility:
    """Rejects displacements that differ too much from the last measured displacement.

    The limit on the difference follows from the acceleration limit and the elapsed time.

    Attributes:
        limit: limit on the acceleration of the sensor along its axis [m/s^2]; 0 for no limit.
    """

    def __init__(self, sensor: LineSensor, maximum_acceleration: float, tolerance: float) -> None:
        """Create the plausibility check for one line camera.

        Args:
            sensor: configuration of the line camera.
            maximum_acceleration: the attribute `limit`.
            tolerance: limit on the error of a displacement, added to the permitted difference [px].
        """
        self.limit = maximum_acceleration
        self._period_ns = 1e9 / sensor.line_rate
        # Limit on the rate of change of the displacement per line [px/ns].
        self._rate = maximum_acceleration / (sensor.pixel_pitch * sensor.line_rate) * 1e-9
        self._tolerance = tolerance
        self._displacement = 0.0
        self._stamp_ns: float | None = None

    def reset(self) -> None:
        """Discard the last measurement; every displacement is plausible until the next one."""
        self._stamp_ns = None

    def mark(self, stamp_ns: int, pairs: PairDisplacements) -> int:
        """Mark implausible displacements as unusable, and return their number.

        Displacements that were already unusable are not counted.

        Args:
            stamp_ns: time of exposure of the newest line [ns].
            pairs: displacements of consecutive lines; the last pair ends at the newest line. The
                array `usable` is changed in place.
        """
        off = pairs.usable & ~self.check(stamp_ns, pairs.displacement)
        pairs.usable[off] = False
        return int(np.count_nonzero(off))

    def check(self, stamp_ns: int, displacement: FloatArray) -> BoolArray:
        """Return whether each displacement is plausible, shape (m,).

        Args:
            stamp_ns: time of exposure of the newest line [ns].
            displacement: displacements of consecutive pairs of lines [px], shape (m,); the last
                pair ends at the newest line.
        """
        if self._rate == 0.0 or self._stamp_ns is None or stamp_ns < self._stamp_ns:  # replay
            return np.ones(len(displacement), np.bool_)
        age_ns = self._period_ns * np.arange(len(displacement) - 1, -1, -1)
        allowed = self._tolerance + self._rate * abs(stamp_ns - age_ns - self._stamp_ns)
        return abs(displacement - self._displacement) <= allowed

    def accept(self, stamp_ns: int, lines: int, displacement: float) -> None:
        """Store a measurement, with which later displacements are compared.

        Args:
            stamp_ns: time of exposure of the newest line [ns].
            lines: number of line pairs that were measured.
            displacement: mean displacement per line [px].
        """
        self._displacement = displacement
        self._stamp_ns = stamp_ns - 0.5 * self._period_ns * (lines - 1)
