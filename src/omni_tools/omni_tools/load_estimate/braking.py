"""Mass and center of gravity of a vehicle from braking with known torques.

If wheels turn under known brake torques ``T_i``, their forces ``f_i = (T_i - I
d(omega_i)/dt) / g_i`` are known (`omni_tools.brakes.fit`). With ``g_i = r_i cos(gamma_i)``,

    sum f_i = m a + dOmega/dt k x (m r_g),    sum cross(r_i, f_i) = cross(m r_g, a) + J dOmega/dt

with the acceleration ``a`` of base_link; `_momentum` adds the centripetal part.
Observable are the mass and the center of gravity's distance from the line of deceleration through
base_link; stops in two directions give both coordinates. An error of the torques that is the same
for all brakes changes the mass, but not the center of gravity. The side forces of conventional
wheels are unknown, so a vehicle on such wheels alone shows only its mass.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_core.geometry import PlatformGeometry, cross, turned
from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.masses import MassConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.load_estimate.data import DriveData

SLOWEST = 0.5
"""Speed above which a wheel turns [rad/s]."""

_FEWEST_INTERVALS = 10  # in a time span of braking


class Part(NamedTuple):
    """Estimate from one kind of motion; `information` is the inverse of the covariance."""

    moments: FloatArray
    information: FloatArray
    duration: float


def from_braking(
    drive: DriveData, vehicle: VehicleConfiguration, radius: FloatArray | None, error: float
) -> Part | None:
    """Return the estimate from braking with exact torques; None if there is too little braking.

    Args:
        drive: the drive.
        vehicle: the vehicle.
        radius: rolling radii [m], shape (N,); None if they are unknown.
        error: standard error of the torque of each brake, apart from their common error [1].
    """
    body, moments = vehicle.body, first_moments(vehicle.body)
    gyration = body.yaw_inertia / body.mass
    for _ in range(3):  # radii and yaw inertia depend on the mass
        radii = _static_radii(vehicle, moments) if radius is None else radius
        pieces = _braking_equations(drive, vehicle, radii)
        if not pieces:
            return None
        rows = np.concatenate([one.reshape(-1, one.shape[2]) for one, _ in pieces])
        count = sum(len(one) * rank for one, rank in pieces)
        matrix, turning, wheels = rows[:, :3], rows[:, 3], rows[:, 4:]
        inertia, spread = _yaw_inertia(vehicle, moments)
        target = wheels.sum(axis=1) - inertia * turning
        moments = np.linalg.lstsq(matrix, target, rcond=1e-9)[0]
    left = target - matrix @ moments
    variance = (left @ left / count + 1e-9) * _correlation(left.reshape(-1, 3))
    # Noise of the twist, whose variance follows from the residuals, increases the square of each
    # column of the first moments without being information.
    noise = count / 3.0 * 2.0 / (gyration * moments[0] ** 2)
    information = _without_negative(matrix.T @ matrix / variance - np.diag([0.0, noise, noise]))
    unknown = np.column_stack((spread * turning, error * wheels))
    systematic = np.linalg.lstsq(matrix, unknown, rcond=1e-9)[0]
    duration = len(rows) / 3.0 * float(np.median(np.diff(drive.time)))
    return Part(moments, _weakened(information, systematic), duration)


def calibrated(stop: Part, empty: Part | None, mass: float, error: float) -> Part:
    """Return the estimate from braking if the torques of all brakes have a common error.

    Args:
        stop: estimate with the nominal torques.
        empty: estimate for the empty vehicle, which calibrates the torques; may be None.
        mass: mass of the empty vehicle [kg].
        error: standard error of the torques, or of their change since the calibration [1].
    """
    share = 1.0
    if empty is not None:
        share = mass / empty.moments[0]
        error = math.hypot(error, 1.0 / (math.sqrt(empty.information[0, 0]) * empty.moments[0]))
    moments = share * stop.moments
    common = error * moments[:, np.newaxis]
    return Part(moments, _weakened(stop.information / share**2, common), stop.duration)


def _yaw_inertia(vehicle: VehicleConfiguration, moments: FloatArray) -> tuple[float, float]:
    """Return the yaw inertia about base_link and its standard error [kg m^2].

    The load counts as a point. Its standard error is the inertia of a box of the chassis' size.
    """
    body = vehicle.body
    mass, *first = moments - first_moments(body)
    inertia = body.yaw_inertia + body.mass * (body.x**2 + body.y**2)
    mass = max(mass, 0.0)
    if mass > 0.0:
        reach = min(math.hypot(*first) / mass, 0.5 * float(np.hypot(*vehicle.chassis_size)))
        inertia += mass * reach**2
    spread = mass / 12.0 * float(np.sum(vehicle.chassis_size**2)) + 0.02 * inertia
    return inertia, spread


def _without_negative(matrix: FloatArray) -> FloatArray:
    """Return a symmetric matrix with its negative eigenvalues replaced by zero."""
    sizes, axes = np.linalg.eigh(matrix)
    return np.asarray(axes * np.maximum(sizes, 0.0) @ axes.T)


def _weakened(information: FloatArray, systematic: FloatArray) -> FloatArray:
    """Return the information after independent systematic errors are added to the covariance.

    Args:
        information: inverse of the covariance, which may be singular, shape (3, 3).
        systematic: effect of each error on the estimate, of one standard error, shape (3, S).
    """
    seen = information @ systematic
    inner = np.eye(systematic.shape[1]) + systematic.T @ seen
    return np.asarray(information - seen @ np.linalg.solve(inner, seen.T))


def _static_radii(vehicle: VehicleConfiguration, moments: FloatArray) -> FloatArray:
    loads = load_matrix(vehicle) @ moments
    nominal = PlatformGeometry.from_wheels(vehicle.wheels).radius
    return np.asarray(nominal - loads / vehicle.tire.vertical_stiffness)


def _correlation(left: FloatArray) -> float:
    """Return the factor by which correlated residuals increase a variance [1]; shape (K, 3)."""
    total = size = float(np.sum(left**2))
    for lag in range(1, len(left) // 4):
        shared = float(np.sum(left[lag:] * left[:-lag]))
        if shared <= 0.0:
            break
        total += 2.0 * shared
    return total / size if size > 0.0 else 1.0


def _braking_equations(
    drive: DriveData, vehicle: VehicleConfiguration, radius: FloatArray
) -> list[tuple[FloatArray, float]]:
    """Return the momentum equations of each time span in which the same wheels turn under brakes.

    The forces of the other wheels and the side forces of conventional wheels are unknown, so the
    equations are projected onto the directions that they cannot affect. They are sums from the
    start of the span, without their mean: the error of a measured speed then occurs in one row.

    Returns:
        For each span, the coefficients of mass, first moments and yaw inertia about base_link and
        the impulse of each wheel [N s], shape (K, 3, 4 + N), and the number of independent
        equations. The equation of the moment is divided by the radius of gyration.
    """
    geometry, body = PlatformGeometry.from_wheels(vehicle.wheels), vehicle.body
    length = math.sqrt(body.yaw_inertia / body.mass)
    rim = np.sum(geometry.active * geometry.rolling, axis=1)
    wrench, sideways = (
        np.column_stack((along, cross(geometry.position, along) / length))
        for along in (geometry.active, geometry.passive)
    )
    sideways = sideways[geometry.conventional]
    step, speed = np.diff(drive.time), drive.wheel_speed
    pressed = np.minimum(drive.pedal[1:], drive.pedal[:-1]) >= vehicle.drive.clutch_threshold
    turns = (np.abs(speed[1:]) > SLOWEST) & (speed[1:] * speed[:-1] > 0.0)
    torque = 0.5 * (drive.torque[1:] + drive.torque[:-1]) * -np.sign(speed[1:])
    use = pressed & np.any(turns, axis=1) & np.all(np.isfinite(torque), axis=1) & (step < 0.1)
    slowed = vehicle.wheel_inertia * np.diff(speed, axis=0)
    push = (torque * step[:, np.newaxis] - slowed) / (radius * rim)
    momentum = _momentum(drive.twist, step)
    momentum[:, 2] /= length
    impulse = np.where(turns, push, 0.0)[:, np.newaxis, :] * wrench.T
    columns = np.concatenate((momentum, impulse), axis=2)
    changed = np.any(turns[1:] != turns[:-1], axis=1) | (use[1:] != use[:-1])
    pieces = []
    for rows in np.split(np.arange(len(step)), np.flatnonzero(changed) + 1):
        if len(rows) < _FEWEST_INTERVALS or not use[rows[0]]:
            continue
        unknown = np.concatenate((wrench[~turns[rows[0]]], sideways))
        free = np.eye(3) - np.linalg.pinv(unknown) @ unknown
        if (rank := float(np.trace(free))) > 0.5:
            pieces.append((_summed(free @ columns[rows]), rank))
    return pieces


def _momentum(twist: FloatArray, step: FloatArray) -> FloatArray:
    """Return the change of momentum per unknown in each interval, shape (K - 1, 3, 4).

    The axes have the mean heading of the interval.
    """
    rate = twist[:, 2]
    half = 0.25 * (rate[1:] + rate[:-1]) * step
    zero = np.zeros_like(rate)

    def change(x: FloatArray, y: FloatArray) -> FloatArray:
        velocity = np.column_stack((x, y))
        return turned(velocity[1:], half) - turned(velocity[:-1], -half)

    speed = change(twist[:, 0], twist[:, 1])
    rows = np.zeros((len(step), 3, 4))
    rows[:, :2, 0] = speed
    rows[:, :2, 1], rows[:, :2, 2] = change(zero, rate), change(-rate, zero)
    rows[:, 2, 1], rows[:, 2, 2], rows[:, 2, 3] = speed[:, 1], -speed[:, 0], np.diff(rate)
    return rows


def _summed(rows: FloatArray) -> FloatArray:
    sums = np.cumsum(np.concatenate((np.zeros_like(rows[:1]), rows)), axis=0)
    return np.asarray(sums - np.mean(sums, axis=0))


def first_moments(mass: MassConfiguration) -> FloatArray:
    """Return mass and first moments ``(m, m x, m y)`` [kg, kg m, kg m], shape (3,)."""
    return mass.mass * np.array([1.0, mass.x, mass.y])


def load_matrix(vehicle: VehicleConfiguration, points: FloatArray | None = None) -> FloatArray:
    """Return the matrix from ``(m, m x_g, m y_g)`` to the plane of the wheel loads at points.

    Args:
        vehicle: the vehicle.
        points: points in the body frame [m], shape (M, 2); the positions of the wheels if None.

    Returns:
        Matrix, shape (M, 3).
    """
    position = PlatformGeometry.from_wheels(vehicle.wheels).position
    wheels, places = (
        np.column_stack((np.ones(len(one)), one))
        for one in (position, position if points is None else points)
    )
    return np.asarray(GRAVITY * places @ np.linalg.inv(wheels.T @ wheels))
