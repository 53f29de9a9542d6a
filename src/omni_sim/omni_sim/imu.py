"""Inertial measurement unit (IMU): yaw rate and specific force at its mounting position.

A reading of the accelerometer is the mean over a control period, as in an IMU that averages its
samples. The specific force in the body axes at the middle of the period is

    f = R(psi)^T ((V - V_before) / T - g)

``V`` and ``V_before`` are the velocities of the mounting position in the ground plane, at the end
and at the start of the period ``T``. ``R(psi)`` is the rotation by the yaw angle, and ``g`` the
component of gravity along the ground plane, which may slope. The reading is ``f``, rotated by the
error of the mounting angle. The gyro gives the yaw rate at the stamp. Both sensors have a scale
error, a bias, white noise and a latency. The nodes that receive the readings do not know these
errors.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_platform.configuration import Configuration, parameter
from omni_platform.kernels import kernel
from omni_platform.quantities import FloatArray
from omni_sim.vehicle.loads import GRAVITY

IMU_DRAWS = 3
"""Number of standard normal values that a reading needs."""


class ImuConfiguration(Configuration):
    """Mounting and errors of the IMU; the defaults describe a good MEMS unit.

    No error may exceed the largest usual measuring ranges of such units, 2000 deg/s and 16 g.
    """

    enabled: bool = parameter(True)
    """Whether the vehicle has an IMU"""
    x: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Mounting position, forward of the platform center"""
    y: float = parameter(0.0, unit="m", minimum=-100.0, maximum=100.0)
    """Mounting position, left of the platform center"""
    misalignment_deg: float = parameter(0.2, unit="deg", minimum=-180.0, maximum=180.0)
    """Error of the mounting angle about the vertical axis"""
    gyro_bias: float = parameter(0.005, unit="rad/s", minimum=-35.0, maximum=35.0)
    """Bias of the yaw rate"""
    gyro_noise: float = parameter(0.003, unit="rad/s", minimum=0.0, maximum=35.0)
    """Standard deviation of the noise of the yaw rate"""
    gyro_scale: float = parameter(0.002, minimum=-0.9, maximum=10.0)
    """Scale error of the yaw rate"""
    bias_x: float = parameter(0.05, unit="m/s^2", minimum=-160.0, maximum=160.0)
    """Bias of the accelerometer's x axis"""
    bias_y: float = parameter(-0.05, unit="m/s^2", minimum=-160.0, maximum=160.0)
    """Bias of the accelerometer's y axis"""
    noise: float = parameter(0.05, unit="m/s^2", minimum=0.0, maximum=160.0)
    """Standard deviation of the noise of each accelerometer axis"""
    scale: float = parameter(0.003, minimum=-0.9, maximum=10.0)
    """Scale error of both accelerometer axes"""
    latency: float = parameter(0.0, unit="s", minimum=0.0, maximum=0.2)
    """Latency of a reading, rounded to control periods"""


class Imu(NamedTuple):
    """Constants and state of the IMU, in the form that the kernel uses.

    Attributes:
        enabled: whether the vehicle has an IMU.
        x: mounting position, forward of base_link [m].
        y: mounting position, left of base_link [m].
        cos: cosine of the error of the mounting angle [1].
        sin: sine of the error of the mounting angle [1].
        rate: bias [rad/s], noise [rad/s] and scale error [1] of the gyro, shape (3,).
        force: bias of x and y [m/s^2], noise [m/s^2] and scale error [1] of the accelerometer,
            shape (4,).
        memory: yaw [rad] and velocity of the mounting position [m/s] at the last stamp, shape (3,).
        late: latest readings, a ring buffer over the stamps, shape (latency in control periods + 1,
            3).
    """

    enabled: bool
    x: float
    y: float
    cos: float
    sin: float
    rate: FloatArray
    force: FloatArray
    memory: FloatArray
    late: FloatArray


def build_imu(configuration: ImuConfiguration, control_period: float) -> Imu:
    """Return the constants and the initial state of the IMU for the kernel.

    Args:
        configuration: mounting and errors of the IMU.
        control_period: time between two readings [s].
    """
    c = configuration
    angle = math.radians(c.misalignment_deg)
    rate = np.array([c.gyro_bias, c.gyro_noise, c.gyro_scale])
    force = np.array([c.bias_x, c.bias_y, c.noise, c.scale])
    late = np.zeros((round(c.latency / control_period) + 1, 3))
    cos, sin = math.cos(angle), math.sin(angle)
    return Imu(c.enabled, c.x, c.y, cos, sin, rate, force, np.zeros(3), late)


@kernel
def read_imu(
    imu: Imu,
    step: int,
    period: float,
    motion: FloatArray,
    tilt: tuple[float, float],
    draw: FloatArray,
    reading: FloatArray,
) -> None:
    """Write the reading of the IMU; this function must be called once per stamp.

    Args:
        imu: IMU, changed in place.
        step: number of the stamp.
        period: time between two stamps [s].
        motion: x, y [m], yaw [rad] and body twist [m/s, m/s, rad/s] of `base_link`, shape (6,).
        tilt: horizontal components of the normal of the plane in which the vehicle moves [1].
        draw: standard normal noise, shape (3,).
        reading: output, yaw rate [rad/s] and specific force along x and y [m/s^2], shape (3,); NaN
            if the vehicle has no IMU.
    """
    if not imu.enabled:
        reading[:] = math.nan
        return
    yaw, rate = motion[2], motion[5]
    v_x, v_y = motion[3] - rate * imu.y, motion[4] + rate * imu.x
    cos, sin = math.cos(yaw), math.sin(yaw)
    world_x, world_y = cos * v_x - sin * v_y, sin * v_x + cos * v_y
    f_x, f_y = -GRAVITY * tilt[0], -GRAVITY * tilt[1]
    middle = yaw
    if step > 0:
        f_x += (world_x - imu.memory[1]) / period
        f_y += (world_y - imu.memory[2]) / period
        middle = 0.5 * (yaw + imu.memory[0])
    imu.memory[0], imu.memory[1], imu.memory[2] = yaw, world_x, world_y
    cos, sin = math.cos(middle), math.sin(middle)
    body_x, body_y = cos * f_x + sin * f_y, cos * f_y - sin * f_x
    bias_x, bias_y, noise, scale = imu.force[0], imu.force[1], imu.force[2], 1.0 + imu.force[3]
    late = imu.late.shape[0]
    now = imu.late[step % late]
    now[0] = (1.0 + imu.rate[2]) * rate + imu.rate[0] + imu.rate[1] * draw[0]
    now[1] = scale * (imu.cos * body_x + imu.sin * body_y) + bias_x + noise * draw[1]
    now[2] = scale * (imu.cos * body_y - imu.sin * body_x) + bias_y + noise * draw[2]
    # Before the first delayed reading is due, the oldest reading is repeated.
    reading[:] = imu.late[max(step - late + 1, 0) % late]
