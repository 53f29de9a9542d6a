"""How strongly the parallel component counts, by the angle of a wheel: Eqs. (55)-(59), Figure 28.

Source: V. Kalman, "On modeling and control of omnidirectional wheels", BME Budapest 2013,
section 3.4.3. The angle delta is the one between the *line* of the active direction and the
wheel's velocity, 0 to pi/2: 0 is a wheel that brakes best, pi/2 one that cannot brake at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Weighting = Callable[[FloatArray], FloatArray]

WEIGHTINGS = ("zero", "cosine", "enhanced")


def zero_weighting(delta: FloatArray) -> FloatArray:
    """Return ``psi = 0``, Solution 1 of section 3.4.3: nothing counts but orientation and line.

    Args:
        delta: angles [rad], 0 to pi/2, any shape.
    """
    return np.zeros_like(delta)


def cosine_weighting(delta: FloatArray) -> FloatArray:
    """Return ``psi = cos(delta)``, which favours a short stop over orientation.

    Args:
        delta: angles [rad], 0 to pi/2, any shape.
    """
    return np.cos(delta)


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
    base = 2.0 - (4.0 / math.pi) * delta - np.cos(delta)
    # Rounding leaves the base at pi/2 a hair from zero, on either side.
    psi: FloatArray = np.maximum(base, 0.0) ** k
    return psi


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
    if name == "zero":
        return zero_weighting
    if name == "cosine":
        return cosine_weighting
    if name == "enhanced":
        check_tuning_constant(k)
        return lambda delta: enhanced_weighting(delta, k)
    raise ValueError(f"{name!r} is not one of {', '.join(WEIGHTINGS)}")
