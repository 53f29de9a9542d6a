"""Mass and center of gravity of a vehicle from free rolling and from braking.

The unknowns are the mass ``m``, its first moments ``m x_g``, ``m y_g`` and the yaw inertia about
base_link. Both kinds of motion give linear equations in them.

*Free rolling.* A wheel without torque rolls without slip, so ground speed and wheel speed give its
radius under load (Eqs. (28), (32) of the dissertation),

    r_i = R_i - F_i / c_z,    F_i = p_i Q^-1 g (m, m x_g, m y_g)^T,    Q = sum p_i^T p_i

with the unloaded radius ``R_i``, the vertical stiffness ``c_z``, the load ``F_i`` (Eq. (1)) and
``p_i = (1, x_i, y_i)`` from the wheel's position: the loads are a plane, as in
`omni_sim.vehicle.loads`. Observable are mass and center of gravity, and with more than three wheels
a check whether the loads are such a plane. A drive that controls the wheel speeds exerts torques
that hide differences of the radii, so the motors must be without torque. The height of
the center of gravity and the yaw inertia are not observable. A drive of the empty vehicle gives the
radii, so that errors which are the same in both drives cancel: of the radii, and of the scale of
the ground speed. A camera without a telecentric lens at the height ``h`` sinks with the chassis and
measures ``1 / (1 - d / h)`` times the speed if the tires are compressed by ``d`` below it. If
the cameras are known, the equations contain this effect.

*Braking.* Wheels that turn under known brake torques have known forces (`braking`).

Steered wheels are evaluated only while they roll in the direction of their heading.

The estimates of both parts are combined by their covariances. These contain the scatter of the
measurements, and the standard errors in `Uncertainty` of what is assumed.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from omni_core.configuration import WorkError
from omni_core.geometry import PlatformGeometry
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import FloatArray
from omni_core.sensors import Mount, sensor_matrix
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_tools.load_estimate import braking
from omni_tools.load_estimate.data import DriveData, LoadDataError, free_blocks, unsteered

BLOCK = 0.5
"""Duration of a time span whose mean is one measurement of the radii [s]. It is longer than the
correlation time of the twist's errors."""

FEWEST_BLOCKS = 6
"""Least number of such spans from which their scatter is estimated."""

_UNKNOWN = 1e-10  # information that keeps the sum regular; a standard error of 1e5 kg, 1e5 kg m
_ROLLING = 0.2  # limit on the acceleration of free rolling [m/s^2]; rolling resistance causes 0.15


class Uncertainty(NamedTuple):
    """Standard errors of what the estimate assumes.

    Attributes:
        radius: radius of each wheel, by wear since the calibration [m].
        stiffness: vertical stiffness of the tires [1].
        torque: torque of each brake, and common error of all torques [1].
    """

    radius: float
    stiffness: float
    torque: float


class Cameras(NamedTuple):
    """Line cameras whose lenses are not telecentric.

    Attributes:
        sensors: cameras that measure the twist, keyed by name.
        height: height of the lenses above the ground [m].
    """

    sensors: Mapping[str, Mount]
    height: float


class LoadEstimate(NamedTuple):
    """Masses of a vehicle with N wheels, estimated from a drive.

    Attributes:
        moments: mass and first moments ``(m, m x_g, m y_g)`` [kg, kg m, kg m], shape (3,).
        covariance: covariance of `moments`, shape (3, 3).
        loads: wheel loads at rest [N], shape (N,).
        load_errors: standard errors of `loads` [N], shape (N,).
        unevenness: largest difference of a measured radius from the plane of the loads, divided by
            its standard error [1]; NaN for three wheels or without free rolling.
        rolling: duration of free rolling [s].
        braking: duration of braking with known forces [s].
    """

    moments: FloatArray
    covariance: FloatArray
    loads: FloatArray
    load_errors: FloatArray
    unevenness: float
    rolling: float
    braking: float


class _Radii(NamedTuple):
    """Rolling radii [m], their covariance, the mean twist, and the number of measurements."""

    radius: FloatArray
    covariance: FloatArray
    twist: FloatArray
    blocks: int


def estimate_load(
    drive: DriveData,
    vehicle: VehicleConfiguration,
    uncertainty: Uncertainty,
    empty: DriveData | None = None,
    cameras: Cameras | None = None,
) -> LoadEstimate:
    """Estimate the masses of a vehicle with its load.

    Args:
        drive: drive with the load.
        vehicle: vehicle, whose `body` is the empty vehicle; its load is not used.
        uncertainty: standard errors of the assumptions.
        empty: drive of the empty vehicle; without it, radii and torques are those of the file.
        cameras: cameras that measure the twist; None if their lenses are telecentric.

    Raises:
        LoadDataError: the drive contains too little free rolling and braking.
        WorkError: the equations do not determine the center of gravity.
    """
    drive = unsteered(drive, vehicle.wheels, BLOCK)
    empty = empty and unsteered(empty, vehicle.wheels, BLOCK)
    here, there = _radii(drive, vehicle), empty and _radii(empty, vehicle)
    parts, unevenness, rolling = [], math.nan, 0.0
    if here is not None and (empty is None or there is not None):
        part, unevenness = _from_rolling(here, there, vehicle, uncertainty, cameras)
        parts.append(part)
        rolling = here.blocks * BLOCK
    torque = uncertainty.torque
    stop = braking.from_braking(drive, vehicle, here and here.radius, torque)
    first = empty and braking.from_braking(empty, vehicle, there and there.radius, torque)
    if stop is not None:
        parts.append(braking.calibrated(stop, first, vehicle.body.mass, torque))
    if not parts:
        raise LoadDataError(
            f"the drive has less than {FEWEST_BLOCKS * BLOCK:g} s of free rolling, and no braking "
            "with measured torques under which wheels turn: drive straight ahead at constant "
            "speed without motor torque, and brake gently"
        )
    information = sum(part.information for part in parts) + _UNKNOWN * np.eye(3)
    covariance: FloatArray = np.linalg.inv(information).astype(np.float64)
    moments = covariance @ sum(part.information @ part.moments for part in parts)
    _require_accuracy(moments, covariance)
    per_moment = braking.load_matrix(vehicle)
    errors = np.sqrt(np.diag(per_moment @ covariance @ per_moment.T))
    braked = stop.duration if stop is not None else 0.0
    loads = per_moment @ moments
    return LoadEstimate(moments, covariance, loads, errors, unevenness, rolling, braked)


def center_of(moments: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mass and center of gravity [kg, m, m] and their standard errors, shapes (3,), (3,)."""
    mass = moments[0]
    x, y = moments[1:] / mass
    change = np.array([[1.0, 0.0, 0.0], [-x / mass, 1.0 / mass, 0.0], [-y / mass, 0.0, 1.0 / mass]])
    return np.array([mass, x, y]), np.sqrt(np.diag(change @ covariance @ change.T))


def load_of(found: LoadEstimate, vehicle: VehicleConfiguration) -> tuple[FloatArray, FloatArray]:
    """Return mass and position of the load [kg, m, m] and their standard errors, (3,), (3,)."""
    return center_of(found.moments - braking.first_moments(vehicle.body), found.covariance)


def _require_accuracy(moments: FloatArray, covariance: FloatArray) -> None:
    """Raise `WorkError` if the center of gravity is hardly known."""
    values, errors = center_of(moments, covariance)
    if not (values[0] > 2.0 * errors[0] and np.max(errors[1:]) < 1.0):
        raise WorkError(
            f"the drive gives {values[0]:.0f} kg with a standard error of {errors[0]:.0f} kg and a "
            f"center of gravity with {errors[1]:.2g} m forward and {errors[2]:.2g} m to the left: "
            "roll freely for longer, or brake in two directions"
        )


def _radii(drive: DriveData, vehicle: VehicleConfiguration) -> _Radii | None:
    """Return the rolling radii in a drive, their covariance and the mean twist; None if unknown."""
    kinematics = PlatformKinematics.of(vehicle.wheels)
    limit = _ROLLING / float(np.max(kinematics.geometry.radius))
    rows = free_blocks(drive, BLOCK, braking.SLOWEST, limit)
    if len(rows) < FEWEST_BLOCKS:
        return None
    rims = kinematics.wheel_speeds(drive.twist, np.ones(len(vehicle.wheels)))
    found = np.array([np.sum(rims[r], 0) / np.sum(drive.wheel_speed[r], 0) for r in rows])
    n = len(found)
    # The factor accounts for the estimate of the covariance from few spans (Student's t).
    spread = np.cov(found.T) / n * (n - 1) / (n - 3)
    moved = np.array([np.mean(drive.twist[r], axis=0) for r in rows])
    ahead = np.where(moved[:, :1] < 0.0, -1.0, 1.0)  # a drive back is the same motion, reversed
    twist = np.mean(ahead * moved, axis=0)
    return _Radii(np.mean(found, axis=0), spread, twist, n)


def _from_rolling(
    here: _Radii,
    there: _Radii | None,
    vehicle: VehicleConfiguration,
    uncertainty: Uncertainty,
    cameras: Cameras | None,
) -> tuple[braking.Part, float]:
    """Return the estimate from rolling radii, and the unevenness of the loads."""
    stiffness, n = vehicle.tire.vertical_stiffness, len(vehicle.wheels)
    reference, spread = PlatformGeometry.from_wheels(vehicle.wheels).radius, here.covariance
    known = np.zeros(n)
    if there is not None:
        reference, spread = there.radius, spread + there.covariance
        known = _compression(vehicle, there, cameras) @ braking.first_moments(vehicle.body)
    compressed = stiffness * (reference - here.radius)
    matrix = _compression(vehicle, here, cameras)
    inverse = np.linalg.pinv(matrix)
    noise = stiffness**2 * (spread + uncertainty.radius**2 * np.eye(n))
    scaled = uncertainty.stiffness * inverse @ compressed
    moments = inverse @ (compressed + known)
    unevenness = math.nan
    if n > 3:
        rest = np.eye(n) - matrix @ inverse
        left = rest @ (compressed + known)
        sizes = np.sqrt(np.diag(rest @ noise @ rest.T))
        unevenness = float(np.max(np.abs(left) / np.maximum(sizes, 1e-9)))
    covariance = inverse @ noise @ inverse.T + np.outer(scaled, scaled)
    information = np.linalg.inv(covariance).astype(np.float64)
    return braking.Part(moments, information, here.blocks * BLOCK), unevenness


def _compression(
    vehicle: VehicleConfiguration, found: _Radii, cameras: Cameras | None
) -> FloatArray:
    """Return the matrix from moments to ``c_z (R - r)`` with the measured radii r [N], (N, 3)."""
    loads = braking.load_matrix(vehicle)
    if cameras is None:
        return loads
    kinematics = PlatformKinematics.of(vehicle.wheels)
    points = np.array([(one.x, one.y) for one in cameras.sensors.values()])
    measured = sensor_matrix(cameras.sensors)
    # Each camera measures too large a speed, in proportion to the compression below it.
    rims = kinematics.matrix @ np.linalg.pinv(measured) @ np.diag(measured @ found.twist)
    share = rims / (kinematics.matrix @ found.twist)[:, np.newaxis]
    share = share @ braking.load_matrix(vehicle, points)
    return np.asarray(loads - found.radius[:, np.newaxis] / cameras.height * share)
