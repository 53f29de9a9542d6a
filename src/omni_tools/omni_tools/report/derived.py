"""Slips and loads of the wheels, which are not recorded.

Both are computed from the recorded true motion and the vehicle's configuration. The slip is that of
the rim relative to the ground. The simulator's slip is that of the contact patch, which differs for
a few milliseconds after a change of the brake because the tire is elastic. The loads are those on
flat ground.
"""

import numpy as np

from omni_loop.history import RunHistory
from omni_platform.geometry import PlatformGeometry, turned
from omni_platform.quantities import FloatArray
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import GRAVITY, MassProperties, load_plane, support_polygon, wheel_loads


def rim_slips(
    vehicle: VehicleConfiguration, history: RunHistory, standstill: float = 0.05
) -> FloatArray:
    """Return the slips of the rims along the active directions: 0 for rolling, 1 for locked.

    The definition ``(n_w . v_i - omega R (n_w . u_i)) / max(|n_w . v_i|, |omega R (n_w . u_i)|)``
    is Eqs. (20), (22) with a sign, for a wheel with the active direction ``n_w``, the velocity
    ``v_i`` of its center, the wheel speed ``omega``, the radius ``R`` and the rolling direction
    ``u_i``. It is relative to the larger speed, because Eq. (20) grows without bound for a locked
    wheel. If the slip is above 1, the rim turns backward; at rest the slip is NaN.

    Args:
        vehicle: vehicle with the wheels of the history, in any order.
        history: the run.
        standstill: speed below which a wheel counts as at rest [m/s].

    Returns:
        Slips [1], from -2 to 2, shape (T, N), in the order of the history's wheels.
    """
    geometry = _geometry(vehicle, history)
    hub = history.twist @ np.column_stack((geometry.active, geometry.lever)).T  # Eq. (23)
    rim = history.wheel_speed * geometry.radius * np.sum(geometry.active * geometry.rolling, axis=1)
    larger = np.maximum(np.abs(hub), np.abs(rim))
    larger[larger < standstill] = np.nan
    return np.asarray((hub - rim) / larger, dtype=np.float64)


def flat_ground_loads(vehicle: VehicleConfiguration, history: RunHistory) -> FloatArray:
    """Return the vertical loads that balance weight and inertia in the recorded motion.

    The loads follow the acceleration of the center of gravity with the load transfer time.

    Args:
        vehicle: vehicle with the wheels of the history, in any order.
        history: the run.

    Returns:
        Loads [N], shape (T, N), in the order of the history's wheels.
    """
    masses = MassProperties.of(vehicle.body, vehicle.load)
    position = _geometry(vehicle, history).position - masses.center
    plane, hull = load_plane(position), support_polygon(position)
    acceleration = _acceleration(masses.center, history)
    loads = np.empty((len(history.stamp_ns), len(position)))
    lagged = np.zeros(2)
    periods = np.diff(history.time, prepend=history.time[0])
    for row, period in enumerate(periods.tolist()):
        share = period / (period + vehicle.load_transfer_time) if period > 0.0 else 0.0
        lagged += share * (acceleration[row] - lagged)
        z_x, z_y = (-masses.height / GRAVITY * lagged).tolist()
        wheel_loads(position, plane, hull, masses.mass * GRAVITY, z_x, z_y, loads[row])
    return loads


def _acceleration(point: FloatArray, history: RunHistory) -> FloatArray:
    """Return the acceleration of a point of the body, in the body frame [m/s^2], shape (T, 2)."""
    if len(history.stamp_ns) < 2:
        return np.zeros((len(history.stamp_ns), 2))
    yaw, yaw_rate = history.pose[:, 2], history.twist[:, 2:]
    velocity = turned(history.twist[:, :2] + yaw_rate * [-point[1], point[0]], yaw)
    a = np.diff(velocity, axis=0) / np.diff(history.time)[:, np.newaxis]
    return turned(np.vstack((a[:1], a)), -yaw)  # acceleration in the period before each stamp


def _geometry(vehicle: VehicleConfiguration, history: RunHistory) -> PlatformGeometry:
    return PlatformGeometry.from_wheels(
        {name: vehicle.wheels[name] for name in history.wheel_names}
    )
