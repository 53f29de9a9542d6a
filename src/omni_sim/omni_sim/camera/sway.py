"""Motion of the sensors' fields of view on a sprung chassis.

A sprung chassis tilts about its center of gravity, which is at the height h. Let p and r be the
gradients of the chassis in the forward direction and to the left. A line of sight perpendicular to
the chassis meets the ground at a point that is shifted by

    h (p, r)

forward and to the left. This shift does not depend on the mounting position. All fields of view
therefore move over the ground with the velocity h (p', r'), the time derivative of the shift. A
ground sensor cannot distinguish this velocity from a motion of the vehicle. Between two control
stamps, p and r are cubics with the given values and derivatives at both stamps. Heave changes only
the magnification. The slant of the view and the cosine of the tilt are second-order effects and are
neglected.
"""

import numpy as np

from omni_platform.geometry import turned
from omni_platform.quantities import FloatArray


def swaying(
    trajectory: FloatArray, before: FloatArray, after: FloatArray, height: float, period: float
) -> FloatArray:
    """Return the trajectory of the fields of view, computed from the trajectory of the vehicle.

    Args:
        trajectory: x, y [m], yaw [rad] and their time derivatives in the world frame at uniform
            steps, shape (n + 1, 6).
        before: `Vehicle.ride` at the start: heave [m], gradients [1], and the time derivatives of
            all three [m/s, 1/s, 1/s], shape (6,).
        after: `Vehicle.ride` at the end, shape (6,).
        height: height of the center of gravity [m].
        period: time from start to end [s].
    """
    t = np.linspace(0.0, 1.0, len(trajectory))[:, None]
    start, end = before[1:3], after[1:3]
    slope, last = period * before[4:], period * after[4:]
    bend = 3.0 * (end - start) - 2.0 * slope - last
    twist = slope + last - 2.0 * (end - start)
    tilt = start + t * (slope + t * (bend + t * twist))
    rate = (slope + t * (2.0 * bend + t * 3.0 * twist)) / period
    swayed = trajectory.copy()
    for first, body in ((0, height * tilt), (3, height * rate)):
        swayed[:, first : first + 2] += turned(body, trajectory[:, 2])
    return swayed
