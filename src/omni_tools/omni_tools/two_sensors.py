"""Displacement of a platform from two two-dimensional sensors, Eqs. (73)-(78).

The reference point R is on the line between the sensors, sensor 1 at the distance d_1 to the left
(+y) and sensor 2 at the distance d_2 to the right. By ``v_i = v_c + Omega k x r_i``, the sensors
measure ``dx_1 = X - d_1 Omega dt`` and ``dx_2 = X + d_2 Omega dt``. Eq. (75) computes the angle
from a difference of x displacements, so the sensors must be on a line along y. With the signs in
(75), a counter-clockwise angle is positive if sensor 1 is on the left.

The two x displacements determine X and the angle, and both y displacements measure Y. Equation (74)
weights the y displacements as if Y varied along the line. Weighted least squares would use the
variances of the y displacements instead and give a more accurate mean; for equal variances and d_1
= d_2, both results are equal. X and the angle do not depend on the variances.

**Error of the straight-line approximation between two instants.** If the platform moves on an arc
and rotates by phi,

- displacements along the axes of the first instant fulfill (73)-(75) *exactly*: the y
  displacements differ by ``(d_1 + d_2)(1 - cos phi)``, and the weights of (74) remove exactly this
  difference;
- a line camera measures along its own axis, which rotates. Its displacements describe the path in
  rotating axes, for which (73)-(75) have an error of first order in the angle. The path is rotated
  by phi / 2, which moves its end sideways by ``|(X, Y)| phi / 2``; it is longer than its chord by
  phi^2 / 24 of its length; and the arcsine adds phi^3 / 6 to the angle.

The dissertation models this error as noise, but in a steady turn it always has the same sign.
Between two lines at 2500 lines/s and 2 rad/s (phi = 0.8 mrad) it is 0.04 % of the path; over a
batch of 10 ms it is 1 %. `along_arc` removes it in closed form.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class DisplacementError(ValueError):
    """Displacements or distances contradict a rigid motion; the message states the reason."""


class SensorDisplacement(NamedTuple):
    """Displacement of a two-dimensional sensor between two instants.

    Attributes:
        x: displacement forward [m].
        y: displacement to the left [m].
    """

    x: float
    y: float


class PlanarDisplacement(NamedTuple):
    """Motion of a point of the platform between two instants.

    Attributes:
        x: displacement forward, along the axes of the first instant [m].
        y: displacement to the left, along the axes of the first instant [m].
        angle: rotation of the platform, counter-clockwise [rad].
    """

    x: float
    y: float
    angle: float

    def at(self, x: float, y: float) -> PlanarDisplacement:
        """Return the displacement of another point of the platform, which is assumed to be rigid.

        Args:
            x: coordinate x of the other point relative to this point, forward at the first instant
                [m].
            y: coordinate y of the other point relative to this point, to the left [m].
        """
        sine, less = math.sin(self.angle), 1.0 - math.cos(self.angle)
        return PlanarDisplacement(
            self.x - sine * y - less * x, self.y + sine * x - less * y, self.angle
        )

    def along_arc(self) -> PlanarDisplacement:
        """Return the true motion for displacements measured along the sensors' own axes.

        The axes of line cameras rotate with the platform. Their displacements make the argument
        of the arcsine in (75) equal to the angle, and the path is an arc of the measured length.
        The result is exact for constant velocity and yaw rate.
        """
        angle = math.sin(self.angle)
        # End of an arc of length 1, along and across its start: sin a / a and (1 - cos a) / a.
        along = float(np.sinc(angle / math.pi))
        across = math.sin(0.5 * angle) * float(np.sinc(0.5 * angle / math.pi))
        return PlanarDisplacement(
            along * self.x - across * self.y, across * self.x + along * self.y, angle
        )


def two_sensor_displacement(
    first: SensorDisplacement, second: SensorDisplacement, d_1: float, d_2: float
) -> PlanarDisplacement:
    """Return the displacement of a point between two sensors, Eqs. (73)-(75).

    Args:
        first: reading of the sensor to the left of the point.
        second: reading of the sensor to the right of the point.
        d_1: distance of the first sensor from the point [m], not negative.
        d_2: distance of the second sensor from the point [m], not negative.

    Raises:
        DisplacementError: a value is not finite, a distance is negative, the sensors are at the
            same place, or their displacements differ by more than their distance.
    """
    _check_finite(d_1=d_1, d_2=d_2, y_1=first.y, y_2=second.y)
    if d_1 < 0.0 or d_2 < 0.0:
        raise DisplacementError(f"distances from the point must not be negative: {d_1:g}, {d_2:g}")
    distance = d_1 + d_2
    angle = _angle(first.x, second.x, distance)
    return PlanarDisplacement(
        (d_1 * second.x + d_2 * first.x) / distance,  # Eq. (73)
        (d_1 * second.y + d_2 * first.y) / distance,  # Eq. (74)
        angle,
    )


def first_sensor_displacement(
    first: SensorDisplacement, second_x: float, distance: float
) -> PlanarDisplacement:
    """Return the motion of the platform at the first sensor, Eqs. (76)-(78).

    This is the case d_1 = 0 of Eqs. (73)-(75). The y displacement of the second sensor is not
    needed, so the second sensor may be a single line camera.

    Args:
        first: reading of the left sensor, whose position is the reference point.
        second_x: displacement of the right sensor forward [m].
        distance: distance between the sensors, d_2 [m], above 0.

    Raises:
        DisplacementError: a value is not finite, `distance` is not above 0, or the displacements
            along x differ by more than `distance`.
    """
    _check_finite(y_1=first.y)
    # Eqs. (76), (77)
    return PlanarDisplacement(first.x, first.y, _angle(first.x, second_x, distance))


def _angle(x_1: float, x_2: float, distance: float) -> float:
    _check_finite(x_1=x_1, x_2=x_2, distance=distance)
    if distance <= 0.0:
        raise DisplacementError(
            "the sensors are at the same position: a turn needs a distance above 0 m"
        )
    difference = x_2 - x_1
    if abs(difference) > distance:
        raise DisplacementError(
            f"the displacements along x differ by {difference:g} m, but the sensors are only "
            f"{distance:g} m apart: no rigid motion explains this, so one sensor is faulty"
        )
    return math.asin(difference / distance)  # Eqs. (75), (78)


def _check_finite(**values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise DisplacementError(f"{name} is {value}, must be a finite number")
