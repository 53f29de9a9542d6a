"""Weight of the parallel error component as a function of a wheel's angle, Eqs. (55)-(59).

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 3.4.3. The angle delta, 0 to pi/2, is the unsigned angle between the axis along the active
direction and the wheel's velocity. A wheel with an angle of 0 brakes best; a wheel with an angle of
pi/2 cannot brake at all.
"""

import dataclasses
import math

import numpy as np

from omni_brake_assist.configuration import WEIGHTINGS, check_tuning_constant
from omni_core.kernels import lean
from omni_core.quantities import FloatArray

ZERO, COSINE, ENHANCED = range(3)  # numbers of the weightings


@lean
def psi(kind: int, k: int, delta: float) -> float:
    """Return the weight of the parallel error component of a wheel [1].

    ``zero`` is Solution 1 of section 3.4.3, in which only orientation and line of motion count.
    ``cosine`` prefers a short stop to a constant orientation. ``enhanced`` is a compromise between
    the two: it is the k-th power of a function that falls monotonically from 1 to 0. With a larger
    k it is therefore closer to ``zero``.

    Args:
        kind: number of the weighting, its index in `WEIGHTINGS`.
        k: tuning constant of ``enhanced``, odd and positive [1].
        delta: angle [rad], 0 to pi/2.
    """
    if kind == ZERO:
        return 0.0
    if kind == COSINE:
        return math.cos(delta)
    # Rounding may make the base slightly negative at pi/2.
    base = max(2.0 - (4.0 / math.pi) * delta - math.cos(delta), 0.0)
    return float(base**k)  # Eq. (59), the simplified Eq. (58)


@dataclasses.dataclass(frozen=True)
class Weighting:
    """Function ``psi(delta)``: weight of the parallel error component of a wheel, Figure 28.

    Delta is the angle between the active direction and the velocity of the wheel.

    Attributes:
        kind: number of the weighting, its index in `WEIGHTINGS`.
        k: tuning constant of ``enhanced`` [1]; other weightings ignore it.
    """

    kind: int
    k: int

    def __call__(self, delta: FloatArray) -> FloatArray:
        """Return the weights [1] for angles [rad] from 0 to pi/2 in an array of any shape."""
        weights = [psi(self.kind, self.k, angle) for angle in np.ravel(delta).tolist()]
        return np.array(weights).reshape(np.shape(delta))


def weighting_function(name: str, k: int) -> Weighting:
    """Return the weighting with the given name, a function of the angle delta [rad].

    Args:
        name: one of `WEIGHTINGS`.
        k: tuning constant of ``enhanced`` [1], odd and positive; other weightings ignore it.

    Raises:
        ValueError: the name is unknown, or the name is ``enhanced`` and k is not odd and positive.
    """
    if name not in WEIGHTINGS:
        raise ValueError(f"{name!r} is not one of {', '.join(WEIGHTINGS)}")
    if name == "enhanced":
        check_tuning_constant(k)
    return Weighting(WEIGHTINGS.index(name), k)
