"""Velocities along sensor axes to the body twist, by weighted least squares.

Sensor i measures ``a_i . (v_c + Omega k x r_i)``, Eq. (23): one row of `sensor_matrix`. Three rows
give the twist if the axes neither are all parallel nor all pass through one point (a rotation
about that point is not seen by any of them). How well the yaw rate is seen does not depend on
where base_link lies: it is the part of the levers that no velocity can imitate.

Where the sensors alone do not suffice, an axle that does not slip sideways (`kinematics`) may give
one more row, (0, 1, axle x), with the velocity 0. It is a row like any other in what follows.

What a calibration leaves of pitch p, axis phi and lever l of a camera is an error of its velocity
that lasts as long as the motion does. To first order, with the twist (v_x, v_y, Omega),

    v dp / p + (v_y cos phi - v_x sin phi) dphi + Omega dl,

whose variance is added to that of the match: pitch scales a speed, the axis couples the motion
across it, the place couples the yaw rate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from omni_platform.configuration import ConfigurationError
from omni_platform.quantities import FloatArray
from omni_platform.sensors import LineSensor, sensor_matrix

_NARROWEST = math.sin(math.radians(5.0)) ** 2
_CHECKED = 1e-6  # of its variance must be left for the others to check a sensor
_WEAKEST_LEVER = 0.05  # effective lever over the spread of the sensors


def check_placement(
    sensors: Mapping[str, LineSensor], minimum_lever: float, axle: float | None = None
) -> None:
    """Refuse sensors that cannot tell the three components of the twist apart.

    Args:
        sensors: the line cameras by name.
        minimum_lever: smallest effective lever for the yaw rate [m].
        axle: x of an axle that does not slip sideways [m], which counts as a sensor where the
            sensors do not suffice; None without.

    Raises:
        ConfigurationError: fewer than three sensors, axes (nearly) parallel, or axes that
            (nearly) pass through one point; the text names the sensors.
    """
    problem = _problem(sensors, minimum_lever)
    if problem and axle is not None:
        problem = _problem(sensors, minimum_lever, axle)
    if problem:
        raise ConfigurationError("sensors", problem)


class TwistSolver:
    """Turns sensor velocities into the twist of base_link."""

    def __init__(
        self,
        sensors: Mapping[str, LineSensor],
        minimum_lever: float,
        axle: float | None = None,
    ) -> None:
        """Lay out the sensors and, last, the axle that does not slip sideways, if there is one.

        Raises:
            ConfigurationError: the placement is singular or too weak, see `check_placement`.
        """
        check_placement(sensors, minimum_lever, axle)
        self._sensors = dict(sensors)
        self._minimum_lever = minimum_lever
        self._axle = axle
        matrix = _rows(sensors, axle)
        # In units of this length the columns are alike, so that the inverse is well scaled.
        self._unit = np.array([1.0, 1.0, 1.0 / max(float(np.abs(matrix[:, 2]).max()), 1e-9)])
        self._matrix = matrix * self._unit
        self._verdicts: dict[tuple[bool, ...], str] = {}
        # Rows of the motion across each axis, and what calibration leaves; none of an axle.
        self._across = np.zeros_like(matrix)
        self._across[: len(sensors), 0] = -matrix[: len(sensors), 1]
        self._across[: len(sensors), 1] = matrix[: len(sensors), 0]
        self._left = np.zeros_like(matrix)  # shares, [rad], [m]
        for row, sensor in zip(self._left, sensors.values(), strict=False):
            row[:] = sensor.scale_error, math.radians(sensor.heading_error_deg), sensor.lever_error
        self._calibrated = bool(self._left.any())

    def problem(self, measured: tuple[bool, ...]) -> str:
        """Return why the rows that are used do not suffice; empty if they do.

        Args:
            measured: which of the S sensors to use, and whether to use the axle, if there is one.
        """
        verdict = self._verdicts.get(measured)
        if verdict is None:
            count = len(self._sensors)
            chosen = {
                name: sensor
                for (name, sensor), use in zip(self._sensors.items(), measured[:count], strict=True)
                if use
            }
            axle = self._axle if any(measured[count:]) else None
            verdict = _problem(chosen, self._minimum_lever, axle)
            self._verdicts[measured] = verdict
        return verdict

    def solve(
        self, velocity: FloatArray, variance: FloatArray, measured: tuple[bool, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """Estimate the twist; `problem` must be empty for these sensors.

        Args:
            velocity: along each sensor's axis [m/s], shape (S,), or (S + 1,) with an axle, which
                has the last place and the velocity 0.
            variance: of these velocities [m^2/s^2], positive, of the same shape.
            measured: which of them to use.

        Returns:
            Twist (v_x, v_y, yaw rate) [m/s, m/s, rad/s] of base_link and its covariance, which
            holds what calibration leaves.
        """
        twist, covariance = self._least_squares(velocity, variance, measured)
        if self._calibrated:
            variance = variance + self._systematic(twist)
            twist, covariance = self._least_squares(velocity, variance, measured)
        return twist, covariance

    def _systematic(self, twist: FloatArray) -> FloatArray:
        """Return the variance that calibration leaves of each velocity [m^2/s^2]."""
        along = self._matrix @ (twist / self._unit)
        motion = np.column_stack(
            (along, self._across @ twist, np.full(len(along), float(twist[2])))
        )
        variance: FloatArray = np.sum((self._left * motion) ** 2, axis=1)
        return variance

    def _least_squares(
        self, velocity: FloatArray, variance: FloatArray, measured: tuple[bool, ...]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the twist that fits best, and its covariance."""
        use = np.array(measured)
        rows = self._matrix[use]
        weighted = rows / variance[use, None]
        covariance = np.linalg.inv(rows.T @ weighted)
        covariance = 0.5 * (covariance + covariance.T)
        twist = covariance @ (weighted.T @ velocity[use])
        return twist * self._unit, covariance * np.outer(self._unit, self._unit)

    def contradictions(
        self,
        velocity: FloatArray,
        variance: FloatArray,
        measured: tuple[bool, ...],
        twist: FloatArray,
        covariance: FloatArray,
    ) -> FloatArray:
        """Return how far each sensor is from the twist that all of them gave together.

        A residual over its own standard deviation. The twist has taken part of the error of each
        sensor; what is left of the variance is ``s_i^2 - a_i C a_i^T``.

        Args:
            velocity: as in `solve`.
            variance: as in `solve`.
            measured: as in `solve`.
            twist: that `solve` returned.
            covariance: that `solve` returned.

        Returns:
            Standard deviations of the residuals [1], of the same shape; 0 for a sensor that the
            others cannot check and for one that has not measured. With four sensors all four are
            equal: they see that something is wrong, but not which one.
        """
        rows = self._matrix / self._unit
        if self._calibrated:
            variance = variance + self._systematic(twist)
        left = variance - np.einsum("ij,jk,ik->i", rows, covariance, rows)
        checked = np.array(measured) & (left > _CHECKED * variance)
        residual = velocity - rows @ twist
        score: FloatArray = np.zeros(len(velocity))
        score[checked] = np.abs(residual[checked]) / np.sqrt(left[checked])
        return score


def _rows(sensors: Mapping[str, LineSensor], axle: float | None) -> FloatArray:
    """Return the rows of the sensors and below them that of the axle, shape (S + 1, 3)."""
    matrix = sensor_matrix(sensors)
    return matrix if axle is None else np.vstack((matrix, (0.0, 1.0, axle)))


def _problem(
    sensors: Mapping[str, LineSensor], minimum_lever: float, axle: float | None = None
) -> str:
    """Return what makes a placement unusable, empty if it is usable."""
    names = ", ".join(sensors) or "none"
    if axle is None and len(sensors) < 3:
        hint = ""
        if len(sensors) == 2:
            hint = "; two suffice with an axle that does not slip sideways (kinematics.constraint)"
        return (
            f"three sensors are needed to measure the twist, these are {len(sensors)}: {names}"
            + hint
        )
    if axle is not None and len(sensors) < 2:
        return (
            "two sensors are needed beside the axle that does not slip sideways, "
            f"these are {len(sensors)}: {names}"
        )
    position = np.array([[sensor.x, sensor.y] for sensor in sensors.values()])
    if axle is not None:
        names += f" and of the axle at x = {axle:g} m"
        position = np.vstack((position, (axle, 0.0)))
    matrix = _rows(sensors, axle)
    axes, levers = matrix[:, :2], matrix[:, 2]
    count = len(matrix)
    if np.linalg.eigvalsh(axes.T @ axes)[0] / count < _NARROWEST:
        return (
            f"the axes of {names} are parallel within a few degrees: the velocity across them "
            "cannot be measured; turn at least one of the sensors"
        )
    velocity, *_ = np.linalg.lstsq(axes, levers, rcond=None)
    lever = float(np.linalg.norm(levers - axes @ velocity)) / math.sqrt(count)
    spread = float(np.sqrt(np.mean(np.sum((position - position.mean(axis=0)) ** 2, axis=1))))
    if lever < max(minimum_lever, _WEAKEST_LEVER * spread):
        # Axis i passes the point c at the distance cross(r_i, a_i) - cross(c, a_i).
        centre_x, centre_y = (round(float(c), 2) + 0.0 for c in (velocity[1], -velocity[0]))
        return (
            f"the axes of {names} pass through one point, ({centre_x:.2f}, {centre_y:.2f}) m, "
            f"within {1e3 * lever:.0f} mm: turning about it cannot be measured; set them "
            "tangentially"
        )
    return ""
