"""Weighted least squares from velocities along sensor axes to the body twist.

Sensor i measures ``a_i . (v_c + Omega k x r_i)``, Eq. (23) of the dissertation, where ``a_i`` is
the unit vector of its axis and ``r_i`` its position in the body frame, ``v_c`` the velocity of
base_link, ``Omega`` the yaw rate, and ``k`` the unit vector upwards. This is one row of
`sensor_matrix`. Three rows determine the twist unless all axes are parallel or all axes pass
through one point. In the second case, no sensor measures a rotation about this point. Whether the
yaw rate is observable does not depend on the position of base_link. It depends on the part of the
lever arms that no translation can explain.

A flow sensor measures the velocity of one position along two axes. It adds two rows, whose errors
may be correlated.

If the sensors alone do not suffice, an axle without sideways slip may add the row (0, 1, axle x)
with the velocity 0, as a line camera at (axle x, 0) with an axis to the left does.

Remaining calibration errors dp, dphi and dl of a camera's pixel pitch p, axis angle phi and lever
arm l cause a systematic error of the measured velocity v. To first order, for the twist (v_x, v_y,
Omega), this error is

    v dp / p + (v_y cos phi - v_x sin phi) dphi + Omega dl.

The variance of this error is added to the variance of the velocity. A pitch error scales the
velocity, an axis error adds a part of the motion across the axis, and a lever-arm error adds a part
of the yaw rate. A flow sensor has one scale error and one axis error for both of its velocities.

In shapes, S is the number of sensors, and R the number of velocities: one for each line camera, one
for the axle, and two for each flow sensor.
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from omni_core.configuration import Configuration, ConfigurationError, parameter
from omni_core.quantities import BoolArray, FloatArray
from omni_core.sensors import Mount, sensor_matrix

NONE, UNSTEERED_AXLE = "none", "unsteered_axle"
_NARROWEST = math.sin(math.radians(5.0)) ** 2
# If the variance of a sensor's residual is a smaller share of the sensor's variance, the other
# sensors cannot check this sensor [1].
_CHECKED = 1e-6
UNKNOWNS = 3
"""Number of components of the twist."""
_MINIMUM_VARIANCE = 1e-12  # m^2/s^2; keeps the weights finite for noise-free lines
_SMALLEST_SHARE = 1e-9  # smallest ratio of two variances; below it, a weight is lost to rounding
_WEAKEST_LEVER = 0.05  # smallest ratio of the effective lever arm to the spread of the sensors


class KinematicsConfiguration(Configuration):
    """Kinematic constraint of a vehicle while its wheels grip, which replaces a missing sensor.

    Source: dissertation, section 4.6 and Figure 70. A wheel that is not steered rolls along the
    body's x axis and, as long as it grips, does not move sideways. The same is true for every point
    on the line through its axle. For an axle at x = a, the constraint on the sideways velocity v_y
    and the yaw rate Omega of the body is ``v_y + a Omega = 0``. The constraint is valid for the
    driven axle of a differential drive and the rear axle of an Ackermann drive, but not for
    omni-wheels.

    When the vehicle skids, the constraint is wrong. Two cameras cannot detect the skid: the
    estimated v_y then has an error as large as the skid velocity, while the covariance includes
    only the sideways velocity of gripping wheels. The constraint is therefore used only if the
    sensors alone do not determine the twist. Otherwise, it is only compared with the sensors to
    detect a skid.
    """

    constraint: str = parameter(NONE, choices=(NONE, UNSTEERED_AXLE))
    """Constraint that is used if the sensors do not suffice: `none`, or `unsteered_axle` for an
    axle that does not slip sideways (differential and Ackermann drives)"""
    axle_x: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Position of the axle along x of base_link"""
    deviation: float = parameter(0.02, unit="m/s", above=0.0, maximum=100.0)
    """Standard deviation of the axle's sideways velocity while its wheels grip"""
    deviation_share: float = parameter(0.005, minimum=0.0, maximum=1.0)
    """Additional standard deviation of the axle's sideways velocity, divided by the largest
    velocity that any sensor measures"""

    @property
    def axle(self) -> float | None:
        """Position x of the axle without sideways slip [m], None without a constraint."""
        return self.axle_x if self.constraint == UNSTEERED_AXLE else None

    def variance(self, speed: float) -> float:
        """Return the variance of the axle's sideways velocity [m^2/s^2].

        Args:
            speed: magnitude of the largest velocity that a sensor measured [m/s].
        """
        return self.deviation**2 + math.pow(self.deviation_share * speed, 2)


@dataclasses.dataclass(frozen=True)
class Solution:
    """A twist, and the data from which it was estimated.

    An axle without sideways slip (kinematic constraint) can replace a sensor.

    Attributes:
        twist: (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
        covariance: covariance of the twist in the squares of its units, shape (3, 3).
        measured: whether each of the S sensors (cameras, then flow sensors) was used; then whether
            the axle was used, if there is one.
        count: number of velocities that were used.
        assumed: whether the axle was used.
        scores: normalized residual of each sensor, and of the axle [1], shape (S,) or (S + 1,).
        leverage: largest possible effect of one faulty velocity [1]: squared error of the twist,
            normalized by the covariance, divided by the squared score of the velocity.
        last_variance: variance of the last velocity in the order of the solver [m^2/s^2]: of the
            axle, or of the last sensor if there is no axle.
    """

    twist: FloatArray
    covariance: FloatArray
    measured: tuple[bool, ...]
    count: int
    assumed: bool
    scores: FloatArray
    leverage: float
    last_variance: float


def check_placement(
    sensors: Mapping[str, Mount], minimum_lever: float, axle: float | None = None
) -> None:
    """Check that the sensors determine all three components of the twist.

    Args:
        sensors: line cameras and flow sensors, keyed by name.
        minimum_lever: minimum effective lever arm for the yaw rate [m].
        axle: position x of an axle without sideways slip [m], which counts as a sensor if the
            sensors do not suffice; None if there is no such axle.

    Raises:
        ConfigurationError: fewer than three velocities, or axes that are (nearly) parallel or
            (nearly) pass through one point; the message names the sensors.
    """
    problem = _problem(sensors, minimum_lever)
    if problem and axle is not None:
        problem = _problem(sensors, minimum_lever, axle)
    if problem:
        raise ConfigurationError("sensors", problem)


class TwistSolver:
    """Estimates the twist of base_link from sensor velocities."""

    def __init__(
        self,
        sensors: Mapping[str, Mount],
        minimum_lever: float,
        kinematics: KinematicsConfiguration | None = None,
    ) -> None:
        """Create the solver for the given sensors and, if there is one, an unsteered axle.

        Raises:
            ConfigurationError: the placement is singular or too weak; `check_placement` states the
                conditions.
        """
        self._kinematics = kinematics or KinematicsConfiguration()
        axle = self._kinematics.axle
        check_placement(sensors, minimum_lever, axle)
        self._sensors = dict(sensors)
        self._minimum_lever = minimum_lever
        matrix = _rows(sensors, axle)
        # With this unit of the yaw rate, the columns of the matrix have similar magnitudes, which
        # reduces rounding errors of the inverse.
        self._unit = np.array([1.0, 1.0, 1.0 / max(float(np.abs(matrix[:, 2]).max()), 1e-9)])
        self._matrix = matrix * self._unit
        self._problems: dict[tuple[bool, ...], str] = {}
        sizes = [len(sensor.directions) for sensor in sensors.values()]
        self._sizes = np.array(sizes if axle is None else [*sizes, 1], np.intp)
        ends = np.cumsum(sizes)
        self._places = [slice(end - size, end) for size, end in zip(sizes, ends, strict=True)]
        # Rows that convert the twist to the motion across each axis, and remaining calibration
        # errors; both are 0 for an axle.
        self._across = np.zeros_like(matrix)
        self._left = np.zeros_like(matrix)  # errors of scale [1], axis [rad], lever [m]
        for place, sensor in zip(self._places, sensors.values(), strict=True):
            if len(sensor.directions) == 1:
                self._across[place, 0] = -matrix[place, 1]
                self._across[place, 1] = matrix[place, 0]
            else:  # each axis of a flow sensor measures motion across the other axis
                self._across[place] = matrix[place][::-1] * ((1.0,), (-1.0,))
            errors = sensor.scale_error, math.radians(sensor.heading_error_deg), sensor.lever_error
            self._left[place] = errors
        self._calibrated = bool(self._left.any())

    def rows(self, measured: tuple[bool, ...]) -> BoolArray:
        """Return whether each velocity belongs to a sensor that is used, shape (R,)."""
        return np.repeat(np.array(measured, np.bool_), self._sizes[: len(measured)])

    def problem(self, measured: tuple[bool, ...]) -> str:
        """Return why the used sensors do not determine the twist; empty if they determine it.

        Args:
            measured: whether each of the S sensors is used; if there is an axle, a last entry
                states whether the axle is used.
        """
        problem = self._problems.get(measured)
        if problem is None:
            count = len(self._sensors)
            chosen = {
                name: sensor
                for (name, sensor), use in zip(self._sensors.items(), measured[:count], strict=True)
                if use
            }
            axle = self._kinematics.axle if any(measured[count:]) else None
            problem = _problem(chosen, self._minimum_lever, axle)
            self._problems[measured] = problem
        return problem

    def estimate(
        self,
        velocity: FloatArray,
        variance: FloatArray,
        measured: tuple[bool, ...],
        contradiction_limit: float,
    ) -> Solution | None:
        """Return the twist estimated from the velocities; None if they do not determine it.

        The axle is used only if the sensors alone do not determine the twist.

        Args:
            velocity: velocities along the axes of the sensors [m/s], shape (R,), without the axle.
            variance: variances of these velocities [m^2/s^2], shape (R,), or their covariance,
                shape (R, R), if there are flow sensors.
            measured: whether each of the S sensors is used.
            contradiction_limit: limit on the scores [1]; if it is 0, they are not computed.
        """
        used = self.rows(measured)
        own = variance if variance.ndim == 1 else np.diag(variance)
        largest = float(np.max(own, where=used, initial=0.0))
        own = np.maximum(own, max(_SMALLEST_SHARE * largest, _MINIMUM_VARIANCE))
        assumed = False
        if self._kinematics.axle is not None:
            speed = float(np.max(np.abs(velocity), where=used, initial=0.0))
            velocity = np.append(velocity, 0.0)
            own = np.append(own, self._kinematics.variance(speed))
            assumed = bool(self.problem((*measured, False)))
            measured = (*measured, assumed)
        if self.problem(measured):
            return None
        each = own
        if variance.ndim > 1:
            each = np.pad(variance, (0, len(own) - len(variance)))
            np.fill_diagonal(each, own)
        twist, covariance = self.solve(velocity, each, measured)
        scores, leverage = np.zeros(len(measured)), 1.0
        count = int(np.count_nonzero(self.rows(measured)))
        if count > UNKNOWNS and contradiction_limit > 0.0:
            scores = self.contradictions(velocity, each, measured, twist, covariance)
            leverage = max(leverage, self.leverage(each, measured, covariance))
        last_variance = float(own[-1])
        return Solution(
            twist, covariance, measured, count, assumed, scores, leverage, last_variance
        )

    def solve(
        self, velocity: FloatArray, variance: FloatArray, measured: tuple[bool, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the twist estimated from the velocities, and the covariance of the twist.

        The sensors must determine the twist: `problem` must return an empty text.

        Args:
            velocity: velocities along the axes of the sensors [m/s], shape (R,); if there is an
                axle, the last velocity belongs to it and is 0.
            variance: variances of these velocities [m^2/s^2], positive, shape (R,), or their
                covariance, shape (R, R), if there are flow sensors.
            measured: whether each of the S sensors is used; if there is an axle, a last entry
                states whether the axle is used.

        Returns:
            Twist (v_x, v_y, yaw rate) of base_link [m/s, m/s, rad/s] and its covariance, which
            includes the calibration errors.
        """
        twist, covariance = self._least_squares(velocity, variance, measured)
        if self._calibrated:
            variance = variance + self._systematic(twist, variance.ndim)
            twist, covariance = self._least_squares(velocity, variance, measured)
        return twist, covariance

    def _systematic(self, twist: FloatArray, dimensions: int) -> FloatArray:
        """Return the variance of the velocities due to the remaining calibration errors.

        Args:
            twist: (v_x, v_y, yaw rate) [m/s, m/s, rad/s], shape (3,).
            dimensions: 1 for variances, shape (R,); 2 for a covariance, shape (R, R) [m^2/s^2].
        """
        along = self._matrix @ (twist / self._unit)
        motion = np.column_stack(
            (along, self._across @ twist, np.full(len(along), float(twist[2])))
        )
        errors = self._left * motion
        variance: FloatArray = np.sum(errors**2, axis=1)
        if dimensions == 1:
            return variance
        covariance = np.diag(variance)
        for place in self._places:
            if place.stop - place.start > 1:
                common, own = errors[place, :2], errors[place, 2]
                covariance[place, place] = common @ common.T + np.diag(own**2)
        return covariance

    def _least_squares(
        self, velocity: FloatArray, variance: FloatArray, measured: tuple[bool, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the weighted least-squares twist and its covariance.

        The arguments are those of `solve`. The covariance includes the calibration errors only if
        `variance` includes them.
        """
        use = self.rows(measured)
        rows = self._matrix[use]
        if variance.ndim == 1:
            weighted = rows / variance[use, None]
        else:
            weighted = np.linalg.solve(variance[np.ix_(use, use)], rows)
        covariance = np.linalg.inv(rows.T @ weighted)
        covariance = 0.5 * (covariance + covariance.T)
        twist = covariance @ (weighted.T @ velocity[use])
        return twist * self._unit, covariance * np.outer(self._unit, self._unit)

    def leverage(
        self, variance: FloatArray, measured: tuple[bool, ...], covariance: FloatArray
    ) -> float:
        """Return the largest squared error of the twist that one faulty velocity can cause [1].

        The error is normalized by the covariance of the twist. The normalized residual of the
        faulty velocity is assumed to be 1, so the squared error is ``h / (1 - h)``, where h is the
        leverage of this velocity in the least-squares solution.

        Args:
            variance: variances of the velocities [m^2/s^2], shape (R,), or their covariance, shape
                (R, R).
            measured: whether each sensor, and the axle if there is one, is used.
            covariance: covariance from `solve`.
        """
        rows = self._matrix / self._unit
        own = variance if variance.ndim == 1 else np.diag(variance)
        h = np.einsum("ij,jk,ik->i", rows, covariance, rows) / own
        checked = self.rows(measured) & (1.0 - h > _CHECKED)
        return float(np.max(h / np.maximum(1.0 - h, _CHECKED), where=checked, initial=0.0))

    def contradictions(
        self,
        velocity: FloatArray,
        variance: FloatArray,
        measured: tuple[bool, ...],
        twist: FloatArray,
        covariance: FloatArray,
    ) -> FloatArray:
        """Return the normalized residual of each sensor against the twist of all sensors.

        The variance of a residual is ``s_i^2 - a_i C a_i^T``, with the sensor's variance ``s_i^2``,
        its row ``a_i`` of the matrix, and the covariance ``C`` of the twist. The second term is
        subtracted because the twist depends on the tested sensor itself.

        Args:
            velocity: velocities along the axes of the sensors [m/s], shape (R,).
            variance: variances of the velocities [m^2/s^2], shape (R,), or their covariance, shape
                (R, R).
            measured: whether each sensor, and the axle if there is one, is used.
            twist: twist from `solve`.
            covariance: covariance from `solve`.

        Returns:
            Residual of each sensor, and of the axle, divided by its standard deviation [1], shape
            (S,) or (S + 1,). The value is 0 for a sensor that has not measured, or that the
            remaining sensors cannot check. With four line cameras all four values are equal, so a
            fault can be detected but not isolated. A flow sensor has one value: the root of the sum
            of squares of its two residuals.
        """
        rows = self._matrix / self._unit
        if self._calibrated:
            variance = variance + self._systematic(twist, variance.ndim)
        residual = velocity - rows @ twist
        explained = np.einsum("ij,jk,ik->i", rows, covariance, rows)
        own = variance if variance.ndim == 1 else np.diag(variance)
        left = own - explained
        checked = self.rows(measured) & (left > _CHECKED * own)
        score: FloatArray = np.zeros(len(velocity))
        score[checked] = np.abs(residual[checked]) / np.sqrt(left[checked])
        if variance.ndim == 1:
            return score
        each: FloatArray = score[np.cumsum(self._sizes) - self._sizes]
        for i, place in enumerate(self._places):
            if place.stop - place.start > 1:
                root = np.linalg.cholesky(variance[place, place])
                white = np.linalg.solve(root, np.column_stack((rows[place], residual[place])))
                share, axes = np.linalg.eigh(np.eye(2) - white[:, :3] @ covariance @ white[:, :3].T)
                observable = share > _CHECKED
                of_each = (axes.T @ white[:, 3])[observable] ** 2 / share[observable]
                each[i] = math.sqrt(float(np.sum(of_each))) if measured[i] else 0.0
        return each


def _rows(sensors: Mapping[str, Mount], axle: float | None) -> FloatArray:
    """Return `sensor_matrix`, and below it the row of the axle if there is one, shape (R, 3)."""
    matrix = sensor_matrix(sensors)
    return matrix if axle is None else np.vstack((matrix, (0.0, 1.0, axle)))


def _problem(sensors: Mapping[str, Mount], minimum_lever: float, axle: float | None = None) -> str:
    """Return why a placement of sensors does not determine the twist; empty if it does.

    The arguments are those of `check_placement`.
    """
    names = ", ".join(sensors) or "none"
    matrix = _rows(sensors, axle)
    if axle is None and len(matrix) < 3:
        hint = " (a flow sensor counts as two)" if len(matrix) > len(sensors) else ""
        if len(matrix) == 2:
            hint += "; two suffice with an axle that does not slip sideways (kinematics.constraint)"
            hint += ", and one flow sensor with a gyro (twist_adapter)"
        return (
            f"three sensors are needed to measure the twist, but there are {len(sensors)}: {names}"
            + hint
        )
    if axle is not None and len(matrix) < 3:
        return (
            "two sensors are needed in addition to the axle that does not slip sideways, "
            f"but there are {len(sensors)}: {names}"
        )
    position = np.array([[s.x, s.y] for s in sensors.values() for _ in s.directions])
    if axle is not None:
        names += f" and of the axle at x = {axle:g} m"
        position = np.vstack((position, (axle, 0.0)))
    axes, levers = matrix[:, :2], matrix[:, 2]
    count = len(matrix)
    if np.linalg.eigvalsh(axes.T @ axes)[0] / count < _NARROWEST:
        return (
            f"the axes of {names} are parallel within a few degrees: the velocity across them "
            "cannot be measured; change the heading of at least one sensor"
        )
    velocity, *_ = np.linalg.lstsq(axes, levers, rcond=None)
    lever = float(np.linalg.norm(levers - axes @ velocity)) / math.sqrt(count)
    spread = float(np.sqrt(np.mean(np.sum((position - position.mean(axis=0)) ** 2, axis=1))))
    if lever < max(minimum_lever, _WEAKEST_LEVER * spread):
        # The distance of axis i from point c is cross(r_i, a_i) - cross(c, a_i).
        center_x, center_y = (round(float(c), 2) + 0.0 for c in (velocity[1], -velocity[0]))
        return (
            f"the axes of {names} pass through one point, ({center_x:.2f}, {center_y:.2f}) m, "
            f"within {1e3 * lever:.0f} mm: a rotation about it cannot be measured; mount "
            "the sensors tangentially"
        )
    return ""
