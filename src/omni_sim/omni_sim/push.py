"""External force on the chassis for some time, as from a collision or a person."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_core.quantities import FloatArray


class Push(NamedTuple):
    """A constant force on the chassis, and its moment.

    Attributes:
        time: onset after the start of the run [s].
        duration: duration [s].
        force: force along x and y of the world frame [N, N].
        moment: moment of the force about the center of gravity [N m].
    """

    time: float
    duration: float
    force: tuple[float, float]
    moment: float

    def at(self, time: NDArray[np.floating]) -> FloatArray:
        """Return force [N, N] and moment [N m] at times [s] of a run, shape (T, 3)."""
        since = np.round(time - self.time, 9)  # to a nanosecond, as the stamps
        acts = (since >= 0.0) & (since < np.round(self.duration, 9))
        return np.asarray(np.outer(acts, (*self.force, self.moment)), dtype=np.float64)


NO_PUSH = Push(0.0, 0.0, (0.0, 0.0), 0.0)
"""No force."""
