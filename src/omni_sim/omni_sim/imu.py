"""The inertial measurement unit: yaw rate and specific force at its mounting position.

The accelerometer gives the mean over a control period, like a unit that averages its samples. With
the velocity ``V`` of the mounting point in the ground plane and the component ``g`` of gravity
along the (sloping) plane, it is

    f = R(psi)^T ((V - V_before) / T - g)

in the body axes at the middle of the period, rotated by the error of the mounting angle. The gyro
gives the yaw rate at the stamp. Both have a scale error, a bias, white noise and a latency. The
receiving nodes know none of these errors.
"""

import math
from typing import NamedTuple

import numpy as np

from omni_platform.configuration import Configuration, parameter
from omni_platform.kernels import kernel
from omni_platform.quantities import FloatArray
from omni_sim.vehicle.loads import GRAVITY

IMU_DRAWS = 3
"""Standard normal draws that a reading needs."""


class ImuConfiguration(Configuration):
    """Mounting and errors of the inertial measurement unit; defaults of a good MEMS unit."""

    enabled: bool = parameter(True)
    """Whether the vehicle has an IMU"""
    x: float = parameter(0.0, unit="m")
    """Mounting, forward of the platform center"""
    y: float = parameter(0.0, unit="m")
    """Mounting, left of the platform center"""
    misalignment_deg: float = parameter(0.2, unit="deg", minimum=-180.0, maximum=180.0)
    """Error of the mounting angle"""
    gyro_bias: float = parameter(0.005, unit="rad/s")
    """Constant error"""
    gyro_noise: float = parameter(0.003, unit="rad/s", minimum=0.0)
    """Standard deviation of the yaw rate"""
    gyro_scale: float = parameter(0.002, minimum=-0.9)
    """Error of the scale"""
    bias_x: float = parameter(0.05, unit="m/s^2")
    """Constant error of the x axis"""
    bias_y: float = parameter(-0.05, unit="m/s^2")
    """Constant error of the y axis"""
    noise: float = parameter(0.05, unit="m/s^2", minimum=0.0)
    """Standard deviation of an acceleration"""
    scale: float = parameter(0.003, minimum=-0.9)
    """Error of the scale of both axes"""
    latency: float = parameter(0.0, unit="s", minimum=0.0, maximum=0.2)
    """Latency of a reading, rounded to control periods"""


class Imu(NamedTuple):
    """Constants and state of the unit in the layout of the kernel.

    Attributes:
        enabled: whether there is a unit.
        x: mounting position, forward of base_link [m].
        y: mounting position, left of base_link [m].
        cos: cosine of the error of the mounting angle [1].
        sin: sine of the error of the mounting angle [1].
        rate: bias [rad/s], noise [rad/s] and scale error [1] of the gyro, shape (3,).
        force: bias of x and y [m/s^2], noise [m/s^2] and scale error [1] of the accelerometer,
            shape (4,).
        memory: yaw [rad] and velocity of the mounting point [m/s] one stamp ago, shape (3,).
        late: the latest readings, a ring buffer by stamp, shape (L, 3).
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
    """Return the unit in the layout of the kernel, before its first reading.

    Args:
        configuration: mounting and errors.
        control_period: time between two readings [s].
    """
    c = configuration
    angle = math.radians(c.misalignment_deg)
    return Imu(
        c.enabled,
        c.x,
        c.y,
        math.cos(angle),
        math.sin(angle),
        np.array([c.gyro_bias, c.gyro_noise, c.gyro_scale]),
        np.array([c.bias_x, c.bias_y, c.noise, c.scale]),
        np.zeros(3),
        np.zeros((round(c.latency / control_period) + 1, 3)),
    )


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
    """Read the unit; once per stamp.

    Args:
        imu: changed in place.
        step: number of the stamp.
        period: time between two stamps [s].
        motion: x, y [m], yaw [rad] and body twist [m/s, m/s, rad/s] of `base_link`, shape (6,).
        tilt: level components of the normal of the plane in which the vehicle moves [1].
        draw: standard normal noise, shape (3,).
        reading: receives yaw rate [rad/s] and specific force along x and y [m/s^2], shape (3,);
            NaN without a unit.
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
    # Until the first delayed reading is due, the oldest one is used.
    reading[:] = imu.late[max(step - late + 1, 0) % late]
