"""Inertial measurement unit (IMU): yaw rate and specific force at its mounting position.

A reading of the accelerometer is the mean since the previous reading, as in an IMU that averages
its samples. The specific force in the body axes at the middle of this period is

    f = R(psi)^T ((V - V_before) / T - g)

``V`` and ``V_before`` are the velocities of the mounting position in the ground plane, at the end
and at the start of the period ``T``. ``R(psi)`` is the rotation by the yaw angle, and ``g`` the
component of gravity along the ground plane, which may slope. The reading is ``f``, rotated by the
error of the mounting angle. The gyro gives the yaw rate at the stamp. Both sensors have a scale
error, a bias, white noise and a latency. The nodes that receive the readings do not know these
errors. The noise has a constant density, so more frequent readings are noisier.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_core.kernels import by_reference, kernel, lean
from omni_core.quantities import GRAVITY, SECOND_NS, FloatArray, IntArray
from omni_sim.sensor_configuration import ImuConfiguration

IMU_DRAWS = 3
"""Number of standard normal values that a reading needs."""


@by_reference
class Imu(NamedTuple):
    """Constants and state of the IMU, in the form that the kernel uses.

    Attributes:
        enabled: whether the vehicle has an IMU.
        period_ns: time between two readings [ns].
        most: limit on the number of readings in a control period.
        x: mounting position, forward of base_link [m].
        y: mounting position, left of base_link [m].
        cos: cosine of the error of the mounting angle [1].
        sin: sine of the error of the mounting angle [1].
        rate: bias [rad/s], noise [rad/s] and scale error [1] of the gyro, shape (3,).
        force: bias of x and y [m/s^2], noise [m/s^2] and scale error [1] of the accelerometer,
            shape (4,).
        memory: yaw [rad] and velocity of the mounting position [m/s] at the last reading, shape
            (3,).
        counters: stamp of the last reading [ns] and number of readings, shape (2,).
        late: latest readings, a ring buffer, shape (latency in readings + 1, 3).
    """

    enabled: bool
    period_ns: int
    most: int
    x: float
    y: float
    cos: float
    sin: float
    rate: FloatArray
    force: FloatArray
    memory: FloatArray
    counters: IntArray
    late: FloatArray


def build_imu(configuration: ImuConfiguration, control_period_ns: int) -> Imu:
    """Return the constants and the initial state of the IMU for the kernel.

    Args:
        configuration: mounting and errors of the IMU.
        control_period_ns: control period [ns].
    """
    c = configuration
    angle, period_ns = math.radians(c.misalignment_deg), c.period_ns(control_period_ns)
    factor, most = c.noise_factor(control_period_ns), -(-control_period_ns // period_ns)
    rate = np.array([c.gyro_bias, factor * c.gyro_noise, c.gyro_scale])
    force = np.array([c.bias_x, c.bias_y, factor * c.noise, c.scale])
    late = np.zeros((round(c.latency * SECOND_NS / period_ns) + 1, 3))
    cos, sin = math.cos(angle), math.sin(angle)
    memory, counters = np.zeros(3), np.zeros(2, np.int64)
    return Imu(c.enabled, period_ns, most, c.x, c.y, cos, sin, rate, force, memory, counters, late)


@lean
def is_due(imu: Imu, stamp_ns: int) -> bool:
    """Return whether the IMU takes a reading at a stamp [ns], the first one after a due time."""
    last_ns, count = imu.counters
    return bool(count == 0 or stamp_ns // imu.period_ns > last_ns // imu.period_ns)


@lean
def write_world(motion: FloatArray, row: FloatArray) -> None:
    """Write a motion with its velocity in world axes to `row`.

    Args:
        motion: x, y [m], yaw [rad] and body twist [m/s, m/s, rad/s] of `base_link`, shape (6,).
        row: output, x, y [m], yaw [rad] and their time derivatives, shape (6,).
    """
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    row[0], row[1], row[2], row[5] = motion[0], motion[1], motion[2], motion[5]
    row[3] = cos * motion[3] - sin * motion[4]
    row[4] = sin * motion[3] + cos * motion[4]


@kernel
def read_imu(
    imu: Imu,
    stamp_ns: int,
    motion: FloatArray,
    tilt: tuple[float, float],
    draw: FloatArray,
    reading: FloatArray,
) -> None:
    """Take a reading of the IMU.

    Args:
        imu: IMU, changed in place.
        stamp_ns: stamp of the reading [ns].
        motion: x, y [m], yaw [rad] of `base_link` and their time derivatives, shape (6,).
        tilt: horizontal components of the normal of the plane in which the vehicle moves [1].
        draw: standard normal noise, shape (3,).
        reading: output, yaw rate [rad/s] and specific force along x and y [m/s^2], shape (3,); NaN
            if the vehicle has no IMU.
    """
    (last_ns, count), counters = imu.counters, imu.counters
    counters[0], counters[1] = stamp_ns, count + 1
    if not imu.enabled:
        reading[:] = math.nan
        return
    yaw, rate = motion[2], motion[5]
    cos, sin = math.cos(yaw), math.sin(yaw)
    world_x = motion[3] - rate * (cos * imu.y + sin * imu.x)
    world_y = motion[4] + rate * (cos * imu.x - sin * imu.y)
    f_x, f_y = -GRAVITY * tilt[0], -GRAVITY * tilt[1]
    middle = yaw
    if count > 0:
        period = (stamp_ns - last_ns) * 1e-9
        f_x += (world_x - imu.memory[1]) / period
        f_y += (world_y - imu.memory[2]) / period
        middle = 0.5 * (yaw + imu.memory[0])
    imu.memory[0], imu.memory[1], imu.memory[2] = yaw, world_x, world_y
    cos, sin = math.cos(middle), math.sin(middle)
    body_x, body_y = cos * f_x + sin * f_y, cos * f_y - sin * f_x
    bias_x, bias_y, noise, scale = imu.force[0], imu.force[1], imu.force[2], 1.0 + imu.force[3]
    late = imu.late.shape[0]
    now = imu.late[count % late]
    now[0] = (1.0 + imu.rate[2]) * rate + imu.rate[0] + imu.rate[1] * draw[0]
    now[1] = scale * (imu.cos * body_x + imu.sin * body_y) + bias_x + noise * draw[1]
    now[2] = scale * (imu.cos * body_y - imu.sin * body_x) + bias_y + noise * draw[2]
    # Before the first delayed reading is due, the oldest reading is repeated.
    reading[:] = imu.late[max(count - late + 1, 0) % late]
