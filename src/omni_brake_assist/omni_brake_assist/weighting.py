"""Weight of the parallel component by the angle of a wheel: Eqs. (55)-(59), Figure 28.

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 3.4.3. The angle delta is the one between the *line* of the active direction and the
wheel's velocity, 0 to pi/2: 0 is a wheel that brakes best, pi/2 one that cannot brake at all.
"""

import dataclasses
import math

import numpy as np

from omni_platform.kernels import lean
from omni_platform.quantities import FloatArray

WEIGHTINGS = ("zero", "cosine", "enhanced")
ZERO, COSINE, ENHANCED = range(3)  # numbers of the weightings


@lean
def psi(kind: int, k: int, delta: float) -> float:
    """Return the weight of a wheel [1].

    Args:
        kind: number of the weighting, its index in `WEIGHTINGS`.
        k: tuning constant of ``enhanced``, odd and positive [1].
        delta: angle [rad], 0 to pi/2.
    """
    if kind == ZERO:
        return 0.0
    if kind == COSINE:
        return math.cos(delta)
    # At pi/2 rounding may make the base slightly negative.
    base = max(2.0 - (4.0 / math.pi) * delta - math.cos(delta), 0.0)
    return float(base**k)  # Eq. (59)


@dataclasses.dataclass(frozen=True)
class Weighting:
    """A weighting ``psi(delta)``.

    Attributes:
        kind: number of the weighting, its index in `WEIGHTINGS`.
        k: tuning constant of ``enhanced`` [1]; the others ignore it.
    """

    kind: int
    k: int

    def __call__(self, delta: FloatArray) -> FloatArray:
        """Return the weights [1] of angles [rad], 0 to pi/2, any shape."""
        weights = [psi(self.kind, self.k, angle) for angle in np.ravel(delta).tolist()]
        return np.array(weights).reshape(np.shape(delta))


def zero_weighting(delta: FloatArray) -> FloatArray:
    """Return ``psi = 0``, Solution 1 of section 3.4.3: only orientation and line count.

    Args:
        delta: angles [rad], 0 to pi/2, any shape.
    """
    return Weighting(ZERO, 1)(delta)


def cosine_weighting(delta: FloatArray) -> FloatArray:
    """Return ``psi = cos(delta)``, which favors a short stop over orientation.

    Args:
        delta: angles [rad], 0 to pi/2, any shape.
    """
    return Weighting(COSINE, 1)(delta)


def enhanced_weighting(delta: FloatArray, k: int) -> FloatArray:
    """Return ``psi = (2 - 4 delta / pi - cos(delta))^k``, Eq. (59), between the other two.

    The base falls steadily from 1 to 0, so a larger k comes closer to `zero_weighting`.

    Args:
        delta: angles [rad], 0 to pi/2, any shape.
        k: tuning constant, odd and positive [1].

    Raises:
        ValueError: k is even or not positive.
    """
    check_tuning_constant(k)
    return Weighting(ENHANCED, k)(delta)


def check_tuning_constant(k: int) -> None:
    """Raise ValueError unless k is an odd positive whole number, as Eq. (58) requires."""
    if k < 1 or k % 2 == 0:
        raise ValueError(f"{k} is not an odd positive whole number, as Eq. (58) needs: 1, 3, 5, 7")


def weighting_function(name: str, k: int) -> Weighting:
    """Return the weighting of the given name as a function of delta [rad].

    Args:
        name: one of `WEIGHTINGS`.
        k: tuning constant of ``enhanced`` [1], odd and positive; the others ignore it.

    Raises:
        ValueError: the name is unknown, or k does not fit.
    """
    if name not in WEIGHTINGS:
        raise ValueError(f"{name!r} is not one of {', '.join(WEIGHTINGS)}")
    if name == "enhanced":
        check_tuning_constant(k)
    return Weighting(WEIGHTINGS.index(name), k)
