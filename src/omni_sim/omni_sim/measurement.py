"""Measurements of IMU, encoders and velocity sensor at a stamp, with faults: one kernel for all.

The noise of a stamp is one row of standard normal draws, so that drawing row by row and drawing
all rows at once give the same numbers.
"""

from collections.abc import Mapping
from typing import NamedTuple

from omni_platform.kernels import lean
from omni_platform.quantities import SECOND_NS, FloatArray
from omni_sim.encoders import EncoderConfiguration, Encoders, build_encoders, read_encoders
from omni_sim.faults import (
    CHANNELS,
    FaultConfiguration,
    Faults,
    build_faults,
    corrupt,
)
from omni_sim.imu import IMU_DRAWS, Imu, ImuConfiguration, build_imu, read_imu


class Instruments(NamedTuple):
    """IMU and encoders of a vehicle and the faults of all sensors, with their memories."""

    imu: Imu
    encoders: Encoders
    faults: Faults


class Truth(NamedTuple):
    """True motion of a vehicle at a stamp.

    Attributes:
        step: number of the stamp.
        period_ns: time between two stamps [ns].
        motion: x, y [m], yaw [rad] and body twist [m/s, m/s, rad/s] of `base_link`, shape (6,).
        tilt: level components of the normal of the plane in which the vehicle moves [1].
        angle: wheel angles [rad], shape (N,).
        speed: wheel speeds [rad/s], shape (N,).
    """

    step: int
    period_ns: int
    motion: FloatArray
    tilt: tuple[float, float]
    angle: FloatArray
    speed: FloatArray


class Readings(NamedTuple):
    """Measurements of a vehicle's sensors, with their faults; written in place.

    Attributes:
        twist: reading of the velocity sensor [m/s, m/s, rad/s], shape (3,).
        inertial: yaw rate [rad/s] and specific force [m/s^2], shape (3,).
        wheels: wheel speeds [rad/s], shape (N,).
    """

    twist: FloatArray
    inertial: FloatArray
    wheels: FloatArray


def build_instruments(
    imu: ImuConfiguration,
    encoders: EncoderConfiguration,
    faults: Mapping[str, FaultConfiguration],
    wheels: int,
    control_period: float,
) -> Instruments:
    """Return the sensors of a vehicle with a number of wheels in the layout of the kernel."""
    return Instruments(
        build_imu(imu, control_period),
        build_encoders(encoders, wheels),
        build_faults(faults, wheels),
    )


def draws(wheels: int) -> int:
    """Return the number of standard normal draws per stamp, for the sensors and then the faults."""
    return 2 * (IMU_DRAWS + wheels) + 3


@lean
def measure(instruments: Instruments, truth: Truth, draw: FloatArray, readings: Readings) -> None:
    """Read all sensors; once per stamp.

    Args:
        instruments: changed in place.
        truth: true motion.
        draw: standard normal noise, shape (`draws(N)`,).
        readings: receives the measurements.
    """
    step, period_ns, motion, tilt, angle, speed = truth
    twist, inertial, wheels = readings
    period, count = period_ns / SECOND_NS, speed.size
    wheel_draw, spare = draw[IMU_DRAWS : IMU_DRAWS + count], draw[IMU_DRAWS + count :]
    read_imu(instruments.imu, step, period, motion, tilt, draw[:IMU_DRAWS], inertial)
    read_encoders(instruments.encoders, step, period, angle, speed, wheel_draw, wheels)
    faults = instruments.faults
    if faults.table.shape[0] > 0:
        # In the order of the channels. In a loop, because numba would compile `corrupt` again for
        # each constant argument.
        noise = spare[0:3], spare[3:4], spare[4:6], spare[6:]
        values = twist, inertial[:1], inertial[1:], wheels
        for channel in range(len(CHANNELS)):
            corrupt(faults, channel, step, period_ns, noise[channel], values[channel])
