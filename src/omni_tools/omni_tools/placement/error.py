"""Mean twist error of a placement of line cameras.

The twist estimated by weighted least squares has an error ``e`` with the covariance ``C = (A^T W
A)^-1``. ``A`` is the sensor matrix, whose rows ``a`` map the twist to the velocities along the axes
of the cameras, and ``W`` contains the inverse variances ``1 / s^2`` of these velocities. The
velocity of a point p of the platform then has the error ``P_p e`` with ``P_p = [[1, 0, -y], [0, 1,
x]]``. The *mean twist error* E is the RMS of this velocity error over all points p of the platform
and over an expected mix of motions m,

    E^2 = mean_m mean_p trace(P_p C_m P_p^T) = mean_m (var v_x + var v_y + g^2 var yaw rate),

with ``g^2 = (length^2 + width^2) / 12`` for a rectangle around base_link. This definition combines
m/s and rad/s without an arbitrary weight. W depends on the motion, because the error of a camera
grows with the speed across its axis (`sensor_error`). Singular placements have an infinite E.

Information matrices ``a^T a / s^2`` are stored as their six distinct elements (xx, xy, xw, yy, yw,
ww), for the velocities (v_x, v_y, g * yaw rate), all in m/s.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.twist.least_squares import check_placement
from omni_core.configuration import ConfigurationError
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor, sensor_matrix
from omni_tools.line_trials.rig import View
from omni_tools.placement.mounting_area import MountingArea
from omni_tools.placement.sensor_error import SensorError

MOTIONS = ("straight", "sideways", "diagonal", "turning")

_SINGULAR = 1e-10  # minimum determinant, relative to a matrix with equal eigenvalues
_FULL = ((0, 1, 2), (1, 3, 4), (2, 4, 5))  # index of the element for each row and column


class MotionMix(NamedTuple):
    """Mix of motions for which placements are evaluated.

    Attributes:
        names: names of the M motions; a motion that has a mirror image is listed twice.
        twist: (v_x, v_y, yaw rate) of each motion [m/s, m/s, rad/s], shape (M, 3).
        share: share of time of each motion [1], with the sum 1, shape (M,).
    """

    names: tuple[str, ...]
    twist: FloatArray
    share: FloatArray

    @classmethod
    def of(cls, speed: float, yaw_rate: float, weights: Sequence[float]) -> MotionMix:
        """Return a mix of straight, sideways, diagonal and turning motion.

        Diagonal and turning motion are listed in both mirror images.

        Args:
            speed: speed of base_link [m/s].
            yaw_rate: yaw rate of the turning motion, which also moves forward [rad/s].
            weights: relative share of time of each of the four motions [1], not all 0.
        """
        slant = speed * math.sqrt(0.5)
        rows = (
            (MOTIONS[0], (speed, 0.0, 0.0), weights[0]),
            (MOTIONS[1], (0.0, speed, 0.0), weights[1]),
            (MOTIONS[2], (slant, slant, 0.0), 0.5 * weights[2]),
            (MOTIONS[2], (slant, -slant, 0.0), 0.5 * weights[2]),
            (MOTIONS[3], (speed, 0.0, yaw_rate), 0.5 * weights[3]),
            (MOTIONS[3], (speed, 0.0, -yaw_rate), 0.5 * weights[3]),
        )
        names, twist, weight = zip(*(row for row in rows if row[2] > 0.0), strict=True)
        return cls(names, np.array(twist), np.array(weight) / sum(weight))


class MeanError(NamedTuple):
    """Criterion that evaluates placements by their mean twist error E.

    Attributes:
        view: field of view of each camera.
        error: error model of every camera.
        mix: mix of motions.
        gyration: g, RMS distance of the platform's points from base_link [m].
    """

    view: View
    error: SensorError
    mix: MotionMix
    gyration: float

    def information(self, poses: FloatArray) -> FloatArray:
        """Return the distinct elements of the information matrix of a camera at each pose.

        Args:
            poses: x, y [m] and heading [rad] of the axis, shape (..., 3).

        Returns:
            Shape (..., M, 6) [s^2/m^2].
        """
        x, y, heading = (poses[..., None, i] for i in range(3))
        a_x, a_y = np.cos(heading), np.sin(heading)
        twist = self.mix.twist
        v_x, v_y = twist[:, 0] - twist[:, 2] * y, twist[:, 1] + twist[:, 2] * x
        along, across = a_x * v_x + a_y * v_y, a_x * v_y - a_y * v_x
        weight = 1.0 / self.error.variance(self.view, along, across)
        lever = (x * a_y - y * a_x) / self.gyration
        return weight[..., None] * _elements(a_x, a_y, lever)

    def value(self, information: FloatArray) -> FloatArray:
        """Return the mean twist error E of placements [m/s], shape (...).

        Args:
            information: `information` of each placement, summed over its cameras, shape (..., M,
                6).
        """
        return np.sqrt(total_variance(information) @ self.mix.share)

    def mean_error(self, poses: FloatArray) -> float:
        """Return the mean twist error E [m/s].

        Args:
            poses: x, y [m] and heading [rad] of the cameras, shape (N, 3).
        """
        return float(self.value(self.information(poses).sum(axis=0)))

    def covariance(self, poses: FloatArray) -> FloatArray:
        """Return the covariance of the twist in each motion, shape (M, 3, 3); infinite if singular.

        Args:
            poses: x, y [m] and heading [rad] of the cameras, shape (N, 3).
        """
        information = self.information(poses).sum(axis=0)
        if not np.all(np.isfinite(total_variance(information))):
            return np.full((len(information), 3, 3), np.inf)
        unit = np.array([1.0, 1.0, 1.0 / self.gyration])
        inverse = np.linalg.inv(information[:, _FULL])
        return inverse * np.outer(unit, unit)

    def point_error(self, poses: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the RMS velocity error of points of the platform [m/s].

        Args:
            poses: x, y [m] and heading [rad] of the cameras, shape (N, 3).
            x: coordinate x of the points [m], any shape.
            y: coordinate y of the points [m], same shape.
        """
        c = np.einsum("m,mij->ij", self.mix.share, self.covariance(poses))
        squared = c[0, 0] + c[1, 1] + (x**2 + y**2) * c[2, 2] - 2 * y * c[0, 2] + 2 * x * c[1, 2]
        return np.asarray(np.sqrt(squared))


class ConditionNumber:
    """Criterion that evaluates placements by the condition number of the sensor matrix.

    The condition number is used only for comparison, because it combines components with different
    units. It is small if the uncertainties of all components are equal, even if all are large. A
    wide platform has a large condition number.
    """

    def information(self, poses: FloatArray) -> FloatArray:
        """Return the distinct elements of ``a^T a`` of a camera at each pose, shape (..., 1, 6).

        The row ``a`` of the sensor matrix maps the twist to the velocity along the camera's axis.

        Args:
            poses: x, y [m] and heading [rad] of the axis, shape (..., 3).
        """
        x, y, heading = (poses[..., i] for i in range(3))
        a_x, a_y = np.cos(heading), np.sin(heading)
        lever = x * a_y - y * a_x
        return _elements(a_x, a_y, lever)[..., None, :]

    def value(self, information: FloatArray) -> FloatArray:
        """Return the condition numbers of placements [1], shape (...); infinite if singular.

        Args:
            information: `information` of each placement, summed over its cameras, shape (..., 1,
                6).
        """
        eigenvalues = np.linalg.eigvalsh(information[..., 0, _FULL])
        smallest, largest = eigenvalues[..., 0], eigenvalues[..., 2]
        singular = smallest <= _SINGULAR * largest
        ratio = largest / np.where(singular, 1.0, smallest)
        return np.where(singular, np.inf, np.sqrt(ratio))


Criterion = MeanError | ConditionNumber
"""Criterion that a search for a placement minimizes."""


def _elements(a_x: FloatArray, a_y: FloatArray, lever: FloatArray) -> FloatArray:
    """Return the six distinct elements of the symmetric matrix ``a^T a``, shape (..., 6).

    The row ``a = (a_x, a_y, lever)`` maps the twist to the velocity along the axis of a camera.

    Args:
        a_x: x component of the axis [1], shape (...).
        a_y: y component of the axis [1], shape (...).
        lever: lever arm of the axis about base_link [m], shape (...).
    """
    elements = (a_x * a_x, a_x * a_y, a_x * lever, a_y * a_y, a_y * lever, lever * lever)
    return np.stack(elements, axis=-1)


def total_variance(information: FloatArray) -> FloatArray:
    """Return the trace of the inverse of symmetric matrices; infinite for a singular matrix.

    Args:
        information: elements (xx, xy, xw, yy, yw, ww) of each matrix, shape (..., 6).
    """
    xx, xy, xw, yy, yw, ww = (information[..., i] for i in range(6))
    minor_x, minor_y, minor_w = yy * ww - yw * yw, xx * ww - xw * xw, xx * yy - xy * xy
    determinant = xx * minor_x - xy * (xy * ww - yw * xw) + xw * (xy * yw - yy * xw)
    regular = determinant > _SINGULAR * ((xx + yy + ww) / 3.0) ** 3
    trace = (minor_x + minor_y + minor_w) / np.where(regular, determinant, 1.0)
    return np.where(regular, trace, np.inf)


def gyration(length: float, width: float) -> float:
    """Return the RMS distance of a rectangle's points from its center [m]."""
    return math.sqrt((length**2 + width**2) / 12.0)


def poses_of(sensors: Mapping[str, LineSensor]) -> FloatArray:
    """Return x, y [m] and heading [rad] of sensors, shape (N, 3)."""
    return np.array([(s.x, s.y, s.heading) for s in sensors.values()], np.float64).reshape(-1, 3)


def after_failure(criterion: MeanError, poses: FloatArray) -> FloatArray:
    """Return the mean twist error E after the failure of each camera [m/s], shape (N,)."""
    own = criterion.information(poses)
    return criterion.value(own.sum(axis=0) - own)


def closeness(sensors: Mapping[str, LineSensor]) -> tuple[float, float]:
    """Return two measures of how far a placement is from being singular.

    For a singular placement, at least one of the two measures is 0.

    Returns:
        Spread angle of the axes [deg], at most 45. Its squared sine is the smaller eigenvalue of
        the mean of ``a a^T`` over all cameras, where a is the unit vector of a camera's axis.
        Effective lever arm [m]: the RMS of the part of the lever arms about base_link that no
        translation can explain; 0 if all axes meet in a point.
    """
    matrix = sensor_matrix(sensors)
    axes, levers = matrix[:, :2], matrix[:, 2]
    smallest = float(np.linalg.eigvalsh(axes.T @ axes)[0]) / len(axes)
    imitated = axes @ np.linalg.lstsq(axes, levers, rcond=None)[0]
    lever = math.sqrt(float(np.mean((levers - imitated) ** 2)))
    return math.degrees(math.asin(math.sqrt(min(max(smallest, 0.0), 1.0)))), lever


class EvaluatedPlacement(NamedTuple):
    """A placement of cameras and the errors of the twist that it measures.

    Attributes:
        name: name of the placement.
        sensors: cameras, keyed by name.
        mean_error: mean twist error E [m/s]; infinite if the placement is singular.
        deviation: standard deviations of v_x, v_y [m/s] and yaw rate [rad/s], as RMS over the mix
            of motions, shape (3,).
        by_motion: twist error of each motion of the mix [m/s], keyed by motion.
        without: mean twist error E after the failure of each camera [m/s], shape (N,); infinite if
            the placement of the remaining cameras is singular.
        condition: condition number of the sensor matrix in SI units [1].
        spread_deg: spread angle of the axes, see `closeness` [deg].
        lever: effective lever arm for the yaw rate [m].
        singular: reason why the odometry rejects the placement; empty for an accepted placement.
        mounting: reason why the cameras cannot be mounted on the chassis; empty without such a
            reason.
    """

    name: str
    sensors: Mapping[str, LineSensor]
    mean_error: float
    deviation: FloatArray
    by_motion: Mapping[str, float]
    without: FloatArray
    condition: float
    spread_deg: float
    lever: float
    singular: str
    mounting: str

    @property
    def worst_without(self) -> float:
        """Largest mean twist error after the failure of a camera [m/s]; infinite for 3 cameras."""
        return float(np.max(self.without))

    @property
    def missed_most(self) -> str:
        """Name of the camera whose failure increases the error most."""
        return tuple(self.sensors)[int(np.argmax(self.without))]


def evaluate(
    name: str, sensors: Mapping[str, LineSensor], criterion: MeanError, area: MountingArea
) -> EvaluatedPlacement:
    """Return the errors of a placement on a chassis.

    Args:
        name: name of the placement.
        sensors: cameras of the criterion's type, keyed by name.
        criterion: criterion that computes the error.
        area: area in which cameras can be mounted.
    """
    poses = poses_of(sensors)
    mix = criterion.mix
    variance = np.einsum("mii->mi", criterion.covariance(poses))
    squared = variance @ np.array([1.0, 1.0, criterion.gyration**2])
    by_motion = {
        motion: math.sqrt(float(np.average(squared[own], weights=mix.share[own])))
        for motion in dict.fromkeys(mix.names)
        for own in [np.array([other == motion for other in mix.names])]
    }
    condition = ConditionNumber()
    spread, lever = closeness(sensors)
    without = after_failure(criterion, poses)
    for index, missing in enumerate(sensors):
        if singularity({name: own for name, own in sensors.items() if name != missing}):
            without[index] = math.inf
    errors = criterion.mean_error(poses), np.sqrt(mix.share @ variance), by_motion, without
    number = float(condition.value(condition.information(poses).sum(axis=0)))
    problems = singularity(sensors), area.problem(sensors, poses)
    return EvaluatedPlacement(name, sensors, *errors, number, spread, lever, *problems)


def singularity(sensors: Mapping[str, LineSensor]) -> str:
    """Return the reason why the odometry rejects a placement; empty for an accepted placement."""
    try:
        check_placement(sensors, OdometryConfiguration.minimum_lever)
    except ConfigurationError as error:
        return error.problem
    return ""
