"""Tolerances of signals: differences that another processor may cause in the same computation.

NumPy, OpenBLAS and numba use the instructions of the processor at hand, which round differently.
The odometry processes lines in single precision, so that the last digits of the twist differ.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from omni_core import topics

Values = Mapping[str, float]
"""Values of a message in their units, keyed by the names that `table.flatten` gives them."""

_SHARE_OF_DEVIATION = 0.01
"""Share of the stated standard deviation [1]; the error of the measurement is 100 times as large.
A covariance that differs by this share changes a standard deviation by half of it."""
_ERROR = 1e-4
"""Error of a wheel [m/s]: the share above of the deviation of an accurate twist, 0.01 m/s."""
_SIDESLIP = 1e-4
"""Sideslip angle [rad]: the same at a speed of 1 m/s."""
_ENABLE = 0.01
"""Share of a brake [1]. The enables of on-off brakes, which are 0 or 1, must therefore be equal."""
_AXES = ("linear.x", "linear.y", "linear.z", "angular.x", "angular.y", "angular.z")


class Tolerance(NamedTuple):
    """Differences between two recordings of a signal that are accepted.

    Attributes:
        limits: function that returns the largest difference of each value of a message, in the unit
            of the value; a value without a limit must be equal.
        moved_switches: number of values in a recording that may switch one message earlier or later
            than in the other recording.
    """

    limits: Callable[[Values], Values]
    moved_switches: int = 0


def absolute(limit: float, moved_switches: int = 0) -> Tolerance:
    """Return the same tolerance for all values of a signal, in the unit of each value."""
    return Tolerance(lambda values: dict.fromkeys(values, limit), moved_switches)


def _limits_of_twist(values: Values) -> Values:
    """Return the limits for a ``TwistWithCovarianceStamped``, from its own covariance.

    The entries of the covariance have different units, and some are zero. Each entry is therefore
    compared with the product of the standard deviations of its row and its column.
    """
    variances = (values[f"twist.covariance[{7 * i}]"] for i in range(6))
    deviations = [math.sqrt(max(variance, 0.0)) for variance in variances]
    limits = {}
    for i, (axis, deviation) in enumerate(zip(_AXES, deviations, strict=True)):
        limits[f"twist.twist.{axis}"] = _SHARE_OF_DEVIATION * deviation
        for j, other in enumerate(deviations):
            limits[f"twist.covariance[{6 * i + j}]"] = _SHARE_OF_DEVIATION * deviation * other
    return limits


TOLERANCES = {
    topics.TWIST.path: Tolerance(_limits_of_twist),
    topics.SIDESLIP.path: absolute(_SIDESLIP),
    # The sign of a wheel's error decides on its enable. The error may cross zero so close to a
    # message that rounding decides whether this message or the next has the other sign.
    topics.ENABLE.path: absolute(_ENABLE, moved_switches=1),
    topics.SLIDING.path: absolute(_ERROR),
}
"""Tolerance of each signal, keyed by topic; the values of all other topics must be equal."""
