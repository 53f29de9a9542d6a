"""Detection of a placement: the vehicle was moved to another pose, and did not drive there."""

import math
from collections.abc import Sequence

from omni_core.quantities import GRAVITY

RESOLUTION = 0.01  # [m] a smaller displacement affects neither the trail nor the metrics of a stop

TimedMotion = tuple[int, Sequence[float], Sequence[float]]
"""Stamp [ns], pose x, y, yaw [m, m, rad], and body twist [m/s, m/s, rad/s]"""


def was_placed(before: TimedMotion, after: TimedMotion) -> bool:
    """Return whether a vehicle was placed elsewhere between two stamps.

    It did not drive there if the distance exceeds the longest path that is possible with the speeds
    at both stamps and an acceleration of 1 g in between (friction coefficient 1).
    """
    duration = (after[0] - before[0]) / 1e9
    mean_speed = (math.hypot(*before[2][:2]) + math.hypot(*after[2][:2])) / 2.0
    longest = mean_speed * duration + GRAVITY * duration**2 / 4.0
    return math.dist(before[1][:2], after[1][:2]) > longest + RESOLUTION
